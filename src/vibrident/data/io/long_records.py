"""Long records, taken a part at a time: in memory, or in files of which parts are read."""

from __future__ import annotations

import atexit
import functools
import hashlib
import os
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from vibrident.base import parcel, sandbox
from vibrident.base.process import Limits, Process
from vibrident.data.io.calibration_file import CalibrationFile, read_calibration_file
from vibrident.data.io.columns import StartTime, memory_for
from vibrident.data.io.known_files import known_files
from vibrident.data.io.reader import by_ending, sha256
from vibrident.data.io.reading import LIBRARIES_BYTES, calibration_of, read
from vibrident.data.io.record_files import (
    RecordRequest,
    clock_reader,
    data_files,
    named_requests,
    open_channels,
)
from vibrident.data.io.sampling import cut
from vibrident.data.records import STATIONARY_EXCITATIONS, Calibration, Record

#: Records of more samples together are long.
MAX_TOGETHER = 1 << 20
#: Bytes a sample, in numbers, that the process which reads a part may take.
_COPIES = 16
_READ_LIMIT_S = 120.0  # to read a part


@dataclass(frozen=True)
class RecordSpan:
    """Consecutive samples of a record, of its first one on.

    Attributes:
        record: index of the record.
        start: first sample.
        stop: sample behind the last.
    """

    record: int
    start: int
    stop: int

    @property
    def samples(self) -> int:
        """Return the number of samples."""
        return self.stop - self.start


class LongRecords(ABC):
    """Records of one calibration that are taken a part at a time.

    Attributes:
        lengths: samples of each record.
    """

    lengths: tuple[int, ...]

    @abstractmethod
    def calibration(self, spans: Sequence[RecordSpan]) -> Calibration:
        """Return a calibration of parts of the records.

        Raises:
            InputError: the data cannot be used.
        """

    @abstractmethod
    def in_memory(self) -> Calibration:
        """Return the calibration of all samples.

        Raises:
            InputError: the data cannot be used.
        """

    @abstractmethod
    def digest(self) -> str:
        """Return the SHA-256 of the data and of all that is stated of them."""


@dataclass(frozen=True, eq=False)
class RecordsInMemory(LongRecords):
    """Records of a calibration in memory.

    Attributes:
        complete: the calibration.
        lengths: samples of each record.
    """

    complete: Calibration
    lengths: tuple[int, ...]

    def calibration(self, spans: Sequence[RecordSpan]) -> Calibration:
        """Return a calibration of parts of the records."""
        records = [_cut_record(self.complete.records[span.record], span) for span in spans]
        return replace(self.complete, records=tuple(records))

    def in_memory(self) -> Calibration:
        """Return the calibration."""
        return self.complete

    def digest(self) -> str:
        """Return the SHA-256 of the samples and of all that is stated of them."""
        return parcel.sha256(self.complete)


@dataclass(frozen=True)
class RecordsInFiles(LongRecords):
    """Records of a calibration file whose data files are read a part at a time.

    Attributes:
        path: the calibration file.
        firsts: first sample of each record in its file.
        lengths: samples of each record.
        guarded: whether a process of its own reads each part, with limits.
    """

    path: str
    firsts: tuple[int, ...]
    lengths: tuple[int, ...]
    guarded: bool = False

    def calibration(self, spans: Sequence[RecordSpan]) -> Calibration:
        """Return a calibration of parts of the records.

        Raises:
            InputError: the data cannot be used.
        """
        rows = [
            [span.record, self.firsts[span.record] + span.start, span.samples] for span in spans
        ]
        if not self.guarded:
            return read_rows(self.path, rows)
        room = LIBRARIES_BYTES + _COPIES * 16 * sum(span.samples for span in spans)
        limits = Limits(_READ_LIMIT_S, room, room, room)
        return sandbox.call(_reader(), read_rows, self.path, rows, limits=limits)

    def in_memory(self) -> Calibration:
        """Return the calibration of all samples."""
        return read(self.path)

    def digest(self) -> str:
        """Return the SHA-256 of the calibration file and its data files."""
        file = Path(self.path)
        document = read_calibration_file(file)
        names = [*data_files(document, file.parent, self.path), *known_files(document)]
        digests = [sha256(file), *(sha256(file.parent / name) for name in names)]
        return hashlib.sha256("".join(digests).encode()).hexdigest()


def long_records_in(calibration: Calibration) -> RecordsInMemory | None:
    """Return the records of a calibration in memory, or None where they are not long and steady."""
    steady = (
        calibration.table is None
        and calibration.quantity != "drive"
        and all(record.excitation in STATIONARY_EXCITATIONS for record in calibration.records)
        and all(record.optical is None for record in calibration.records)
        and len({record.circumstances for record in calibration.records}) == 1
    )
    lengths = tuple(record.samples for record in calibration.records)
    long = steady and sum(lengths) > MAX_TOGETHER
    return RecordsInMemory(calibration, lengths) if long else None


def long_records_of(
    path: str | os.PathLike[str], *, guarded: bool = False
) -> RecordsInFiles | None:
    """Return the records of a calibration file, or None where it is to be read whole.

    That is so where they are not long and steady motion, or where a format cannot read a part of a
    file (HDF5, miniSEED and WAV can), or where samples have time stamps.

    Args:
        path: the calibration file.
        guarded: whether its binary data files are opened and read in a process of its own.

    Raises:
        InputError: the file or its data cannot be used.
    """
    file = Path(path)
    document = read_calibration_file(file)
    if not _may_be_long(document, file):
        return None
    if guarded:
        room = int(LIBRARIES_BYTES + memory_for(0))
        spans = sandbox.run(
            spans_in_files, str(file), limits=Limits(_READ_LIMIT_S, room, room, room)
        )
    else:
        spans = spans_in_files(str(file))
    if spans is None or sum(count for _, count in spans) <= MAX_TOGETHER:
        return None
    firsts, counts = zip(*spans, strict=True)
    return RecordsInFiles(str(file.resolve()), firsts, counts, guarded)


@functools.cache
def _reader() -> Process:
    """Return the process that reads parts of guarded files; it ends when it is idle."""
    process = Process(idle_s=_READ_LIMIT_S)
    atexit.register(process.close)
    return process


def read_rows(path: str, rows: Sequence[Sequence[int]]) -> Calibration:
    """Return the calibration of some samples of a calibration file.

    Args:
        path: the calibration file.
        rows: index of a record, first sample in its file, and number of samples.

    Raises:
        InputError: the data cannot be used.
    """
    file = Path(path)
    spans: Mapping[int, slice] = {
        record: slice(first, first + count) for record, first, count in rows
    }
    calibration = calibration_of(read_calibration_file(file), file.parent, str(file), spans)
    records = tuple(map(_named_by_time, calibration.records))
    return replace(calibration, records=records)


def spans_in_files(path: str) -> list[tuple[int, int]] | None:
    """Return the first sample and the number of samples of each record in its file.

    None where a file is to be read whole.

    Raises:
        InputError: the calibration file or a data file cannot be used.
    """
    file = Path(path)
    document = read_calibration_file(file)
    spans = []
    for request, _ in named_requests(document, file.parent, path):
        span = _span_in_file(request, document, file.parent)
        if span is None:
            return None
        spans.append((span.start, span.stop - span.start))
    return spans


def _span_in_file(request: RecordRequest, document: CalibrationFile, folder: Path) -> slice | None:
    """Return the samples of a record in its file; None where that is to be read whole."""
    channels = open_channels(request, document, folder)
    reader = clock_reader(request, document, channels[0].source)
    lengths: set[int] = set()
    starts: set[StartTime | None] = set()
    for channel in channels:
        source = channel.source
        positions = [
            source_channel.position
            for source_channel in channels
            if source_channel.source is source
        ]
        if not source.reads_parts(channel.position) or reader.has_time_column(
            source, channel.position, positions
        ):
            return None
        lengths.add(source.length(channel.position))
        starts.add(source.start(channel.position))
    clock = reader.clock_of(channels[0].source, channels[0].position, [])
    if clock is None or len(lengths) > 1 or len(starts) > 1:
        return None
    rate_hz = clock.clock.rate_hz
    return cut(lengths.pop(), rate_hz, request.entry.start_s, request.entry.stop_s, request.where)


def _may_be_long(document: CalibrationFile, file: Path) -> bool:
    """Return whether a calibration file may have long records of steady motion; cheaply."""
    if document.table is not None or document.interferometer is not None:
        return False
    if document.reference.quantity == "drive" or document.sampling.time_column is not None:
        return False
    entries = document.records
    if not all(entry.excitation in STATIONARY_EXCITATIONS for entry in entries):
        return False
    if len({entry.circumstances for entry in entries}) > 1:
        return False
    names = {request.file for request, _ in named_requests(document, file.parent, str(file))}
    readers = by_ending()
    if not all(Path(name).suffix.lower() in readers for name in names):
        return False
    sizes = [os.stat(file.parent / name).st_size for name in names if (file.parent / name).exists()]
    return sum(sizes) > MAX_TOGETHER  # a sample takes a byte or more


def _cut_record(record: Record, span: RecordSpan) -> Record:
    """Return a part of a record, named by its time."""
    if span == RecordSpan(span.record, 0, record.samples):
        return record
    samples = slice(span.start, span.stop)
    step = f"samples {span.start + 1} to {span.stop} of {record.samples}"
    name = f"{record.name} from {span.start * record.sampling_interval_s:g} s"
    return replace(record.part(samples, step), name=name)


def _named_by_time(record: Record) -> Record:
    return replace(record, name=f"{record.name} from {record.start_time_s:g} s")
