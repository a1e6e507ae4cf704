"""From [[records]] entries to Records: find the files, choose the columns, cut, scale."""

from __future__ import annotations

import glob
import math
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from vibrident.base.errors import InputError
from vibrident.data.io.calibration_file import CalibrationFile, RecordsEntry
from vibrident.data.io.columns import ColumnFile
from vibrident.data.io.header_units import (
    require_channel_unit,
    require_response_unit,
    seconds_per_unit,
)
from vibrident.data.io.reader import open_columns, sha256
from vibrident.data.io.sampling import (
    SAME_RATE,
    Sampling,
    agreed_rate,
    contradicting_rate,
    cut,
    require_same_start,
    sampling_from_times,
)
from vibrident.data.records import FloatArray, Provenance, Record

_GLOB_SIGNS = re.compile(r"[*?\[]")
REPAIR = "repair the file, or leave that part out with start_s / stop_s"


@dataclass(frozen=True)
class Part:
    """One record to read: a file and the entry that asks for it."""

    entry: RecordsEntry
    file: str  # relative to the calibration file
    where: str

    @property
    def start_s(self) -> float:
        """Where the record begins in the file."""
        return self.entry.start_s or 0.0

    @property
    def stop_s(self) -> float:
        """Where it ends, infinite for the file's end."""
        return math.inf if self.entry.stop_s is None else self.entry.stop_s

    def other_file(self, folder: Path) -> list[str]:
        """For the history: the file of the reference, where it has one of its own."""
        other = self.entry.reference_file
        return (
            [] if other is None else [f"reference from {other}, SHA-256 {sha256(folder / other)}"]
        )


def named_parts(calibration: CalibrationFile, folder: Path, where: str) -> list[tuple[Part, str]]:
    """The part to read for each record, and the record's name: by entry and, within a glob, in natural order.

    ``folder``: where relative paths start; ``where``: the calibration file, for messages. InputError where a glob
    matches nothing, or a file is asked for twice.
    """
    parts = list(_parts(calibration.records, folder, where))
    _refuse_overlaps(parts, folder)
    return list(zip(parts, _record_names(parts), strict=True))


def data_files(calibration: CalibrationFile, folder: Path, where: str) -> list[str]:
    """Names of all data files of a calibration, relative to its folder; InputError where a glob matches nothing."""
    if calibration.table is not None:
        return [calibration.table.file]
    parts = list(_parts(calibration.records, folder, where))
    others = [part.entry.reference_file for part in parts if part.entry.reference_file is not None]
    return list(dict.fromkeys([*(part.file for part in parts), *others]))


def _parts(entries: Sequence[RecordsEntry], folder: Path, where: str) -> Iterator[Part]:
    for number, entry in enumerate(entries, start=1):
        here = f"{where}, [[records]] entry {number}"
        files = _files(entry.file, folder, here)
        for key in ("reference_file", "name"):
            if len(files) > 1 and getattr(entry, key) is not None:
                raise InputError(
                    f"The key {key!r} is for one file, but the entry's glob matches several.",
                    expected="one file",
                    found=f"{entry.file!r} matches {len(files)} files",
                    where=f"{here}, {key}",
                    remedy="write one [[records]] entry a file",
                )
        yield from (Part(entry, file, here) for file in files)


def _files(pattern: str, folder: Path, where: str) -> list[str]:
    if not _GLOB_SIGNS.search(pattern) or os.path.exists(folder / pattern):
        return [pattern]
    found = glob.glob(pattern, root_dir=folder, recursive=True)
    matches = [Path(match).as_posix() for match in found if not (folder / match).is_dir()]
    if not matches:
        raise InputError(
            "No file matches.",
            expected=f"one file or more in {folder}",
            found=f"file = {pattern!r}, which matches nothing",
            where=f"{where}, file",
            remedy="check the pattern; it is relative to the calibration file's folder",
        )
    return sorted(matches, key=natural)


def _refuse_overlaps(parts: Sequence[Part], folder: Path) -> None:
    """Refuse samples in two entries: they would count twice. Separate parts of one file are two records."""
    seen: dict[Path, list[Part]] = {}
    for part in parts:
        others = seen.setdefault((folder / part.file).resolve(), [])
        for other in others:
            if part.start_s < other.stop_s and other.start_s < part.stop_s:
                raise InputError(
                    "Two [[records]] entries contain the same samples.",
                    expected="each sample in one record",
                    found=f"{part.file!r}, which {other.where.rsplit(', ', 1)[-1]} asks for too",
                    where=part.where,
                    remedy="narrow the glob, or give each entry its own part with start_s and stop_s",
                )
        others.append(part)


def _record_names(parts: Sequence[Part]) -> list[str]:
    files = [part.file for part in parts]
    names: list[str] = []
    for part in parts:
        name = part.entry.name or part.file
        if part.entry.name is None and files.count(part.file) > 1:
            name += f" from {part.start_s:g} s"
        if name in names:
            raise same_name(name, f"{part.where}, name")
        names.append(name)
    return names


def same_name(name: str, where: str) -> InputError:
    """The error of two records of one name."""
    return InputError(
        "Two records have the same name.",
        expected="a unique name for each record",
        found=repr(name),
        where=where,
        remedy="change one of the names",
    )


@dataclass(frozen=True)
class _Channel:
    """One column as in its file."""

    source: ColumnFile
    position: int
    values: FloatArray

    def physical(self, kept: slice, scale: float) -> FloatArray:
        """Return the kept values, all finite, in physical units."""
        values = self.values[kept]
        self.source.require_finite(self.position, values, kept.start, REPAIR)
        return values * scale

    def step(self, channel: str, scale: float, unit: str) -> str:
        """Describe the column's conversion for the history."""
        name = self.source.names[self.position]
        return (
            f"{channel}: column {self.position + 1}"
            + (f" ({name!r})" if name else "")
            + f" × {scale!r} → {unit}"
        )


def read_record(
    part: Part, name: str, calibration: CalibrationFile, folder: Path, reference_unit: str
) -> Record:
    """Read one record of a calibration file in ``folder``; InputError where its file cannot be used."""
    entry, to_response, to_reference = part.entry, calibration.response, calibration.reference
    channels = _load(part, calibration, folder)
    response, reference = channels["response"], channels.get("reference")
    if (time := channels.get("time")) is not None:
        sampling = timed(time.source, time.position, time.values)
    else:
        sampling = stated_sampling(
            part, calibration, [(c.source, c.position) for c in channels.values()]
        )
    _check_headers(calibration, channels, reference_unit)
    if reference is not None:
        require_same_start(
            (response.source, response.position), (reference.source, reference.position)
        )
    _check_frequency(part, sampling, response.source.file)
    used = [channel.position for channel in channels.values() if channel.source is response.source]
    kept = cut(response.values.size, sampling.rate_hz, entry.start_s, entry.stop_s, part.where)
    history = [response.step("response", to_response.scale, to_response.unit)]
    if reference is not None:
        history += [
            reference.step("reference", to_reference.scale, reference_unit),
            *part.other_file(folder),
        ]
    if sampling.note:
        history.append(sampling.note)
    if kept != slice(0, response.values.size):
        history.append(f"cut: samples {kept.start + 1} to {kept.stop} of {response.values.size}")
    return Record(
        name=name,
        reference=None if reference is None else reference.physical(kept, to_reference.scale),
        response=response.physical(kept, to_response.scale),
        sampling_rate_hz=sampling.rate_hz,
        excitation=entry.excitation,
        frequency_hz=entry.frequency_hz,
        start_time_s=sampling.start_time_s + kept.start / sampling.rate_hz,
        contradicting_rate_hz=None
        if time is not None
        else contradicting_rate(response.source, used, sampling.rate_hz),
        provenance=Provenance(part.file, sha256(folder / part.file), tuple(history)),
        reference_full_scale=None
        if reference is None
        else scaled(to_reference.full_scale, to_reference.scale),
        response_full_scale=scaled(to_response.full_scale, to_response.scale),
        circumstances=entry.circumstances,
    )


def _load(part: Part, calibration: CalibrationFile, folder: Path) -> dict[str, _Channel]:
    """Load "response", "reference" (but for a decay) and "time" (where a time column is asked for)."""
    main = open_columns(folder / part.file)
    wanted = {"response": (main, calibration.response.column, "[response] column")}
    if part.entry.excitation != "decay":
        other = part.entry.reference_file
        source = main if other is None else open_columns(folder / other)
        wanted["reference"] = (source, calibration.reference.column, "[reference] column")
    if calibration.sampling.time_column is not None and part.entry.rate_hz is None:
        wanted["time"] = (main, calibration.sampling.time_column, "[sampling] time_column")
    channels: dict[str, _Channel] = {}
    for source in dict.fromkeys(source for source, _, _ in wanted.values()):  # each file once
        positions = {
            channel: source.position_of(column, key)
            for channel, (its_source, column, key) in wanted.items()
            if its_source is source and column is not None
        }
        for (channel, position), values in zip(
            positions.items(), source.load([*positions.values()]), strict=True
        ):
            channels[channel] = _Channel(source, position, values)
    _require_same_length(channels)
    return channels


def _check_headers(
    calibration: CalibrationFile, channels: dict[str, _Channel], reference_unit: str
) -> None:
    response, reference, at = calibration.response, calibration.reference, channels["response"]
    require_channel_unit(
        at.source, at.position, "[response]", unit=response.unit, scale=response.scale
    )
    if "unit" in response.model_fields_set:
        require_response_unit(at.source, at.position, "[response]", response.unit, response.scale)
    if (at := channels.get("reference")) is not None:
        stated = {"unit": reference_unit, "scale": reference.scale, "quantity": reference.quantity}
        require_channel_unit(at.source, at.position, "[reference]", **stated)


def timed(source: ColumnFile, position: int, times: FloatArray) -> Sampling:
    """The sampling by a time column, in the unit of its header; InputError where times are missing or uneven."""
    source.require_finite(position, times, 0, "repair the time column, or give rate_hz")
    seconds = seconds_per_unit(source, position)
    sampling = sampling_from_times(times, lambda row: source.locate(position, row))
    if seconds == 1.0:
        return sampling
    note = (
        f"time: column {position + 1} ({source.names[position]!r}) × {seconds!r} → s, by the header"
    )
    return Sampling(sampling.rate_hz / seconds, sampling.start_time_s * seconds, note)


def scaled(full_scale: float | None, scale: float) -> float | None:
    """A channel's full scale in its unit; None where it is not stated."""
    return None if full_scale is None else full_scale * abs(scale)


def stated_sampling(
    part: Part, calibration: CalibrationFile, channels: Sequence[tuple[ColumnFile, int]]
) -> Sampling:
    """The sampling by the rate of the calibration file or of the data file; InputError for none, or two that differ."""
    entry = part.entry
    stated = entry.rate_hz if entry.rate_hz is not None else calibration.sampling.rate_hz
    agreed = agreed_rate(stated, channels, part.where, part.file)
    if agreed is None:
        raise InputError(
            "The sampling rate is not given.",
            expected="rate_hz or time_column",
            found="neither",
            where=f"{part.where.split(', [[records]]')[0]}, [sampling]",
            remedy="add rate_hz = … (samples per second) or time_column = … (seconds)",
        )
    note = f"sampling rate: {agreed.rate_hz!r} Hz, which the file states to {agreed.rate_rounding:.1g} (relative)"
    return Sampling(
        agreed.rate_hz, entry.start_time_s or 0.0, note if agreed.rate_rounding > SAME_RATE else ""
    )


def _check_frequency(part: Part, sampling: Sampling, file: str) -> None:
    frequency_hz = part.entry.frequency_hz
    if frequency_hz is not None and frequency_hz >= sampling.rate_hz / 2:
        raise InputError(
            "The frequency lies above half the sampling rate.",
            expected=f"frequency_hz below {sampling.rate_hz / 2:.9g} Hz, half the sampling rate",
            found=f"frequency_hz = {frequency_hz!r}",
            where=f"{part.where}, frequency_hz, for {file}",
            remedy="correct frequency_hz, or rate_hz / time_column under [sampling]",
        )


def _require_same_length(channels: dict[str, _Channel]) -> None:
    response = channels["response"]
    for name, channel in channels.items():
        if channel.values.size != response.values.size:
            raise InputError(
                f"The {name} channel and the response differ in length.",
                expected=f"{response.values.size} samples, as the response has in {response.source.file}",
                found=f"{channel.values.size} samples",
                where=f"{channel.source.file}, {channel.source.names[channel.position] or 'the column'}",
                remedy="give both channels over the same samples",
            )


#: A number or what is between two. One before "Hz", such as in ``0_05Hz`` or ``2.5 kHz``, may have a fraction.
_PIECE = re.compile(r"(\d+)(?:(?:[._,p](\d+))?[ _-]?(k?)hz)?|\D+", re.IGNORECASE)


def natural(name: str) -> tuple[tuple[tuple[int, float, str], ...], str]:
    """Sort key under which "2 Hz" comes before "10 Hz", "0_05hz" before "0_5hz", and "500 Hz" before "1 kHz"."""
    pieces: list[tuple[int, float, str]] = []
    for found in _PIECE.finditer(name):
        whole, fraction, kilo = found.groups()
        if whole is None:
            pieces.append((0, 0.0, found.group()))
        else:
            pieces.append(
                (1, float(f"{whole}.{fraction or 0}"[:300]) * (1000.0 if kilo else 1.0), "")
            )
    return tuple(pieces), name
