"""Known responses of the channels of tracked records: taken out, and their uncertainty projected.

An error of a known response changes log H over frequency. What it moves the parameters by is the
least-squares projection of that change onto their slopes, weighted by the motion of the records.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy import fft

from vibrident.base.fields import Fields
from vibrident.data.known.unsure import change_by
from vibrident.data.records import Calibration, FloatArray, Record
from vibrident.fit.response.deconvolution import chain_of, deconvolved
from vibrident.result.sensor import IdentifiedSensor


def without_known(calibration: Calibration) -> Calibration:
    """Return a calibration of records as the sensor's own motion and output.

    Raises:
        InputError: a record is too short for the known responses, or is a free decay.
    """
    chain = chain_of(calibration)
    if chain is None:
        return calibration
    by_channel = calibration.known_responses.items()
    remaining = {f"{name}_known_response": response.taken_out() for name, response in by_channel}
    records = tuple(deconvolved(_without_overdriven(r), chain) for r in calibration.records)
    return replace(calibration, records=records, **remaining)


def _without_overdriven(record: Record) -> Record:
    """Return a record without the samples at the full scale of its response."""
    overdriven = np.abs(record.response) >= (record.response_full_scale or np.inf)
    return record.without_response(overdriven, "full scale") if overdriven.any() else record


def known_effects(
    calibration: Calibration, sensor: IdentifiedSensor
) -> tuple[list[Fields], FloatArray]:
    """Return the effects of known responses on the parameters of a sensor.

    Args:
        calibration: records without their known responses.
        sensor: the sensor.

    Returns:
        Rows of a budget, and how far one u of each moves each parameter, shape (rows, parameters).
    """
    responses = calibration.known_responses.values()
    effects = [effect for response in responses for effect in response.effects]
    if not effects:
        return [], np.zeros((0, len(sensor.covariance)))
    slopes: list[FloatArray] = []
    changes: list[FloatArray] = []
    for record in calibration.records:
        assert record.reference is not None
        low_hz, high_hz = record.band_hz or (0.0, np.inf)
        moving = np.where(record.reference_mask, record.reference, 0.0)
        motion = np.asarray(fft.rfft(moving * np.hanning(record.samples)))
        hz = np.array(fft.rfftfreq(record.samples, 1.0 / record.sampling_rate_hz), dtype=float)
        inside = (hz >= max(low_hz, hz[1])) & (hz <= high_hz)
        response = motion[inside] * sensor.frequency_response(hz[inside], calibration.quantity)
        change = np.array([response * change_by(effect, hz[inside]) for effect in effects]).T
        slope = (motion[inside] * sensor.slopes(hz[inside], calibration.quantity)).T
        slopes += [slope.real, slope.imag]
        changes += [change.real, change.imag]
    design = np.concatenate(slopes)
    scale = np.linalg.norm(design, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    moves = np.linalg.lstsq(design / scale, np.concatenate(changes), rcond=None)[0]
    rows = [
        budget_row(
            systematic_effect.source, systematic_effect.kind, systematic_effect.standard_uncertainty
        )
        for systematic_effect in effects
    ]
    return rows, (moves / scale[:, None]).T


def budget_row(source: str, kind: str, standard_uncertainty: float) -> Fields:
    """Return a row of type B of an uncertainty budget, without its contributions."""
    return {
        "source": source,
        "type": "B",
        "kind": kind,
        "standard_uncertainty": standard_uncertainty,
        "unit": "",
        "degrees_of_freedom": None,
    }
