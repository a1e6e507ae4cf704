"""Read Records by [[records]] entries: find the files, choose the columns, cut, scale."""

from __future__ import annotations

import glob
import math
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.effects import SystematicEffect
from vibrident.data.io.alignment import ClockedChannel, align
from vibrident.data.io.calibration_file import (
    CalibrationFile,
    RecordsEntry,
    ReferenceSection,
    ResponseSection,
)
from vibrident.data.io.clocks import ClockReader
from vibrident.data.io.columns import ColumnFile, Positions
from vibrident.data.io.header_units import (
    ChannelConversion,
    SourceColumn,
    reference_conversion,
    response_conversion,
)
from vibrident.data.io.reader import open_columns, sha256
from vibrident.data.records import FloatArray, Provenance, Quantity, Record, ResponseTable

_GLOB_SIGNS = re.compile(r"[*?\[]")


@dataclass(frozen=True)
class RecordRequest:
    """Record to read: a file and the entry that asks for it."""

    entry: RecordsEntry
    file: str  # relative to the calibration file
    where: str

    @property
    def start_s(self) -> float:
        """Return where the record begins in the file, s."""
        return self.entry.start_s or 0.0

    @property
    def stop_s(self) -> float:
        """Return where the record ends in the file, s; infinite for the file's end."""
        return math.inf if self.entry.stop_s is None else self.entry.stop_s

    def other_file(self, folder: Path) -> list[str]:
        """Return, for the history, the file of the reference where it is another."""
        name = self.entry.reference_file
        return [] if name is None else [f"reference from {name}, SHA-256 {sha256(folder / name)}"]


def named_requests(
    calibration: CalibrationFile, folder: Path, where: str
) -> list[tuple[RecordRequest, str]]:
    """Return what to read for each record, and the record's name, in natural order.

    ``folder``: where relative paths start; ``where``: the calibration file, for messages.

    Raises:
        InputError: a glob matches nothing, or a file is asked for twice.
    """
    requests = list(_requests(calibration.records, folder, where))
    _refuse_overlaps(requests, folder)
    return list(zip(requests, _record_names(requests), strict=True))


def data_files(calibration: CalibrationFile, folder: Path, where: str) -> list[str]:
    """Return the names of all data files of a calibration, relative to its folder.

    Those that state known responses are not among them.

    Raises:
        InputError: a glob matches nothing.
    """
    if calibration.table is not None:
        return [calibration.table.file]
    requests = list(_requests(calibration.records, folder, where))
    reference_files = [
        request.entry.reference_file
        for request in requests
        if request.entry.reference_file is not None
    ]
    return list(dict.fromkeys([*(request.file for request in requests), *reference_files]))


def _requests(entries: Sequence[RecordsEntry], folder: Path, where: str) -> Iterator[RecordRequest]:
    for number, entry in enumerate(entries, start=1):
        location = f"{where}, [[records]] entry {number}"
        files = _files(entry.file, folder, location)
        for key in ("reference_file", "name"):
            if len(files) > 1 and getattr(entry, key) is not None:
                raise InputError(
                    f"The key {key!r} is for one file, but the entry's glob matches several.",
                    expected="one file",
                    found=f"{entry.file!r} matches {len(files)} files",
                    where=f"{location}, {key}",
                    remedy="write one [[records]] entry a file",
                )
        yield from (RecordRequest(entry, file, location) for file in files)


def _files(pattern: str, folder: Path, where: str) -> list[str]:
    if not _GLOB_SIGNS.search(pattern) or os.path.exists(folder / pattern):
        return [pattern]
    paths = glob.glob(pattern, root_dir=folder, recursive=True)
    matches = [Path(match).as_posix() for match in paths if not (folder / match).is_dir()]
    if not matches:
        raise InputError(
            "No file matches.",
            expected=f"one file or more in {folder}",
            found=f"file = {pattern!r}, which matches nothing",
            where=f"{where}, file",
            remedy="check the pattern; it is relative to the calibration file's folder",
        )
    return sorted(matches, key=natural_sort_key)


def _refuse_overlaps(requests: Sequence[RecordRequest], folder: Path) -> None:
    """Refuse samples in two entries, which would count twice."""
    requests_by_file: dict[Path, list[RecordRequest]] = {}
    for request in requests:
        earlier_requests = requests_by_file.setdefault((folder / request.file).resolve(), [])
        for earlier in earlier_requests:
            if request.start_s < earlier.stop_s and earlier.start_s < request.stop_s:
                asked_by = earlier.where.rsplit(", ", 1)[-1]
                raise InputError(
                    "Two [[records]] entries contain the same samples.",
                    expected="each sample in one record",
                    found=f"{request.file!r}, which {asked_by} asks for too",
                    where=request.where,
                    remedy="narrow the glob, or give each entry its own part with start_s and "
                    "stop_s",
                )
        earlier_requests.append(request)


def _record_names(requests: Sequence[RecordRequest]) -> list[str]:
    files = [request.file for request in requests]
    names: list[str] = []
    for request in requests:
        name = request.entry.name or request.file
        if request.entry.name is None and files.count(request.file) > 1:
            name += f" from {request.start_s:g} s"
        if name in names:
            raise duplicate_name(name, f"{request.where}, name")
        names.append(name)
    return names


def duplicate_name(name: str, where: str) -> InputError:
    """Return the error of two records of one name."""
    return InputError(
        "Two records have the same name.",
        expected="a unique name for each record",
        found=repr(name),
        where=where,
        remedy="change one of the names",
    )


@dataclass(frozen=True)
class CalibrationData:
    """Data of a calibration: records or a table.

    Attributes:
        quantity: of the reference.
        unit: of the reference.
        records: in the order of the calibration file; empty where there is a table.
        table: None where there are records.
        effects: systematic effects that follow from the data files.
    """

    quantity: Quantity
    unit: str
    records: tuple[Record, ...] = ()
    table: ResponseTable | None = None
    effects: tuple[SystematicEffect, ...] = ()


@dataclass(frozen=True)
class ReadRecord:
    """A record, and the standard uncertainty of the time between its channels by stamps, s."""

    record: Record
    timing_u_s: float = 0.0


def read_record(
    request: RecordRequest,
    name: str,
    calibration: CalibrationFile,
    folder: Path,
    reference_unit: str,
    rows: slice | None = None,
) -> ReadRecord:
    """Read one record of a calibration file; InputError where its file cannot be used.

    Args:
        request: file and entry.
        name: of the record.
        calibration: whose [response] unit is decided.
        folder: of the calibration file.
        reference_unit: of the reference after conversion.
        rows: samples of the file that are read in place of the entry's part of it; the file is one
            whose parts are read (see :class:`vibrident.data.io.long_records.FileRecords`).
    """
    entry = request.entry
    response, *references = _load_channels(request, calibration, folder, rows)
    reference = references[0] if references else None
    response_unit = calibration.response.unit
    conversion = response_conversion(response.column, calibration.response, response_unit)
    steps = [_step("response", response, conversion, calibration.response, response_unit)]
    to_response = conversion.factor * calibration.response.scale
    to_reference = 1.0
    if reference is not None:
        conversion = reference_conversion(reference.column, calibration.reference, reference_unit)
        to_reference = conversion.factor * calibration.reference.scale
        step = _step("reference", reference, conversion, calibration.reference, reference_unit)
        steps += [step, *request.other_file(folder)]
    _check_frequency(request, response.rate_hz, response.column.source.file)
    start_s, stop_s = (entry.start_s, entry.stop_s) if rows is None else (None, None)
    aligned = align(response, reference, start_s, stop_s, request.where)
    begins_s = aligned.start_s
    if rows is not None:
        begins_s += rows.start / aligned.rate_hz
        steps.append(f"samples {rows.start + 1} to {rows.stop} of the file")
    if entry.start_time_s is not None:
        begins_s += entry.start_time_s - response.clock.begins_s
    record = Record(
        name=name,
        reference=None if aligned.reference is None else _scaled(aligned.reference, to_reference),
        response=_scaled(aligned.response, to_response),
        sampling_rate_hz=aligned.rate_hz,
        excitation=entry.excitation,
        frequency_hz=entry.frequency_hz,
        valid=aligned.valid,
        start_time_s=begins_s,
        provenance=Provenance(
            request.file, sha256(folder / request.file), (*steps, *aligned.notes)
        ),
        reference_full_scale=scaled_limit(calibration.reference.full_scale, to_reference),
        response_full_scale=scaled_limit(calibration.response.full_scale, to_response),
        circumstances=entry.circumstances,
        band_hz=entry.band_hz,
    )
    if reference is None:
        record = replace(record, reference_full_scale=None)
    return ReadRecord(record, aligned.timing_u_s)


def timing_effects(readings: Sequence[ReadRecord]) -> tuple[SystematicEffect, ...]:
    """Return the effect of stamps that align the channels, at the largest size of any record."""
    largest = max((reading.timing_u_s for reading in readings), default=0.0)
    return (SystematicEffect("time stamps of the channels", "timing", largest),) if largest else ()


def _step(
    name: str,
    channel: ClockedChannel,
    conversion: ChannelConversion,
    section: ReferenceSection | ResponseSection,
    unit: str,
) -> str:
    """Describe the conversion of a column for the history."""
    position = channel.column.position
    column = channel.column.source.names[position]
    label = f" ({column!r})" if column else ""
    factor = f" in {conversion.unit} × {conversion.factor!r}" if conversion.factor != 1.0 else ""
    return f"{name}: column {position + 1}{label}{factor} × {section.scale!r} → {unit}"


def _load_channels(
    request: RecordRequest, calibration: CalibrationFile, folder: Path, rows: slice | None
) -> list[ClockedChannel]:
    """Load the response and, but for a decay, the reference, each with its clock.

    A file without a clock has that of the other.
    """
    columns = open_channels(request, calibration, folder)
    loaded: dict[ColumnFile, Iterator[FloatArray]] = {}
    for source in dict.fromkeys(column.source for column in columns):  # each file once
        positions = [column.position for column in columns if column.source is source]
        values = source.load(positions) if rows is None else _block(source, positions, rows)
        loaded[source] = iter(values)
    reader = clock_reader(request, calibration, columns[0].source)
    clocks = []
    for column in columns:
        channels = [
            source_column.position
            for source_column in columns
            if source_column.source is column.source
        ]
        clocks.append(reader.clock_of(column.source, column.position, channels))
    default_clock = next(filter(None, clocks), None)
    if default_clock is None:
        raise missing_rate(request.where)
    first = 0 if rows is None else rows.start
    return [
        ClockedChannel(
            column,
            next(loaded[column.source]),
            clock or default_clock.begun_at(column.source.start(column.position)),
            first,
        )
        for column, clock in zip(columns, clocks, strict=True)
    ]


def _block(source: ColumnFile, positions: Positions, rows: slice) -> list[FloatArray]:
    """Return some samples of columns, each as an array of its own."""
    block = source.block(positions, rows.start, rows.stop)
    return [np.array(values, dtype=np.float64) for values in block]


def open_channels(
    request: RecordRequest, calibration: CalibrationFile, folder: Path
) -> list[SourceColumn]:
    """Return the columns of response and reference, of which nothing is loaded.

    A decay has no reference.
    """
    main = open_columns(folder / request.file)
    sections: list[tuple[ColumnFile, int | str | None, str]]
    sections = [(main, calibration.response.column, "[response]")]
    if request.entry.excitation != "decay":
        reference_file = request.entry.reference_file
        source = main if reference_file is None else open_columns(folder / reference_file)
        sections.append((source, calibration.reference.column, "[reference]"))
    columns = []
    for source, column, section in sections:
        assert column is not None  # checked with the calibration file
        position = source.position_of(column, f"{section} column")
        source.require_over_time(position, f"{section} column")
        columns.append(SourceColumn(source, position, section))
    if len({(column.source.file, column.position) for column in columns}) < len(columns):
        raise InputError(
            "Reference and response are the same column.",
            expected="two columns",
            found=repr(columns[0].header),
            where=request.where,
            remedy="correct column under [reference] or [response]",
        )
    return columns


def clock_reader(
    request: RecordRequest, calibration: CalibrationFile, main: ColumnFile
) -> ClockReader:
    """Return the reader of the clocks of a part's channels."""
    stated_hz = request.entry.rate_hz
    time_column = None
    if stated_hz is None:
        stated_hz = calibration.sampling.rate_hz
        time_column = calibration.sampling.time_column
    return ClockReader(stated_hz, time_column, request.where, main)


def missing_rate(where: str) -> InputError:
    """Return the error of a record whose sampling rate nothing states."""
    return InputError(
        "The sampling rate is not given.",
        expected="rate_hz or time_column",
        found="neither",
        where=f"{where.split(', [[records]]')[0]}, [sampling]",
        remedy="add rate_hz = … (samples per second) or time_column = … (seconds)",
    )


def scaled_limit(full_scale: float | None, scale: float) -> float | None:
    """Return a channel's full scale in its unit; None where it is not stated."""
    return None if full_scale is None else full_scale * abs(scale)


def _scaled(values: FloatArray, factor: float) -> FloatArray:
    """Return values times a factor as a read-only array, which a record takes without a copy.

    A column that was loaded whole is scaled where it stands: 20 million samples fit in memory once.
    """
    is_own = values.base is None and values.flags.writeable
    product = np.multiply(values, factor, out=values if is_own else None)
    product.flags.writeable = False
    return product


def _check_frequency(request: RecordRequest, rate_hz: float, file: str) -> None:
    frequency_hz = request.entry.frequency_hz
    if frequency_hz is not None and frequency_hz >= rate_hz / 2:
        raise InputError(
            "The frequency lies above half the sampling rate.",
            expected=f"frequency_hz below {rate_hz / 2:.9g} Hz, half the sampling rate",
            found=f"frequency_hz = {frequency_hz!r}",
            where=f"{request.where}, frequency_hz, for {file}",
            remedy="correct frequency_hz, or rate_hz / time_column under [sampling]",
        )


#: A number or what is between two. One before "Hz", such as in ``0_05Hz`` or ``2.5 kHz``, may have
#: a fraction.
_PIECE = re.compile(r"(\d+)(?:(?:[._,p](\d+))?[ _-]?(k?)hz)?|\D+", re.IGNORECASE)


def natural_sort_key(name: str) -> tuple[tuple[tuple[int, float, str], ...], str]:
    """Return a sort key: "2 Hz" before "10 Hz", "0_05hz" before "0_5hz", "500 Hz" before 1 kHz."""
    pieces: list[tuple[int, float, str]] = []
    for match in _PIECE.finditer(name):
        digits, fraction, kilo = match.groups()
        if digits is None:
            pieces.append((0, 0.0, match.group()))
        else:
            pieces.append(
                (1, float(f"{digits}.{fraction or 0}"[:300]) * (1000.0 if kilo else 1.0), "")
            )
    return tuple(pieces), name
