"""A source of samples and what it gives: chunks, in physical units."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from vibrident.data.io.calibration_file import CalibrationFile
from vibrident.data.records import FloatArray


@dataclass(frozen=True, eq=False)
class Chunk:
    """Samples of both channels that follow each other; one that is not a number in either is a gap."""

    reference: (
        FloatArray  # shape (samples,), in the SI unit of the calibration's reference quantity
    )
    response: FloatArray  # shape (samples,), in its response unit
    # time of the first sample, s, by the source's clock; None: it follows the chunk before
    start_s: float | None = None
    # standard uncertainty of that time, s: what is within 3 of them of the expected one follows
    clock_s: float = 0.0
    separate: bool = False  # a record of its own, which follows no other
    sine: bool = False  # the motion is one tone
    tone_hz: float | None = None  # its frequency, where it is known exactly
    position: int = (
        0  # where a resumable source goes on after this chunk; 0: it cannot be left here
    )


@dataclass(frozen=True)
class Wanted:
    """What is asked of a source."""

    calibration: CalibrationFile  # the calibration file: columns, scales, units, sampling
    file: Path  # its path
    rate_hz: float  # samples per second
    # what to open: a file, a device; or the form of the data, for standard input
    address: str = ""
    position: int = 0  # where to go on; 0: from the beginning
    idle_s: float | None = (
        # seconds without new samples after which a source that would wait ends; None: it waits
        None
    )


@dataclass(frozen=True)
class Source:
    """A source of samples."""

    name: str  # as a user names it
    title: str  # in a few words
    # what is wanted → chunks. Raises InputError where it cannot be had
    open: Callable[[Wanted], Iterator[Chunk]]
    resumable: bool = False  # whether it can go on at the position of a chunk
