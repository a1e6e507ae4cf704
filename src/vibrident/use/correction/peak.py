"""Peak of a compensated record, and the agreement of the record with a reference in the same band.

The peak is that between the samples, corrected for the bias by noise, with its interval.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri, stdtrit

from vibrident.data.records import BoolArray, FloatArray, Quantity, Record
from vibrident.fit.response.transform import line_counts
from vibrident.physics.models.base import DERIVATIVES
from vibrident.physics.models.slopes import ComplexArray
from vibrident.use.correction.compensation import Compensation
from vibrident.use.correction.quiet import bridged

NEWTON_STEPS = 6  # for the instant of the peak
#: Maxima within so many standard deviations of the noise of the largest compete with it.
COMPETING_DEVIATIONS = 3.0
COVERAGE = 0.95
#: A peak near a record's end must be larger by so many standard deviations of the error there.
END_ERROR_DEVIATIONS = 2.0


@dataclass(frozen=True)
class Peak:
    """Largest magnitude of the acceleration."""

    value: float  # signed, m/s²
    time_s: float  # from the record's first sample
    standard_uncertainty: float  # m/s²
    interval_95: tuple[float, float]  # m/s²
    effective_degrees_of_freedom: float  # by Welch and Satterthwaite (GUM G.4)
    coverage_factor: float  # of the interval
    components: Mapping[str, float]  # standard uncertainty by origin, m/s²
    noise_bias: float  # subtracted: a maximum of signal and noise is biased high, m/s²


def find_peak(
    acceleration: FloatArray,
    spectrum: ComplexArray,
    compensation: Compensation,
    components: Mapping[str, FloatArray],
) -> Peak | None:
    """Return the peak of a record, or None if no sample is known.

    Args:
        acceleration: shape (samples,), NaN where it is not known.
        spectrum: transform of the acceleration, continued beyond the record's ends.
        compensation: of the record.
        components: standard uncertainty of every sample by origin.
    """
    known = np.isfinite(acceleration)
    if not known.any():
        return None
    inner = known & (
        components["ends"] <= sum(components[name] for name in components if name != "ends")
    )
    index = _top(acceleration, known, inner if inner.any() else known, components["ends"])
    sign = 1.0 if acceleration[index] >= 0 else -1.0
    position, top, curvature = _refined(spectrum, compensation, index, sign)
    parts = {name: float(series[index]) for name, series in components.items()}
    bias = _noise_bias(sign * acceleration, index, parts.get("noise", 0.0), curvature, compensation)
    value = sign * (top - bias)
    u = float(np.sqrt(sum(part**2 for part in parts.values())))
    freedoms = {
        "model": compensation.sensor.degrees_of_freedom,
        "noise": compensation.baseline.degrees_of_freedom,
    }
    share = sum(parts.get(name, 0.0) ** 4 / freedom for name, freedom in freedoms.items())
    freedom = min(u**4 / share, 1e9) if share > 0 else 1e9
    k = float(stdtrit(freedom, 0.5 + COVERAGE / 2))
    interval = (value - k * u, value + k * u)
    return Peak(value, position / compensation.rate, u, interval, freedom, k, parts, float(bias))


def _top(acceleration: FloatArray, known: BoolArray, inner: BoolArray, ends: FloatArray) -> int:
    """Return the index of the largest sample.

    One near the record's ends counts only if it is larger by more than the error there.
    """
    size = np.abs(acceleration)
    inside = int(np.argmax(np.where(inner, size, -1.0)))
    anywhere = int(
        np.argmax(np.where(known, size - END_ERROR_DEVIATIONS * np.nan_to_num(ends), -1.0))
    )
    return (
        anywhere
        if size[anywhere] - END_ERROR_DEVIATIONS * ends[anywhere] > size[inside]
        else inside
    )


def _refined(
    spectrum: ComplexArray, compensation: Compensation, index: int, sign: float
) -> tuple[float, float, float]:
    """Refine the band-limited maximum near a sample.

    Returns:
        Position in samples, height, and curvature (1/s², negative).
    """
    lines = np.arange(spectrum.size)
    weights = sign * spectrum * line_counts(compensation.size) / compensation.size
    phase = 2j * np.pi * lines / compensation.size
    omega = 2.0 * np.pi * lines / compensation.size * compensation.rate
    position = float(index)
    for _ in range(NEWTON_STEPS):
        turned = weights * np.exp(phase * (position + compensation.pad))
        slope = float(np.sum(np.real(1j * omega * turned)))
        curvature = float(np.sum(np.real(-(omega**2) * turned)))
        if curvature >= 0:
            break
        step = -slope / curvature * compensation.rate
        position = float(np.clip(position + np.clip(step, -0.5, 0.5), index - 1.0, index + 1.0))
        position = float(np.clip(position, 0.0, compensation.samples - 1.0))
        if abs(step) < 1e-6:
            break
    turned = weights * np.exp(phase * (position + compensation.pad))
    height = float(np.sum(np.real(turned)))
    curvature = float(np.sum(np.real(-(omega**2) * turned)))
    return position, height, curvature


def _noise_bias(
    upright: FloatArray, index: int, noise: float, curvature: float, compensation: Compensation
) -> float:
    """Return the bias of the maximum by noise, to first order.

    Near a maximum a(t) = a₀ − c t²/2, noise n shifts it by n'/c and raises it by n'²/(2 c); of m
    equal maxima, the largest of m draws is taken.
    """
    if noise == 0.0:
        return 0.0
    omega = 2.0 * np.pi * compensation.frequency_hz
    power = np.abs(compensation.total) ** 2 * compensation.baseline.noise(compensation.frequency_hz)
    slope = compensation.line_mean(omega**2 * power)
    bias = min(slope / (2.0 * -curvature), noise) if curvature < 0 else 0.0
    inner = upright[1:-1]
    tops = (
        (inner >= upright[:-2])
        & (inner > upright[2:])
        & (inner > upright[index] - COMPETING_DEVIATIONS * noise)
    )
    places = np.flatnonzero(tops) + 1
    apart = max(1.0, 0.5 * compensation.rate / compensation.band.high_hz)
    rivals = 1 + int(np.sum(np.diff(places) > apart)) if places.size else 1
    if rivals > 1:
        bias += noise * float(ndtri((rivals - 0.375) / (rivals + 0.25)))
    return bias


@dataclass(frozen=True)
class Agreement:
    """Compensated acceleration against the reference's, away from the record's ends."""

    rmse: float  # against the reference in the same band, m/s²
    nrmse: float | None  # that over the reference's standard deviation
    # against the reference as it is; None if the reference is no acceleration
    rmse_unfiltered: float | None
    reference_peak: float  # the reference's sample of largest magnitude, filtered to the band, m/s²
    # part of these samples whose deviation lies within k = 1.96 of its uncertainty
    within_95_percent: float


def reference_in_band(
    record: Record, quantity: Quantity, compensation: Compensation
) -> FloatArray | None:
    """Return the reference as acceleration in the band, shape (samples,), or None."""
    if record.reference is None or not record.reference_mask.any():
        return None
    values = bridged(record.reference, record.reference_mask)
    baseline = compensation.baseline
    if baseline.rest_samples:
        values -= np.mean(values[: baseline.rest_samples])
    else:
        values -= np.average(values, weights=np.hanning(values.size))
    order = DERIVATIVES[quantity]
    rests = replace(baseline, rests_at_end=baseline.rests_at_end and order == 0)
    plain = replace(compensation, integrations=0, baseline=rests)
    gain = plain.lowpass * (2j * np.pi * plain.frequency_hz) ** order
    return plain.restored(plain.spectrum(values), gain)


def compare_with_reference(
    record: Record,
    quantity: Quantity,
    acceleration: FloatArray,
    components: Mapping[str, FloatArray],
    reference: FloatArray,
) -> Agreement | None:
    """Compare the acceleration with the reference where both are known.

    Args:
        record: the record.
        quantity: of its reference.
        acceleration: compensated, shape (samples,), NaN where it is not known.
        components: its standard uncertainty by origin.
        reference: as acceleration in the same band, shape (samples,).

    Returns:
        The agreement; None if they are never known together.
    """
    known = np.isfinite(acceleration) & record.mask & record.reference_mask
    if not known.any():
        return None
    u = np.sqrt(sum(series**2 for series in components.values()))
    inner = known & (components["ends"] <= np.sqrt(np.maximum(u**2 - components["ends"] ** 2, 0.0)))
    known = inner if inner.any() else known  # near its ends the filtered reference is as uncertain
    off = (acceleration - reference)[known]
    deviation = float(np.std(reference[known]))
    rmse = float(np.sqrt(np.mean(off**2)))
    unfiltered = None
    if DERIVATIVES[quantity] == 0 and record.reference is not None:
        raw = np.asarray(record.reference)[known]
        raw = raw - np.mean(raw - reference[known])
        unfiltered = float(np.sqrt(np.mean((acceleration[known] - raw) ** 2)))
    top = float(reference[known][np.argmax(np.abs(reference[known]))])
    inside = float(np.mean(np.abs(off) <= 1.96 * u[known]))
    return Agreement(rmse, rmse / deviation if deviation > 0 else None, unfiltered, top, inside)
