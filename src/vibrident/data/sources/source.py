"""A source of samples and what it gives: chunks, in physical units."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from vibrident.data.io.calibration_file import CalibrationFile
from vibrident.data.records import FloatArray


@dataclass(frozen=True, eq=False)
class Chunk:
    """Samples of both channels that follow each other; one that is not a number in either is a gap.

    Attributes:
        reference: shape (samples,), in the SI unit of the calibration's reference quantity.
        response: shape (samples,), in its response unit.
        start_s: time of the first sample, s, by the source's clock; None: it follows the chunk before.
        clock_s: standard uncertainty of that time, s: what is within 3 of them of the expected one follows.
        separate: a record of its own, which follows no other.
        sine: the motion is one tone.
        tone_hz: its frequency, where it is known exactly.
        position: where a resumable source goes on after this chunk; 0: it cannot be left here.
    """

    reference: FloatArray
    response: FloatArray
    start_s: float | None = None
    clock_s: float = 0.0
    separate: bool = False
    sine: bool = False
    tone_hz: float | None = None
    position: int = 0


@dataclass(frozen=True)
class Wanted:
    """What is asked of a source.

    Attributes:
        calibration: the calibration file: columns, scales, units, sampling.
        file: its path.
        rate_hz: samples per second.
        address: what to open: a file, a host and port, a device; or the form of the data, for standard input.
        position: where to go on; 0: from the beginning.
        idle_s: seconds without new samples after which a source that would wait ends; None: it waits.
    """

    calibration: CalibrationFile
    file: Path
    rate_hz: float
    address: str = ""
    position: int = 0
    idle_s: float | None = None


@dataclass(frozen=True)
class Source:
    """A source of samples.

    Attributes:
        name: as in ``--source NAME``.
        title: in a few words.
        open: what is wanted → chunks. Raises InputError where it cannot be had.
        resumable: whether it can go on at the position of a chunk.
    """

    name: str
    title: str
    open: Callable[[Wanted], Iterator[Chunk]]
    resumable: bool = False
