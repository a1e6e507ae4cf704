"""Adaptive correction: each record is corrected with the parameters of the sensor at its end."""

from __future__ import annotations

from dataclasses import replace

from vibrident.data.records import Calibration
from vibrident.result import Result
from vibrident.use.correction import Corrections, correct
from vibrident.use.tracking.outcome import tracked_result
from vibrident.use.tracking.session import TrackingSession
from vibrident.use.tracking.state import TrackerSettings


def correct_tracked(
    result: Result,
    calibration: Calibration,
    *,
    band_hz: tuple[float, float] | None,
    noise: float | None,
) -> Corrections:
    """Restore the acceleration of records, tracking the sensor through them.

    Args:
        result: of an identification; the tracking starts from it.
        calibration: records in the order of time, each with a reference.
        band_hz: as of ``correct``.
        noise: as of ``correct``.

    Raises:
        InputError: a record lacks a reference, rates differ, or an error of ``correct`` or of a
            tracking session.
    """
    settings = TrackerSettings(reference_uncertainty=calibration.reference_standard_uncertainty)
    session, chunks = TrackingSession.from_records(result, calibration, settings, 1.0)
    pieces = []
    for record, chunk in zip(calibration.records, chunks, strict=True):
        session.take(chunk)
        session.finish()
        now = tracked_result(result, session)
        pieces.append(
            correct(now, replace(calibration, records=(record,)), band_hz=band_hz, noise=noise)
        )
    findings = tuple(finding for piece in pieces for finding in piece.findings)
    return replace(
        pieces[0],
        corrections=tuple(correction for piece in pieces for correction in piece.corrections),
        findings=findings,
    )
