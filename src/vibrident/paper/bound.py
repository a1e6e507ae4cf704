"""Compute the Cramér–Rao bound of a simulated calibration.

No unbiased estimator has a smaller variance. The Fisher information is Σ JᵀJ/σ², with J from
central differences of the exact response to the true motion; the unknown initial state and offset
of each record are projected out. The bound is independent of estimators and their uncertainties.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from vibrident.data.records import FloatArray, Record
from vibrident.paper.metrics import CURVE_POINTS
from vibrident.physics.models import SensorModel, parse
from vibrident.physics.simulation import Motion, Sensor, exact_response

#: Relative step of the differences.
_RELATIVE_STEP = 1e-5


@dataclass(frozen=True, eq=False)
class Bound:
    """Least covariance of the parameters, relative to their values, by white response noise.

    Attributes:
        names: of the parameters.
        covariance: shape (parameters, parameters), relative, at noise of the response's own rms
            (level 1).
    """

    names: tuple[str, ...]
    covariance: FloatArray

    def deviations(self, level: float) -> dict[str, float]:
        """Return the least relative standard deviation of each parameter.

        ``level``: noise over each record's rms.
        """
        return dict(
            zip(self.names, (level * np.sqrt(np.diag(self.covariance))).tolist(), strict=True)
        )

    def curve_percent(
        self, model: SensorModel, truth: dict[str, float], band_hz: tuple[float, float]
    ) -> FloatArray:
        """Return the least standard deviation of the curve's magnitude at level 1, %, (points,)."""
        frequency = np.geomspace(*band_hz, CURVE_POINTS)

        def log_magnitude(values: dict[str, float]) -> FloatArray:
            return np.log(np.abs(model.frequency_response(values, frequency)))

        slopes = [_central_difference(log_magnitude, truth, name) for name in self.names]
        slope = np.stack(slopes, axis=1)
        return 100.0 * np.sqrt(np.einsum("pi,ij,pj->p", slope, self.covariance, slope))


def cramer_rao(sensor: Sensor, records: Sequence[Record], motions: Sequence[Motion]) -> Bound:
    """Return the bound for records of an underdamped second-order sensor that start from rest.

    Args:
        sensor: simulated, with its true parameters.
        records: its noise-free responses.
        motions: true motion of each record.
    """
    model = parse(sensor.model)
    names = tuple(spec.name for spec in model.parameters)
    information = np.zeros((len(names), len(names)))
    for record, motion in zip(records, motions, strict=True):
        response = partial(
            exact_response,
            model,
            motion=motion,
            sampling_rate_hz=record.sampling_rate_hz,
            samples=record.samples,
        )
        slopes = [_central_difference(response, sensor.parameters, name) for name in names]
        columns = np.stack(slopes, axis=1)
        free = _nuisance_columns(sensor, record)
        columns -= free @ (free.T @ columns)
        information += columns.T @ columns / np.mean(np.square(record.response))
    scale = np.sqrt(np.diag(information))
    covariance = np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale)
    return Bound(names, covariance)


def _central_difference(
    function: Callable[[dict[str, float]], FloatArray], values: Mapping[str, float], name: str
) -> FloatArray:
    """Return the change of a function of the parameters per relative change of one of them."""
    up, down = (
        function({**values, name: values[name] * factor})
        for factor in (1.0 + _RELATIVE_STEP, 1.0 - _RELATIVE_STEP)
    )
    return (up - down) / (2.0 * _RELATIVE_STEP)


def _nuisance_columns(sensor: Sensor, record: Record) -> FloatArray:
    """Return orthonormal columns of the responses to initial state and offset, (samples, 3)."""
    natural = 2.0 * np.pi * sensor.parameters["natural_frequency"]
    damping = sensor.parameters["damping_ratio"]
    pole = natural * (-damping + 1j * np.sqrt(1.0 - damping**2))
    free = np.exp(pole * record.time_s)
    return np.linalg.qr(np.stack([free.real, free.imag, np.ones(record.samples)], axis=1))[0]
