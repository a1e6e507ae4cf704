"""The paper's five metrics (section 4.2), and how far a sensitivity curve lies from another.

    RMSE = √(mean (y − ŷ)²)      MAE = mean |y − ŷ|      MSE = RMSE²
    R² = 1 − Σ (y − ŷ)²/Σ (y − ȳ)²      RPD = SD(y)/RMSE,  SD with the divisor N

With that SD, R² = 1 − 1/RPD²; always MAE ≤ RMSE.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.physics.models import SensorModel

CURVE_POINTS = 401  # points of a curve over a band, equally spaced in log f


@dataclass(frozen=True)
class Metrics:
    """How well a response is predicted; in the unit of the response, here the normalised one."""

    rmse: float
    mae: float
    mse: float
    r2: float
    rpd: float

    @classmethod
    def of(cls, measured: FloatArray, predicted: FloatArray) -> Metrics:
        """Metrics over all samples, shape (samples,) each; R² and RPD are infinite or NaN if undefined."""
        error = measured - predicted
        mse = float(np.mean(np.square(error)))
        variance = float(np.var(measured))
        with np.errstate(divide="ignore", invalid="ignore"):
            share = float(np.divide(mse, variance))
            rpd = float(np.divide(1.0, np.sqrt(share)))
        return cls(float(np.sqrt(mse)), float(np.mean(np.abs(error))), mse, 1.0 - share, rpd)


@dataclass(frozen=True)
class CurveDeviation:
    """Magnitude of one sensitivity curve relative to another, less one, in percent."""

    frequency_hz: tuple[float, ...]  # where
    percent: tuple[float, ...]  # signed deviation there
    at_peak: float | None  # signed deviation at the resonance; None if absent

    @property
    def mean(self) -> float:
        """Mean of the absolute deviations, %."""
        return float(np.mean(np.abs(self.percent)))

    @property
    def largest(self) -> float:
        """Largest absolute deviation, %."""
        return float(np.max(np.abs(self.percent)))


def curve_deviation(
    model: SensorModel,
    found: Mapping[str, float],
    truth: Mapping[str, float],
    band_hz: tuple[float, float],
) -> CurveDeviation:
    """Deviation of the curve of the estimated parameters from the true one, over a band in log f."""
    frequency = np.geomspace(*band_hz, CURVE_POINTS)

    def percent(points: FloatArray) -> FloatArray:
        size = np.abs(model.frequency_response(found, points))
        return 100.0 * (size / np.abs(model.frequency_response(truth, points)) - 1.0)

    peak = resonance_hz(model, truth)
    at_peak = None if peak is None else float(percent(np.array([peak]))[0])
    return CurveDeviation(tuple(frequency.tolist()), tuple(percent(frequency).tolist()), at_peak)


def resonance_hz(model: SensorModel, values: Mapping[str, float]) -> float | None:
    """Return the resonance frequency; None if there is none."""
    return next(
        (float(d.value(values)) for d in model.derived(values) if d.name == "resonance_frequency"),
        None,
    )


def deviation_at_points(
    model: SensorModel, found: Mapping[str, float], frequency_hz: FloatArray, magnitude: FloatArray
) -> CurveDeviation:
    """Deviation of the curve of the estimated parameters from measured magnitudes per unit of acceleration (or
    drive)."""
    percent = 100.0 * (np.abs(model.frequency_response(found, frequency_hz)) / magnitude - 1.0)
    return CurveDeviation(tuple(frequency_hz.tolist()), tuple(percent.tolist()), None)
