"""Evaluate the sensitivity at the frequencies of a certificate, inside the measured band alone."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibrident.base.errors import InputError
from vibrident.base.nominal import SAME, Nominal, choose_reference, nominal_frequencies
from vibrident.data.records import BoolArray, FloatArray
from vibrident.physics.models.slopes import ComplexArray
from vibrident.result import Curve, MeasuredCurve, Result
from vibrident.show.curves import column, nearest_turn

_SAME_POINT = 1e-9  # relative distance within which a frequency is the curve's own point


@dataclass(frozen=True)
class SensitivityPoint:
    """The model's sensitivity at one frequency, in the result's units; standard uncertainties."""

    nominal: str  # nominal frequency, as text in Hz
    frequency_hz: float  # the frequency that the values belong to
    magnitude: float  # response per unit of the reference
    phase_deg: float | None  # None where the result has no phase
    magnitude_uncertainty: float | None  # None where not known
    phase_deg_uncertainty: float | None  # None where not known


def measured_band(result: Result) -> tuple[float, float] | None:
    """Return the lowest and highest frequency, Hz, common to the data and the model's curve.

    None if they do not overlap. The band of a tracked result is that of its calibration's curve,
    that of a rejected model the data's.
    """
    measured = result.measured.frequency_hz
    curve = result.response.frequency_hz
    measured = curve if result.is_tracked else measured[measured > 0.0]
    curve = curve if curve.size else measured
    if measured.size == 0:
        return None
    low = float(max(measured.min(), curve.min()))
    high = float(min(measured.max(), curve.max()))
    return (low, high) if low <= high * (1 + SAME) else None


def nominal_points(result: Result) -> tuple[SensitivityPoint, ...]:
    """Return the sensitivity at each nominal one-third-octave frequency of the measured band."""
    band = measured_band(result)
    if band is None:
        return ()
    sensitivities = (
        sensitivity_at(result, item)
        for item in nominal_frequencies(*band, result.measured.frequency_hz)
    )
    return tuple(point for point in sensitivities if point is not None)


def reference_frequency(result: Result) -> tuple[Nominal | None, str]:
    """Return the reference frequency, and how it was chosen or why there is none."""
    band = measured_band(result)
    if band is None:
        return None, "the result holds no measured points"
    stated_hz = result.certificate.get("reference_frequency_hz")
    return choose_reference(*band, result.measured.frequency_hz, stated_hz)


def reference_point(result: Result) -> tuple[SensitivityPoint | None, str]:
    """Return the model's sensitivity at the reference frequency, and how that was chosen."""
    nominal, why = reference_frequency(result)
    return (None if nominal is None else sensitivity_at(result, nominal)), why


def reference_value(result: Result) -> SensitivityPoint | None:
    """Return what is stated at the reference frequency: the measured value, else the model's."""
    nominal, _ = reference_frequency(result)
    if nominal is None:
        return None
    return measured_at(result, nominal) or sensitivity_at(result, nominal)


def measured_at(result: Result, nominal: Nominal) -> SensitivityPoint | None:
    """Return the measured value at a frequency; None where no data were taken there.

    Repeated points are averaged by the inverse variance of their noise; uncertainty that they share
    is not reduced.
    """
    points = result.measured
    at_frequency = np.abs(points.frequency_hz / nominal.frequency_hz - 1.0) <= SAME
    if not at_frequency.any():
        return None
    magnitude, u = _average(points, "magnitude", at_frequency)
    phase, u_phase = _average(points, "phase_deg", at_frequency)
    return SensitivityPoint(
        nominal.name,
        float(np.mean(points.frequency_hz[at_frequency])),
        magnitude,
        _none_if_nan(phase),
        _none_if_nan(u),
        _none_if_nan(u_phase),
    )


def _average(points: MeasuredCurve, quantity: str, at_frequency: BoolArray) -> tuple[float, float]:
    """Average repeated points; return mean and standard uncertainty, NaN where not known."""
    values: FloatArray = getattr(points, quantity)[at_frequency]
    if quantity == "phase_deg":
        values = nearest_turn(values, values[:1])
    u, noise = (
        column(points, f"{quantity}_{column_kind}")[at_frequency]
        for column_kind in ("uncertainty", "noise")
    )
    if len(values) == 1:
        return float(values[0]), float(u[0])
    usable = np.all(np.isfinite(noise) & (noise > 0.0))
    weights = noise**-2 if usable else np.ones(len(values))
    mean = float(weights @ values / weights.sum())
    common = np.max(np.sqrt(np.maximum(u**2 - noise**2, 0.0))) if usable else np.max(u)
    mean_uncertainty = weights.sum() ** -0.5 if usable else 0.0
    return mean, float(np.hypot(common, mean_uncertainty))


def sensitivity_at(result: Result, nominal: Nominal) -> SensitivityPoint | None:
    """Return the model's sensitivity: the curve's own point, else between its neighbours.

    Between neighbours the ratio of the curve to the result's model is interpolated, which is one
    but for rounding, so a sharp resonance is followed; of the uncertainties the magnitude's
    relative one and the phase's own. None outside the curve.
    """
    curve = result.response
    frequency = curve.frequency_hz
    if frequency.size == 0 or not (
        frequency[0] * (1 - SAME) <= nominal.frequency_hz <= frequency[-1] * (1 + SAME)
    ):
        return None
    nearest = int(np.argmin(np.abs(np.log(frequency / nominal.frequency_hz))))
    if abs(frequency[nearest] / nominal.frequency_hz - 1.0) <= _SAME_POINT or frequency.size == 1:
        return _point_at(curve, nearest, nominal)
    right = min(max(int(np.searchsorted(frequency, nominal.frequency_hz)), 1), frequency.size - 1)
    return _interpolate_point(result, slice(right - 1, right + 1), nominal)


def _point_at(curve: Curve, i: int, nominal: Nominal) -> SensitivityPoint:
    return SensitivityPoint(
        nominal.name,
        float(curve.frequency_hz[i]),
        float(curve.magnitude[i]),
        _none_if_nan(curve.phase_deg[i]),
        _none_if_nan(curve.magnitude_uncertainty[i]),
        _none_if_nan(curve.phase_deg_uncertainty[i]),
    )


def _none_if_nan(value: float) -> float | None:
    return None if math.isnan(value) else float(value)


def _interpolate_point(result: Result, pair: slice, nominal: Nominal) -> SensitivityPoint:
    curve = result.response
    f = nominal.frequency_hz
    ends = curve.frequency_hz[pair]
    share = math.log(f / ends[0]) / math.log(ends[1] / ends[0])
    model = _model_response(result, np.array([*ends, f]))
    shape = np.abs(curve.magnitude[pair]) / np.abs(model[:2])
    magnitude = abs(model[2]) * float(shape[0]) * float(shape[1] / shape[0]) ** share
    phase = _interpolate_value(curve.phase_deg[pair], 0.0)
    if phase is not None:
        offset = curve.phase_deg[pair] - np.rad2deg(np.angle(model[:2]))
        offset[1] -= 360.0 * round(float(offset[1] - offset[0]) / 360.0)
        phase = float(np.rad2deg(np.angle(model[2])) + offset[0] + share * (offset[1] - offset[0]))
        phase -= 360.0 * math.ceil((phase - 180.0) / 360.0)
    relative = _interpolate_value(
        curve.magnitude_uncertainty[pair] / np.abs(curve.magnitude[pair]), share
    )
    u = None if relative is None else relative * magnitude
    return SensitivityPoint(
        nominal.name,
        f,
        magnitude,
        phase,
        u,
        _interpolate_value(curve.phase_deg_uncertainty[pair], share),
    )


def _interpolate_value(ends: FloatArray, share: float) -> float | None:
    return _none_if_nan((1.0 - share) * ends[0] + share * ends[1])


def _model_response(result: Result, frequency_hz: FloatArray) -> ComplexArray:
    """Return the complex response of the result's model; ones if the model is not known."""
    quantity: Any = result.quantity
    flat = np.ones(frequency_hz.shape, dtype=complex)
    try:
        response = result.to_sensor().frequency_response(frequency_hz, quantity)
    except (InputError, KeyError):
        return flat
    return response if np.all(np.isfinite(response)) and np.all(response != 0) else flat
