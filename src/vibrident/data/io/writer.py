"""Write a calibration as files that ``read`` takes back: calibration.toml and CSV files."""

from __future__ import annotations

import contextlib
import math
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.base.errors import InputError
from vibrident.base.files import atomic_write, unwritable
from vibrident.data.io.record_files import duplicate_name
from vibrident.data.io.toml_text import toml_document
from vibrident.data.records import (
    Calibration,
    FloatArray,
    Record,
    ResponseTable,
    SystematicEffect,
)

CALIBRATION_FILE = "calibration.toml"
_TABLE_KEYS = {
    "frequency": "frequency_hz",
    "magnitude": "magnitude",
    "phase": "phase_rad",
    "magnitude_uncertainty": "magnitude_uncertainty",
    "phase_uncertainty": "phase_uncertainty_rad",
}
_UNSAFE = re.compile(r"[^\w.+-]+")
#: Devices of Windows, with any ending.
_RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\.|$)", re.IGNORECASE)
#: Bytes of a name: with a number and an ending, every file system takes it.
_MAX_NAME_BYTES = 120


def write_calibration(folder: str | os.PathLike[str], calibration: Calibration) -> Path:
    """Write the calibration into a folder; return the path of its calibration.toml.

    A record becomes a CSV file with the columns time_s, reference_<quantity> and response, in
    physical units; a table becomes one file; every float reads back exactly. A free decay has no
    reference column. All files appear together, calibration.toml last; files of the same names are
    replaced, others stay.

    Args:
        folder: created if it does not exist.
        calibration: records or table; history and hashes are not written, the new files have
            their own.

    Raises:
        InputError: the folder cannot be written, or a record leaves samples out, which CSV cannot
            represent.
    """
    target = Path(folder)
    _refuse_unwritable(calibration)
    if calibration.table is not None:
        files = ["table.csv"]
        tables = [_table_columns(calibration.table)]
    else:
        files = record_files([record.name for record in calibration.records])
        tables = (_record_columns(record, calibration.quantity) for record in calibration.records)
    new = not target.exists()
    try:
        target.mkdir(parents=True, exist_ok=True)
        with contextlib.ExitStack() as written:  # which renames the first one last
            main = written.enter_context(atomic_write(target / CALIBRATION_FILE))
            for file, columns in zip(files, tables, strict=True):
                _write_columns(written.enter_context(atomic_write(target / file)), columns)
            main.write_text(toml_document(_document(calibration, files)), encoding="utf-8")
    except OSError as error:
        if new:
            with contextlib.suppress(OSError):
                target.rmdir()
        raise unwritable(
            error, target, "name another folder, or make room; nothing was left half-written"
        ) from error
    return target / CALIBRATION_FILE


def _refuse_unwritable(calibration: Calibration) -> None:
    calibration.refuse_known_responses("A written calibration")
    names = [record.name for record in calibration.records]
    for record in calibration.records:
        if not record.mask.all():
            raise InputError(
                "A record with samples left out cannot be written.",
                expected="records whose samples are all valid",
                found=f"{int(np.sum(~record.mask))} of {record.samples} samples left out",
                where=f"record {record.name!r}",
                remedy="write the calibration before samples are left out",
            )
        if names.count(record.name) > 1:
            raise duplicate_name(record.name, "calibration to be written")


def record_files(records: list[str]) -> list[str]:
    """Return a unique CSV file name for each record, valid on every system."""
    stems: list[str] = []
    for record in records:
        stem = _UNSAFE.sub("_", record.removesuffix(".csv")).encode(errors="replace")[
            -_MAX_NAME_BYTES:
        ]
        stem = stem.decode(errors="ignore").strip("._") or "record"
        stem = f"record_{stem}" if _RESERVED.match(stem) or stem.startswith("-") else stem
        used = {name.casefold() for name in stems}
        candidates = (stem, *(f"{stem}_{number}" for number in range(2, len(records) + 2)))
        stems.append(next(name for name in candidates if name.casefold() not in used))
    return [f"{stem}.csv" for stem in stems]


def _record_columns(record: Record, quantity: str) -> dict[str, FloatArray]:
    reference = None if record.excitation == "decay" else record.reference
    columns = {"time_s": record.start_time_s + record.time_s, f"reference_{quantity}": reference}
    return {name: values for name, values in columns.items() if values is not None} | {
        "response": record.response
    }


def _table_columns(table: ResponseTable) -> dict[str, FloatArray]:
    """Return the columns that the table has, by their names in the file, those of its fields."""
    return {
        name: values
        for name in _TABLE_KEYS.values()
        if (values := getattr(table, name)) is not None
    }


def _write_columns(path: Path, columns: Mapping[str, FloatArray]) -> None:
    """Write columns with the shortest digits that read back exactly."""
    # plain Python is faster here than pandas
    texts = [map(repr, values.tolist()) for values in columns.values()]
    with path.open("w", encoding="ascii", newline="\n") as stream:
        stream.write(",".join(columns) + "\n")
        stream.writelines(",".join(row) + "\n" for row in zip(*texts, strict=True))


def _band(record: Record) -> dict[str, float]:
    """Return the keys of the band that a fit takes from a record."""
    if record.band_hz is None:
        return {}
    low, high = record.band_hz
    return {"from_hz": low} | ({"to_hz": high} if math.isfinite(high) else {})


def _document(calibration: Calibration, files: list[str]) -> dict[str, Any]:
    """Return the keys of the calibration file."""
    records = calibration.records
    quantity = calibration.quantity
    driven = [record for record in records if record.excitation != "decay"]
    document: dict[str, Any] = {
        "sensor": {**calibration.sensor, "model": calibration.model},
        "reference": {
            "column": f"reference_{quantity}" if driven else None,
            "quantity": quantity,
            "scale": 1.0,
            "unit": calibration.reference_unit,
            "standard_uncertainty": calibration.reference_standard_uncertainty,
            "full_scale": _common(driven, "reference_full_scale"),
        },
        "response": {
            "column": "response" if records else None,
            "scale": 1.0,
            "unit": calibration.response_unit,
            "full_scale": _common(records, "response_full_scale"),
        },
    }
    if calibration.table is not None:
        written = _table_columns(calibration.table)
        columns = {key: column for key, column in _TABLE_KEYS.items() if column in written}
        document["table"] = {"file": files[0], **columns, "phase_unit": "rad"}
    else:
        rate_hz = float(records[0].sampling_rate_hz)
        document["sampling"] = {"rate_hz": rate_hz}
        document["records"] = [_entry(*pair, rate_hz) for pair in zip(records, files, strict=True)]
    document["uncertainty"] = [_effect(effect) for effect in calibration.effects]
    document["cmc"] = [
        {key: value for key, value in asdict(capability).items() if value not in (0.0, math.inf)}
        for capability in calibration.capabilities
    ]
    return document | {"certificate": calibration.certificate or []}


def _effect(effect: SystematicEffect) -> dict[str, Any]:
    size = effect.standard_uncertainty
    freedom = effect.degrees_of_freedom
    by_frequency = effect.pattern if effect.kind in ("gain", "phase") else ()
    table = [[f, size * abs(complex(real, imaginary))] for f, real, imaginary in by_frequency]
    return {
        "source": effect.source,
        "kind": effect.kind,
        **({"table": table} if table else {"standard_uncertainty": size}),
        "frequency_hz": effect.frequency_hz,
        "degrees_of_freedom": freedom if math.isfinite(freedom) else None,
    }


def _entry(record: Record, file: str, common_rate_hz: float) -> dict[str, Any]:
    rate_hz = record.sampling_rate_hz
    return {
        "file": file,
        "name": record.name or None,
        "excitation": record.excitation,
        "frequency_hz": record.frequency_hz,
        "rate_hz": rate_hz if rate_hz != common_rate_hz else None,
        "start_time_s": record.start_time_s or None,
        **_band(record),
        **{key: value for key, value in asdict(record.circumstances).items() if value != ""},
    }


def _common(records: Sequence[Record], field: str) -> float | None:
    """Return the common value of all records; the calibration file states one a channel."""
    distinct = {getattr(record, field) for record in records}
    if len(distinct) > 1:
        raise InputError(
            "The records differ in a value that the calibration file states once.",
            expected=f"one {field} for all records",
            found=", ".join(str(value) for value in list(distinct)[:5]),
            where="calibration to be written",
            remedy="write the records as two calibrations",
        )
    return next(iter(distinct), None)
