"""Sources of samples, and the chunks of samples, in physical units, that they yield."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from vibrident.data.io.calibration_file import CalibrationFile
from vibrident.data.records import FloatArray


@dataclass(frozen=True, eq=False)
class Chunk:
    """Consecutive samples of both channels; a sample that is NaN in either is a gap."""

    # shape (samples,), in the SI unit of the calibration's reference quantity
    reference: FloatArray
    response: FloatArray  # shape (samples,), in its response unit
    # time of the first sample, s, by the source's clock; None: it follows the previous chunk
    start_s: float | None = None
    # standard uncertainty of that time, s; a chunk within 3 of them of the expected time follows
    # the previous one
    clock_s: float = 0.0
    separate: bool = False  # a record of its own, which follows no other
    sine: bool = False  # the motion is one tone
    tone_hz: float | None = None  # its frequency, where it is known exactly
    # where a resumable source goes on after this chunk; 0: it cannot be left here
    position: int = 0


@dataclass(frozen=True)
class SourceRequest:
    """Request to a source: what to open, from where, and how to read it."""

    calibration: CalibrationFile  # the calibration file: columns, scales, units, sampling
    file: Path  # its path
    rate_hz: float  # samples per second
    # what to open: a file, a device; or the form of the data, for standard input
    address: str = ""
    position: int = 0  # where to go on; 0: from the beginning
    # seconds without new samples after which a source that would wait ends; None: it waits
    idle_s: float | None = None


@dataclass(frozen=True)
class Source:
    """Source of samples."""

    name: str  # as a user names it
    title: str  # in a few words
    # request → chunks; raises InputError if the source cannot be opened
    open: Callable[[SourceRequest], Iterator[Chunk]]
    resumable: bool = False  # whether it can go on at the position of a chunk
