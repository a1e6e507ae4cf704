"""Peak of a compensated record, and the agreement of the record with a reference in the same band.

The peak is that between the samples, corrected for the bias by noise, with its interval.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri, stdtrit

from vibrident.base.fields import NamedNumbers
from vibrident.data.known import KnownResponse
from vibrident.data.records import BoolArray, FloatArray, Quantity, Record
from vibrident.fit.response.transform import line_counts
from vibrident.physics.models.base import DERIVATIVES
from vibrident.physics.models.slopes import ComplexArray
from vibrident.use.correction.chain import MIN_PASSED
from vibrident.use.correction.compensation import Compensation
from vibrident.use.correction.quiet import bridged

NEWTON_STEPS = 6  # for the instant of the peak
#: Maxima within so many standard deviations of the noise of the largest compete with it.
COMPETING_DEVIATIONS = 3.0
COVERAGE = 0.95
COVERAGE_FACTOR = 1.96  # of that coverage, for a normal distribution
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
    components: NamedNumbers  # standard uncertainty by origin, m/s²
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
    finite = np.isfinite(acceleration)
    if not finite.any():
        return None
    inner = finite & (
        components["ends"] <= sum(components[name] for name in components if name != "ends")
    )
    index = _top(acceleration, finite, inner if inner.any() else finite, components["ends"])
    sign = 1.0 if acceleration[index] >= 0 else -1.0
    position, top, curvature = _refined(spectrum, compensation, index, sign)
    u_by_name = {name: float(series[index]) for name, series in components.items()}
    bias = _noise_bias(
        sign * acceleration, index, u_by_name.get("noise", 0.0), curvature, compensation
    )
    value = sign * (top - bias)
    u = float(np.sqrt(sum(component**2 for component in u_by_name.values())))
    freedoms = {
        "model": compensation.chain.sensor.degrees_of_freedom,
        "noise": compensation.baseline.degrees_of_freedom,
    }
    share = sum(u_by_name.get(name, 0.0) ** 4 / freedom for name, freedom in freedoms.items())
    freedom = min(u**4 / share, 1e9) if share > 0 else 1e9
    k = float(stdtrit(freedom, 0.5 + COVERAGE / 2))
    interval = (value - k * u, value + k * u)
    return Peak(
        value, position / compensation.rate, u, interval, freedom, k, u_by_name, float(bias)
    )


def _top(acceleration: FloatArray, finite: BoolArray, inner: BoolArray, ends: FloatArray) -> int:
    """Return the index of the largest sample.

    One near the record's ends counts only if it is larger by more than the error there.
    """
    size = np.abs(acceleration)
    inside = int(np.argmax(np.where(inner, size, -1.0)))
    anywhere = int(
        np.argmax(np.where(finite, size - END_ERROR_DEVIATIONS * np.nan_to_num(ends), -1.0))
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
    tops_index = np.flatnonzero(tops) + 1
    apart = max(1.0, 0.5 * compensation.rate / compensation.band.high_hz)
    rivals = 1 + int(np.sum(np.diff(tops_index) > apart)) if tops_index.size else 1
    if rivals > 1:
        bias += noise * _expected_largest(rivals)
    return bias


def _expected_largest(count: int) -> float:
    """Return the expected largest of so many standard normal values (Blom 1958)."""
    return float(ndtri((count - 0.375) / (count + 0.25)))


@dataclass(frozen=True)
class ReferenceAgreement:
    """Compensated acceleration against the reference's, away from the record's ends."""

    rmse: float  # against the reference in the same band, m/s²
    nrmse: float | None  # that over the reference's standard deviation
    # against the reference as it is; None if the reference is no acceleration
    rmse_unfiltered: float | None
    reference_peak: float  # the reference's sample of largest magnitude, filtered to the band, m/s²
    # part of these samples whose deviation lies within k = 1.96 of its uncertainty
    within_95_percent: float


@dataclass(frozen=True)
class ReferenceMotion:
    """Motion of a record's reference, and the response of its channel.

    Attributes:
        quantity: of its motion.
        response: response of its channel; None where the reference is the motion itself.
    """

    quantity: Quantity
    response: KnownResponse | None = None

    def gain(self, frequency_hz: FloatArray, used: BoolArray) -> ComplexArray | None:
        """Return acceleration over what the reference holds, where used, else zero; or None.

        None says that the channel is not known, or passes nothing, at a frequency that is used.
        """
        gain = np.zeros(frequency_hz.shape, dtype=complex)
        at = frequency_hz[used]
        gain[used] = (2j * np.pi * at) ** DERIVATIVES[self.quantity]
        if self.response is None:
            return gain
        low, high = self.response.band_hz
        passed = np.abs(self.response.value(at))
        if np.min(at) < low or np.max(at) > high or np.min(passed) < MIN_PASSED * np.max(passed):
            return None
        gain[used] /= self.response.value(at)
        return gain


def reference_in_band(
    record: Record, motion: ReferenceMotion, compensation: Compensation
) -> FloatArray | None:
    """Return the reference as acceleration in the band, shape (samples,).

    None where there is no reference, or its channel is not known in the whole band.
    """
    if record.reference is None or not record.reference_mask.any():
        return None
    gain = motion.gain(compensation.frequency_hz, compensation.lowpass > 0.0)
    if gain is None:
        return None
    values = bridged(record.reference, record.reference_mask)
    baseline = compensation.baseline
    if baseline.rest_samples:
        values -= np.mean(values[: baseline.rest_samples])
    else:
        values -= np.average(values, weights=np.hanning(values.size))
    order = DERIVATIVES[motion.quantity]
    rests = replace(baseline, rests_at_end=baseline.rests_at_end and order == 0)
    plain = replace(compensation, integrations=0, baseline=rests)
    return plain.restored(plain.spectrum(values), plain.lowpass * gain)


def compare_with_reference(
    record: Record,
    motion: ReferenceMotion,
    acceleration: FloatArray,
    components: Mapping[str, FloatArray],
    reference: FloatArray,
) -> ReferenceAgreement | None:
    """Compare the acceleration with the reference where both are known.

    Args:
        record: the record.
        motion: of its reference.
        acceleration: compensated, shape (samples,), NaN where it is not known.
        components: its standard uncertainty by origin.
        reference: as acceleration in the same band, shape (samples,).

    Returns:
        The agreement; None if they are never known together.
    """
    usable = np.isfinite(acceleration) & record.mask & record.reference_mask
    if not usable.any():
        return None
    u = np.sqrt(sum(series**2 for series in components.values()))
    inner = usable & (
        components["ends"] <= np.sqrt(np.maximum(u**2 - components["ends"] ** 2, 0.0))
    )
    # near its ends the filtered reference is as uncertain
    usable = inner if inner.any() else usable
    off = (acceleration - reference)[usable]
    deviation = float(np.std(reference[usable]))
    rmse = float(np.sqrt(np.mean(off**2)))
    unfiltered = None
    as_it_is = motion.response is None and DERIVATIVES[motion.quantity] == 0
    if as_it_is and record.reference is not None:
        raw = np.asarray(record.reference)[usable]
        raw = raw - np.mean(raw - reference[usable])
        unfiltered = float(np.sqrt(np.mean((acceleration[usable] - raw) ** 2)))
    top = float(reference[usable][np.argmax(np.abs(reference[usable]))])
    inside = float(np.mean(np.abs(off) <= COVERAGE_FACTOR * u[usable]))
    return ReferenceAgreement(
        rmse, rmse / deviation if deviation > 0 else None, unfiltered, top, inside
    )
