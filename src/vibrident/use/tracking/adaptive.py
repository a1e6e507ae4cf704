"""Adaptive correction: each record with the parameters that the sensor has at its end, and their uncertainty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.records import Calibration
from vibrident.data.sources.source import Chunk
from vibrident.result import Result
from vibrident.use.correction import Corrections, correct
from vibrident.use.tracking.outcome import tracked_result
from vibrident.use.tracking.session import Session
from vibrident.use.tracking.state import Settings


def correct_tracked(
    result: Result, calibration: Calibration, *, band_hz: tuple[float, float] | None, noise: float | None
) -> Corrections:
    """Restore the acceleration of records, tracking the sensor through them.

    Args:
        result: of an identification, from which tracking starts.
        calibration: records in the order of time, each with a reference.
        band_hz: band to restore; None: chosen for each record.
        noise: standard deviation of white noise of the response, response unit; None: from the records.

    Raises:
        InputError: a record lacks a reference, rates differ, or as of ``correct`` and a tracking session.
    """
    calibration.require_response(result.response_unit, "A table holds no response in time.")
    records = calibration.records
    rates = {record.sampling_rate_hz for record in records}
    if len(rates) != 1 or any(record.reference is None for record in records):
        raise InputError(
            "A sensor cannot be tracked through these records.",
            expected="records of one sampling rate, each with a reference",
            found=f"{len(rates)} sampling rates, {sum(r.reference is None for r in records)} without a reference",
            where=calibration.source or "calibration in memory",
            remedy="leave --track out",
        )
    settings = Settings(reference_uncertainty=calibration.reference_standard_uncertainty)
    session = Session.of(result, rates.pop(), calibration.quantity, 1.0, settings)
    parts = []
    for record in records:
        reference = np.where(record.reference_mask, record.reference, np.nan)  # type: ignore[arg-type]
        response = np.where(record.mask, record.response, np.nan)
        session.take(Chunk(reference, response, record.start_time_s, separate=True))
        session.tracker.finish()
        now = tracked_result(result, session)
        parts.append(correct(now, replace(calibration, records=(record,)), band_hz=band_hz, noise=noise))
    findings = tuple(finding for part in parts for finding in part.findings)
    return replace(parts[0], corrections=tuple(one for part in parts for one in part.corrections), findings=findings)
