"""Design causal filters for firmware: the sensor's model, and its correction to acceleration.

Each is a delay line with taps, then second-order sections. The model's sections have the sensor's
own poles and zeros, the correction's those of its inverse with a low-pass, and, for each zero of
the sensor at zero frequency, a high-pass instead of an integrator. The taps adjust both to the
target response over the band, with a delay of whole samples, by least squares. With the poles
already right, the remaining target is smooth, so a few taps suffice: the error falls like a power
of frequency/rate with their number. Small weights outside the band limit the gain there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.records import FloatArray
from vibrident.export.discrete import HoldCell, SecondOrderSections, hold_cell, map_sections
from vibrident.export.poles_zeros import PolesZeros, poles_zeros
from vibrident.export.sensor import ExportedSensor, require_linear

Response = Callable[[FloatArray], np.ndarray]
TAPS = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 16, 20, 24, 32, 48, 64, 96)


@dataclass(frozen=True, eq=False)
class Taps:
    """Delay line y_k = Σ_m h_m x_{k − lead − m}."""

    taps: np.ndarray  # h
    lead: int  # whole samples of delay before the first tap
    latency: int  # delay of the target response, samples
    error: float  # largest relative error over the band

    def response(self, frequency_hz: FloatArray, interval_s: float) -> np.ndarray:
        """Return the response to e^{jωt} sampled."""
        turn = -2j * np.pi * np.asarray(frequency_hz) * interval_s
        return np.exp(np.multiply.outer(turn, self.lead + np.arange(len(self.taps)))) @ self.taps


def fit_taps(
    target_response: Response,
    base_response: Response,
    band_hz: tuple[float, float],
    rate_hz: float,
    *,
    shift: float,
    tolerance: float,
    outside: float,
    size: float,
    fewest: int = 1,
) -> Taps:
    """Fit the fewest taps with base · taps = target · z^{−latency} over the band.

    Where no number of taps meets the tolerance, those of the least error are returned.

    Args:
        target_response: without latency.
        base_response: of the recursive part.
        band_hz: lowest and highest frequency.
        rate_hz: sampling rate.
        shift: approximate delay of target/base in samples; it sets the latency for a number of
            taps.
        tolerance: largest relative error.
        outside: weight of the response above the band, relative to its largest value in it.
        size: weight of the taps' size, to which rounding is proportional.
        fewest: least number of taps.
    """
    low, high = band_hz
    half_rate_hz = 0.5 * rate_hz
    interval_s = 1.0 / rate_hz

    def fit(delays: np.ndarray, latency: int) -> tuple[np.ndarray, float]:
        """Return taps at these delays in samples, and their largest relative error in the band."""
        count = len(delays)
        points = 3 * count + 40
        # dense towards both ends, as a polynomial needs it
        angles = np.pi * (np.arange(points) + 0.5) / points
        inside = low + (high - low) * 0.5 * (1.0 - np.cos(angles))
        inside = np.concatenate([inside, np.geomspace(low, high, 40), [low, high]])
        above = np.linspace(min(high * 1.5, 0.5 * (high + half_rate_hz)), half_rate_hz, points)

        def columns(f: FloatArray) -> np.ndarray:
            turns = np.multiply.outer(-2j * np.pi * f * interval_s, delays)
            return base_response(f)[:, None] * np.exp(turns)

        target = target_response(inside) * np.exp(-2j * np.pi * inside * latency * interval_s)
        largest = float(np.max(np.abs(target)))
        relative = columns(inside) / target[:, None]
        penalty = size * float(np.max(np.abs(relative))) * np.eye(count)
        rows = np.concatenate([relative, outside / largest * columns(above), penalty])
        right_side = np.zeros(2 * len(rows))  # real parts, then imaginary ones
        right_side[: len(inside)] = 1.0
        taps = np.linalg.lstsq(np.concatenate([rows.real, rows.imag]), right_side, rcond=1e-15)[0]
        return taps, float(np.max(np.abs(relative @ taps - 1.0)))

    best: Taps | None = None
    for count in TAPS:
        if count < fewest:
            continue
        latency = max(0, int(np.ceil(0.5 * (count - 1) - shift - 1e-9)))
        lead = max(0, int(np.round(shift + latency - 0.5 * (count - 1))))
        taps, error = fit(lead + np.arange(count), latency)
        if best is None or error < 0.5 * best.error:
            best = Taps(taps, lead, latency, error)
        if best.error <= tolerance:
            break
    assert best is not None
    return best


MAX_BAND_OVER_RATE = 0.45  # highest frequency of the band over the sampling rate
#: Relative errors over the band at which no further taps are added.
MODEL_TOLERANCE = 1e-10
CORRECTION_TOLERANCE = 1e-4
#: Sampling zeros of first-order hold by the number of zeros at infinity (Åström, Hagander & Sternby
#: 1984): roots of the Euler–Frobenius polynomials.
_SAMPLING_ZEROS = {
    0: (),
    1: (-1.0,),
    2: (-2.0 + 3.0**0.5, -2.0 - 3.0**0.5),
    3: (-1.0, -5.0 + 24.0**0.5, -5.0 - 24.0**0.5),
    4: tuple(np.roots((1.0, 26.0, 66.0, 26.0, 1.0)).tolist()),
}
#: Corner of the correction's high-pass, in place of an integrator, over the band's lower edge.
HIGH_PASS_OVER_BAND = 0.01
#: Weight of the correction's gain above the band, relative to its error in the band.
GAIN_WEIGHT_OUTSIDE = 1e-3
LOW_PASS_ORDER = 8
MAX_DELAY_SAMPLES = 16384  # longest delay line, samples


@dataclass(frozen=True, eq=False)
class Filter:
    """Filter y = sections(taps(x)) at a sampling rate: a delay line, then sections."""

    taps: Taps
    sections: SecondOrderSections
    rate_hz: float

    @property
    def latency(self) -> int:
        """Return the delay of the output in samples."""
        return self.taps.latency

    def response(self, frequency_hz: FloatArray) -> np.ndarray:
        """Return the response to e^{jωt} sampled, latency included."""
        return self.taps.response(frequency_hz, 1.0 / self.rate_hz) * self.sections.response(
            frequency_hz
        )

    def in_single_precision(self) -> Filter:
        """Return the filter with coefficients rounded to float."""
        taps, rows = (
            values.astype(np.float32).astype(float)
            for values in (self.taps.taps, self.sections.rows)
        )
        return replace(
            self, taps=replace(self.taps, taps=taps), sections=replace(self.sections, rows=rows)
        )

    def late(self, frequency_hz: FloatArray) -> np.ndarray:
        """Return the factor e^{−jωT·latency}."""
        return np.exp(-2j * np.pi * np.asarray(frequency_hz) * self.latency / self.rate_hz)

    @property
    def noise_gain(self) -> float:
        """Return the gain for white noise: the root of the mean of |response|².

        The mean is from 0 to half the rate.
        """
        relative_f = [np.geomspace(1e-7, 0.01, 2000), np.linspace(0.01, 0.5, 4000)[1:]]
        f = np.concatenate(relative_f) * self.rate_hz
        power = np.abs(self.response(f)) ** 2
        mean = np.sum(0.5 * (power[1:] + power[:-1]) * np.diff(f)) / (0.5 * self.rate_hz)
        return float(np.sqrt(mean))


def checked_rate(sensor: ExportedSensor, rate_hz: float | None) -> float:
    """Return the requested sampling rate, or the network's.

    Raises:
        InputError: neither is given, or the band is not below half of it.
    """
    interval = sensor.result.weights.get("sampling_interval_s")
    if rate_hz is None and interval:
        rate_hz = 1.0 / float(interval)
    if rate_hz is None or not np.isfinite(rate_hz) or rate_hz <= 0:
        raise InputError(
            "This format needs a sampling rate.",
            expected="samples per second, above 0",
            found="none, and no network with one in the result"
            if rate_hz is None
            else f"{rate_hz!r}",
            where="⟦export.rate_hz⟧",
            remedy="give ⟦export.rate_hz = HZ⟧",
        )
    if sensor.band_hz[1] > MAX_BAND_OVER_RATE * rate_hz:
        raise InputError(
            "The band does not fit this sampling rate.",
            expected=(
                f"a band up to {MAX_BAND_OVER_RATE * rate_hz:g} Hz at most ({MAX_BAND_OVER_RATE} "
                "of the rate)"
            ),
            found=f"{sensor.band_hz[1]:g} Hz at {rate_hz:g} samples per second",
            where="⟦export.rate_hz⟧",
            remedy="give a higher ⟦export.rate_hz⟧, or a narrower ⟦export.band_hz⟧",
        )
    return float(rate_hz)


def model_filter(sensor: ExportedSensor, rate_hz: float) -> tuple[Filter, HoldCell]:
    """Return the sensor as a causal filter, accurate over the band and below, and its cell.

    Raises:
        InputError: the model is not linear, or its delay is too long.
    """
    require_linear(sensor)
    cell = hold_cell(sensor, 1.0 / rate_hz)
    system = poles_zeros(sensor)
    highest = float(np.max(np.abs(np.imag(system.poles)))) / (2.0 * np.pi)
    if highest >= 0.5 * rate_hz:
        raise InputError(
            "The sensor's resonance is above half the sampling rate.",
            expected=f"more than {2.0 * highest:g} samples per second",
            found=f"{rate_hz:g}",
            where="⟦export.rate_hz⟧",
            remedy="give a higher ⟦export.rate_hz⟧",
        )
    filling = np.array(_SAMPLING_ZEROS[len(system.poles) - len(system.zeros)])
    sections = map_sections(
        system, 1.0 / rate_hz, filling, float(np.sqrt(sensor.band_hz[0] * sensor.band_hz[1]))
    )
    shift = (sensor.delay_s + 0.5 * sensor.window_s) * rate_hz
    if abs(shift) > MAX_DELAY_SAMPLES:
        raise InputError(
            "The delay is too long for a delay line.",
            expected=f"{MAX_DELAY_SAMPLES} samples at most",
            found=f"{shift:.0f} samples",
            where="⟦export.rate_hz⟧",
            remedy="leave the delay out with ⟦export.without⟧, and delay the samples elsewhere",
        )
    low = min(sensor.band_hz[0], 1e-3 * sensor.band_hz[1])  # a model is also used below the band
    taps = fit_taps(
        sensor.response,
        sections.response,
        (low, sensor.band_hz[1]),
        rate_hz,
        shift=shift,
        tolerance=MODEL_TOLERANCE,
        outside=1e-12,
        size=1e-11,
    )
    return Filter(taps, sections, rate_hz), cell


def correction_filter(sensor: ExportedSensor, rate_hz: float) -> Filter:
    """Return the stable filter from the response back to the reference quantity.

    It is accurate over the band and falls above it.

    Raises:
        InputError: the model is not linear.
    """
    require_linear(sensor)
    inverse, corner, zeros_at_rest = _invert(sensor, rate_hz)
    missing = len(inverse.poles) - len(inverse.zeros)
    sections = map_sections(inverse, 1.0 / rate_hz, np.full(missing, -1.0), sensor.band_hz[1])
    near = np.array([0.9, 1.0]) * sensor.band_hz[1]

    def target_response(f: FloatArray) -> np.ndarray:
        # The taps do not restore what the high-pass removes: they would have to be as long as its
        # impulse response.
        s = 2j * np.pi * f
        return (s / (s + corner)) ** (2 * zeros_at_rest) / sensor.response(f)

    ratio = target_response(near) / sections.response(near)
    slope = -np.angle(ratio[1] / ratio[0]) / (2 * np.pi * (near[1] - near[0]))
    taps = fit_taps(
        target_response,
        sections.response,
        sensor.band_hz,
        rate_hz,
        shift=float(slope * rate_hz),
        tolerance=CORRECTION_TOLERANCE,
        outside=GAIN_WEIGHT_OUTSIDE,
        size=1e-5,
        fewest=16,
    )
    return Filter(taps, sections, rate_hz)


def _invert(sensor: ExportedSensor, rate_hz: float) -> tuple[PolesZeros, float, int]:
    """Return the inverse: the sensor's poles and zeros exchanged and made stable, with a low-pass.

    Also the high-pass's corner, rad/s, and the number of integrators it replaces.
    """
    from scipy import signal

    system = poles_zeros(sensor)
    low, high = sensor.band_hz
    zeros_at_rest = int(np.sum(system.zeros == 0))
    corner = 2.0 * np.pi * HIGH_PASS_OVER_BAND * low
    zeros = np.concatenate([system.poles, np.zeros(zeros_at_rest, complex)])
    other_zeros = system.zeros[system.zeros != 0]
    # A zero on or right of the axis has no stable inverse; its mirror image has the same magnitude.
    decay = np.maximum(np.abs(np.real(other_zeros)), 0.02 * np.abs(other_zeros))
    stable_poles = -decay + 1j * np.imag(other_zeros)
    cutoff = 2.0 * np.pi * min(1.5 * high, 0.4 * rate_hz)
    low_pass: Any = signal.butter(LOW_PASS_ORDER, cutoff, analog=True, output="zpk")
    low_pass_poles = np.asarray(low_pass[1])
    high_pass_poles = np.full(2 * zeros_at_rest, -corner + 0j)
    poles = np.concatenate([stable_poles, high_pass_poles, low_pass_poles])
    gain = float(np.real(np.prod(-low_pass_poles))) / system.gain
    return PolesZeros(zeros, poles, gain), corner, zeros_at_rest
