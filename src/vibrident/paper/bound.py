"""The Cramér–Rao bound of a simulated calibration: no unbiased estimator has a smaller variance.

Fisher information Σ JᵀJ/σ², J from central differences of the exact response to the true motion, with the unknown
initial state and offset of each record projected out. It is independent of the estimators and their uncertainties.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vibrident.data.records import FloatArray, Record
from vibrident.paper.metrics import CURVE_POINTS
from vibrident.physics.models import SensorModel, parse
from vibrident.physics.simulation import Motion, Sensor, exact_response

_STEP = 1e-5  # relative step of the differences


@dataclass(frozen=True, eq=False)
class Bound:
    """Least covariance of the parameters, relative to their values, at white response noise of a relative level."""

    names: tuple[str, ...]  # of the parameters
    covariance: FloatArray  # shape (parameters, parameters), relative, at noise of the response's own rms (level 1)

    def deviations(self, level: float) -> dict[str, float]:
        """Least relative standard deviation of each parameter at noise of ``level`` times each record's rms."""
        return dict(zip(self.names, (level * np.sqrt(np.diag(self.covariance))).tolist(), strict=True))

    def curve_percent(self, model: SensorModel, truth: dict[str, float], band_hz: tuple[float, float]) -> FloatArray:
        """Least standard deviation of the curve's magnitude at level 1, %, at the points of a curve over the band."""
        frequency = np.geomspace(*band_hz, CURVE_POINTS)

        def size(name: str, factor: float) -> FloatArray:
            return np.log(np.abs(model.frequency_response({**truth, name: truth[name] * factor}, frequency)))

        slopes = [(size(name, 1.0 + _STEP) - size(name, 1.0 - _STEP)) / (2.0 * _STEP) for name in self.names]
        slope = np.stack(slopes, axis=1)
        return 100.0 * np.sqrt(np.einsum("pi,ij,pj->p", slope, self.covariance, slope))


def cramer_rao(sensor: Sensor, records: Sequence[Record], motions: Sequence[Motion]) -> Bound:
    """The bound for records of an underdamped second-order sensor that start from rest."""
    names = tuple(spec.name for spec in parse(sensor.model).parameters)
    information = np.zeros((len(names), len(names)))
    for record, motion in zip(records, motions, strict=True):
        columns = np.stack([_slope(sensor, name, record, motion) for name in names], axis=1)
        free = _imitable(sensor, record)
        columns -= free @ (free.T @ columns)
        information += columns.T @ columns / np.mean(np.square(record.response))
    scale = np.sqrt(np.diag(information))
    covariance = np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale)
    return Bound(names, covariance)


def _slope(sensor: Sensor, name: str, record: Record, motion: Motion) -> FloatArray:
    """Change of the response per relative change of a parameter, shape (samples,)."""
    up, down = (
        exact_response(
            parse(sensor.model),
            {**sensor.parameters, name: sensor.parameters[name] * factor},
            motion,
            sampling_rate_hz=record.sampling_rate_hz,
            samples=record.samples,
        )
        for factor in (1.0 + _STEP, 1.0 - _STEP)
    )
    return (up - down) / (2.0 * _STEP)


def _imitable(sensor: Sensor, record: Record) -> FloatArray:
    """Orthonormal columns of the responses to initial state and offset, shape (samples, 3)."""
    natural, damping = 2.0 * np.pi * sensor.parameters["natural_frequency"], sensor.parameters["damping_ratio"]
    pole = natural * (-damping + 1j * np.sqrt(1.0 - damping**2))
    free = np.exp(pole * record.time_s)
    return np.linalg.qr(np.stack([free.real, free.imag, np.ones(record.samples)], axis=1))[0]
