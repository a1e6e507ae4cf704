"""A calibration at a glance: a row a record, or one for the table, as plain values by their labels."""

from __future__ import annotations

from typing import Any

import numpy as np

from vibrident.base.amounts import pretty
from vibrident.data.records import Calibration, FloatArray, Record, ResponseTable


def describe(calibration: Calibration) -> list[dict[str, Any]]:
    """Return one row a record, or one row for the table; labels state the units."""
    if calibration.table is not None:
        return [_table_row(calibration.table, pretty(f"{calibration.response_unit}/({calibration.reference_unit})"))]
    return [_record_row(record, calibration) for record in calibration.records]


def _record_row(record: Record, calibration: Calibration) -> dict[str, Any]:
    return {
        "record": record.name,
        "excitation": record.excitation,
        "frequency / Hz": record.frequency_hz,
        "samples": record.samples,
        "left out": int(np.sum(~record.mask)),
        "rate / Hz": record.sampling_rate_hz,
        "duration / s": record.duration_s,
        **_channel("reference", record.reference, calibration.reference_unit),
        **_channel("response", record.response, calibration.response_unit),
    }


def _channel(name: str, values: FloatArray | None, unit: str) -> dict[str, float]:
    """The size of the motion, and the constant beside it."""
    if values is None:
        return {}
    rms, offset = float(np.std(values)), float(np.mean(values))
    return {f"{name} rms / {pretty(unit)}": rms, f"{name} offset / {pretty(unit)}": offset}


def _table_row(table: ResponseTable, unit: str) -> dict[str, Any]:
    return {
        "table": table.provenance.file,
        "points": table.points,
        "from / Hz": float(np.min(table.frequency_hz)),
        "to / Hz": float(np.max(table.frequency_hz)),
        f"least / {unit}": float(np.min(table.magnitude)),
        f"largest / {unit}": float(np.max(table.magnitude)),
        "phase": table.phase_rad is not None,
        "uncertainties": table.magnitude_uncertainty is not None,
    }
