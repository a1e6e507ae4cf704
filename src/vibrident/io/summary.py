"""Summary of a calibration, as plain values for a table. Nothing is printed here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibrident.records import Calibration, FloatArray, Record, ResponseTable


@dataclass(frozen=True)
class ChannelSummary:
    """Range and size of one channel, every value in ``unit``; ``rms`` is that of the motion, about ``mean``."""

    unit: str
    minimum: float
    maximum: float
    rms: float
    mean: float


@dataclass(frozen=True)
class RecordSummary:
    """One record at a glance; ``reference`` is None for a free decay."""

    name: str
    samples: int
    samples_left_out: int
    sampling_rate_hz: float
    duration_s: float
    excitation: str
    frequency_hz: float | None
    reference: ChannelSummary | None
    response: ChannelSummary


@dataclass(frozen=True)
class TableSummary:
    """A tabulated response at a glance; magnitudes in ``unit``, response unit per reference unit."""

    file: str
    points: int
    unit: str
    lowest_frequency_hz: float
    highest_frequency_hz: float
    smallest_magnitude: float
    largest_magnitude: float
    has_phase: bool
    has_uncertainties: bool


def describe(calibration: Calibration) -> list[RecordSummary] | list[TableSummary]:
    """Return one row a record, or one row for the table."""
    if calibration.table is not None:
        return [_table_row(calibration.table, f"{calibration.response_unit}/({calibration.reference_unit})")]
    return [_record_row(record, calibration) for record in calibration.records]


def _record_row(record: Record, calibration: Calibration) -> RecordSummary:
    reference = record.reference
    return RecordSummary(
        name=record.name,
        samples=record.samples,
        samples_left_out=int(np.sum(~record.mask)),
        sampling_rate_hz=record.sampling_rate_hz,
        duration_s=record.duration_s,
        excitation=record.excitation,
        frequency_hz=record.frequency_hz,
        reference=None if reference is None else _channel(reference, calibration.reference_unit),
        response=_channel(record.response, calibration.response_unit),
    )


def _channel(values: FloatArray, unit: str) -> ChannelSummary:
    return ChannelSummary(
        unit=unit,
        minimum=float(np.min(values)),
        maximum=float(np.max(values)),
        rms=float(np.std(values)),
        mean=float(np.mean(values)),
    )


def _table_row(table: ResponseTable, unit: str) -> TableSummary:
    return TableSummary(
        file=table.provenance.file,
        points=table.points,
        unit=unit,
        lowest_frequency_hz=float(np.min(table.frequency_hz)),
        highest_frequency_hz=float(np.max(table.frequency_hz)),
        smallest_magnitude=float(np.min(table.magnitude)),
        largest_magnitude=float(np.max(table.magnitude)),
        has_phase=table.phase_rad is not None,
        has_uncertainties=table.magnitude_uncertainty is not None,
    )
