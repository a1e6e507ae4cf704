"""Choice of the band: a balance between the motion that the low-pass removes and amplified noise.

The compensation is L(f)/H(f), with L real: one within the band, falling to zero over the octave
above it (and over the octave below it, if the sensor has no response to constant acceleration).
Following Eichstädt et al. (Metrologia 47, 2010; 53, 2016) the error of a compensation is bounded by
the input's spectrum where L is below one,

    |Δa(t)| ≤ 2 ∫ (1 − L) |A(f)| df,

with A from the record's own spectrum where it stands above the noise, and an envelope falling by a
power of the frequency beyond.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft

from vibrident.base.errors import InputError
from vibrident.data.records import BoolArray, FloatArray
from vibrident.use.correction.chain import MeasuringChain
from vibrident.use.correction.quiet import HANN_LINE_VARIANCE, Baseline, periodogram

BINS_PER_OCTAVE = 12  # spectral bins, and candidates of an edge
#: A bin has motion if its power exceeds the noise by so many standard deviations of the bin's mean.
MIN_MOTION_DEVIATIONS = 6.0
MIN_ENVELOPE_EXPONENT = 2.0  # of the falling envelope of |A|² (a pulse with steps)
MAX_ENVELOPE_EXPONENT = 200.0
ENVELOPE_OCTAVES = 1.5  # below the last bin with motion, from which the exponent is taken
LOBE_OCTAVES = 0.5  # beyond a zero, in which a pulse's spectrum rises again
MIN_ENVELOPE_BINS = 6  # with motion, from which an exponent is taken
TAPER_SHARE = 0.05  # part of a record in which its window rises from zero, and falls to it again
MAX_STOP_OF_HALF_RATE = 0.98  # end of the low-pass, in units of half the sampling rate
MIN_EDGE_PERIODS = 4.0  # of either edge of the band in a record


@dataclass(frozen=True)
class PassBand:
    """Band that the compensation passes."""

    low_hz: float  # L = 1 from here, L = 0 below low_hz/2; zero if L passes constant acceleration
    high_hz: float  # L = 1 up to here, L = 0 from 2 high_hz
    reason: str  # reason of the choice, in words

    @property
    def stop_hz(self) -> float:
        """Return the frequency from which L is zero."""
        return 2.0 * self.high_hz

    def passed(self, frequency_hz: FloatArray) -> FloatArray:
        """Return L at the frequencies."""
        return passed(frequency_hz, self.low_hz, self.high_hz)


def passed(
    frequency_hz: FloatArray, low_hz: float | FloatArray, high_hz: float | FloatArray
) -> FloatArray:
    """Return L of a band; the arguments broadcast.

    Its slopes have two continuous derivatives, so its kernel falls quickly.
    """
    upper = _step(2.0 - frequency_hz / high_hz)
    low = np.asarray(low_hz)
    return upper * np.where(
        low > 0, _step(2.0 * frequency_hz / np.where(low > 0, low, 1.0) - 1.0), 1.0
    )


def _step(x: FloatArray) -> FloatArray:
    x = np.clip(x, 0.0, 1.0)
    return x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)


@dataclass(frozen=True, eq=False)
class AccelerationSpectrum:
    """Acceleration and noise of a record in bins of frequency; powers as in ``quiet``."""

    frequency_hz: FloatArray  # of the bins, shape (bins,)
    # two-sided spectral lines in each bin, over the number of samples: Σ lines · power is a mean
    # square
    lines: FloatArray
    acceleration: FloatArray  # power of the acceleration, the noise subtracted, shape (bins,)
    noise: FloatArray  # power of the noise after the inverse 1/H, shape (bins,)
    samples: int  # of the record
    event: float  # part of the record with motion
    has_motion: BoolArray  # bins with motion, shape (bins,)

    def noise_deviation(self, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return the standard deviation of the noise that bands pass, m/s².

        ``low`` and ``high`` broadcast against one another.
        """
        gain = (
            passed(self.frequency_hz, np.asarray(low)[..., None], np.asarray(high)[..., None]) ** 2
        )
        return np.sqrt(np.sum(gain * self.noise * self.lines, axis=-1))

    def removed(self, low: FloatArray, high: FloatArray) -> FloatArray:
        """Return the rms of the removed acceleration during the motion, m/s²."""
        gain = (
            1.0 - passed(self.frequency_hz, np.asarray(low)[..., None], np.asarray(high)[..., None])
        ) ** 2
        return np.sqrt(np.sum(gain * self.acceleration * self.lines, axis=-1) / self.event)

    def bound(self, band: PassBand) -> float:
        """Return an upper bound of the removed acceleration, m/s²."""
        amplitude = np.sqrt(np.maximum(self.acceleration, 0.0) * self.samples)
        return float(np.sum((1.0 - band.passed(self.frequency_hz)) * amplitude * self.lines))

    def ratio(self, band: PassBand) -> float:
        """Return the rms of the removed part over that of the highest octave in the band."""
        weights = self.acceleration * self.lines
        removed = 1.0 - passed(self.frequency_hz, 0.0, band.high_hz)
        octave = top_octave(self.frequency_hz, band)
        return float(
            np.sqrt(
                np.sum(removed**2 * weights)
                / max(np.sum(octave**2 * weights), np.finfo(float).tiny)
            )
        )


def top_octave(frequency_hz: FloatArray, band: PassBand) -> FloatArray:
    """Return the gain that selects the highest octave of the band."""
    return band.passed(frequency_hz) - passed(frequency_hz, band.low_hz, 0.5 * band.high_hz)


def motion_share(values: FloatArray) -> float:
    """Return the part of a record with motion.

    It is 1 for a sine, and the duration of a shock over the record's length.
    """
    squares = values**2
    fourth = float(np.mean(squares**2))
    return (
        float(np.clip(1.5 * np.mean(squares) ** 2 / fourth, 2.0 / values.size, 1.0))
        if fourth > 0
        else 1.0
    )


def measure_content(
    values: FloatArray,
    rate: float,
    chain: MeasuringChain,
    baseline: Baseline,
    event: float,
    highest: float,
) -> AccelerationSpectrum:
    """Return the spectra of a record's acceleration and noise.

    Args:
        values: response without its offset, shape (samples,).
        rate: samples per second.
        chain: the sensor with its channel.
        baseline: rest, offset and noise of the record.
        event: part of the record with motion, 0 to 1.
        highest: highest frequency used, Hz.
    """
    count = values.size
    transient = baseline.rest_samples > 0 and baseline.rests_at_end
    window = np.ones(count) if transient else np.hanning(count)
    power = periodogram(values, window)
    if not transient:
        # The end of a sweep holds its highest frequencies, which the Hann window hides.
        upper = np.cumsum(power) > 0.5 * np.sum(power)
        power[upper] = np.maximum(power[upper], periodogram(values, _tapered(count))[upper])
    frequency = np.array(fft.rfftfreq(count, 1.0 / rate), dtype=np.float64)
    used = (frequency > 0) & (frequency <= highest)
    frequency = frequency[used]
    power = power[used]
    inverse = 1.0 / np.abs(chain.frequency_response(frequency)) ** 2
    noise = baseline.noise(frequency)
    number = np.floor(BINS_PER_OCTAVE * np.log2(frequency / frequency[0])).astype(int)
    _, number, size = np.unique(number, return_inverse=True, return_counts=True)

    def mean(line: FloatArray) -> FloatArray:
        return np.bincount(number, weights=line) / size

    centre = mean(frequency)
    level = mean(noise)
    spread = (1.0 if transient else HANN_LINE_VARIANCE) / size + baseline.spread
    has_motion = mean(power) > level * (1.0 + MIN_MOTION_DEVIATIONS * np.sqrt(spread))
    acceleration = np.maximum(mean((power - noise) * inverse), 0.0)
    limit = level * mean(inverse) * (1.0 + MIN_MOTION_DEVIATIONS * np.sqrt(spread))
    acceleration = _with_envelope(
        centre, acceleration, has_motion, limit, LOBE_OCTAVES if transient else 0.0
    )
    lines = 2.0 * size / count
    return AccelerationSpectrum(
        centre, lines, acceleration, mean(noise * inverse), count, event, has_motion
    )


def _tapered(count: int) -> FloatArray:
    """Return a window that falls to zero near the ends only, shape (count,)."""
    ramp = np.hanning(2 * max(round(TAPER_SHARE * count), 1))
    half = ramp.size // 2
    return np.concatenate([ramp[:half], np.ones(count - ramp.size), ramp[half:]])


def _with_envelope(
    frequency: FloatArray,
    acceleration: FloatArray,
    has_motion: BoolArray,
    limit: FloatArray,
    lobe_octaves: float,
) -> FloatArray:
    """Return the power with an envelope beyond the last bin with motion.

    Its slope is that of the octave before, or steeper by ``limit``. A shock's spectrum falls below
    the noise, and its envelope continues there. A tone, or random motion with an edge, ends: with a
    flatter envelope the bins beyond would show motion (``limit``). A pulse's spectrum has zeros,
    though, and rises again within ``lobe_octaves``: silence counts from there.
    """
    if not has_motion.any():
        return np.zeros_like(acceleration)
    last = int(np.flatnonzero(has_motion)[-1])
    x = np.log(frequency / frequency[last])
    in_envelope = has_motion & (x >= -ENVELOPE_OCTAVES * np.log(2.0)) & (acceleration > 0)
    slope = MIN_ENVELOPE_EXPONENT
    if in_envelope.sum() >= MIN_ENVELOPE_BINS:
        slope = max(
            slope, float(-np.polyfit(x[in_envelope], np.log(acceleration[in_envelope]), 1)[0])
        )
    level = float(np.mean(acceleration[in_envelope] * np.exp(slope * x[in_envelope])))
    silent = np.flatnonzero(x > lobe_octaves * np.log(2.0))[1:]
    if silent.size and level > 0:
        slope = float(
            np.clip(np.max(np.log(level / limit[silent]) / x[silent]), slope, MAX_ENVELOPE_EXPONENT)
        )
    envelope = np.exp(np.maximum(np.log(max(level, 1e-300)) - slope * np.maximum(x, 0.0), -690.0))
    return np.where(x > 0, envelope, acceleration)


def highest_frequency(chain: MeasuringChain, rate: float) -> tuple[float, str]:
    """Return the frequency at which the low-pass must be zero, Hz, and the reason."""
    return chain.highest_frequency(rate, MAX_STOP_OF_HALF_RATE * 0.5 * rate)


def choose_band(
    content: AccelerationSpectrum,
    rate: float,
    highest: float,
    *,
    low_edge: bool,
    known_from_hz: float = 0.0,
) -> PassBand:
    """Return the band with the smallest sum of noise and removed part.

    Args:
        content: spectra of the record.
        rate: samples per second.
        highest: frequency at which the low-pass must be zero, Hz.
        low_edge: whether a lower edge is needed, because the sensor has no response to constant
            acceleration, or its channel is not known there.
        known_from_hz: lowest frequency at which the channel is known.

    Raises:
        InputError: the record is too short for what is known of the channel.
    """
    lowest = max(MIN_EDGE_PERIODS * rate / content.samples, 2.0 * known_from_hz)
    if low_edge and 4.0 * lowest > highest:
        raise InputError(
            "No band of this record can be restored.",
            expected="a record many periods long, of a channel that is known over octaves",
            found=f"a lower edge of {lowest:.6g} Hz and an end at {highest:.6g} Hz",
            where="band",
            remedy="use a longer record, or state the known_response of [response] further",
        )
    high = _candidates(min(lowest, 0.25 * highest), 0.5 * highest)
    low = _candidates(lowest, max(0.25 * high[-1], lowest)) if low_edge else np.zeros(1)
    cost = (
        content.noise_deviation(low[:, None], high[None, :]) ** 2
        + content.removed(low[:, None], high[None, :]) ** 2
    )
    cost = np.where(2.0 * low[:, None] <= high[None, :], cost, np.inf)
    first, second = np.unravel_index(int(np.argmin(cost)), cost.shape)
    words = "least sum of noise and removed part"
    if second == high.size - 1:
        words = "widest that sampling rate and sensor allow"
    return PassBand(float(low[first]), float(high[second]), words)


def stated_band(
    band_hz: tuple[float, float],
    highest: float,
    why: str,
    *,
    low_edge: bool,
    known_from_hz: float = 0.0,
) -> PassBand:
    """Return the band that the user states.

    Raises:
        InputError: the band cannot be restored.
    """
    low, high = (float(edge) for edge in band_hz)
    reasonable = (
        np.isfinite([low, high]).all()
        and 0.0 <= low < high
        and 2.0 * high <= highest * (1.0 + 1e-9)
    )
    if not reasonable:
        raise InputError(
            "The band cannot be restored.",
            expected=(
                f"0 ≤ low < high ≤ {0.5 * highest:.6g} Hz (the low-pass falls over the octave "
                f"above high, and {why} ends it)"
            ),
            found=f"{low:g} to {high:g} Hz",
            where="band",
            remedy="narrow the band, or leave it to be chosen",
        )
    if low_edge and low == 0.0:
        raise InputError(
            "The band begins at zero, where the sensor has no response.",
            expected="a lower edge above zero, or a record that begins at rest",
            found="0 Hz, and a record that begins in the middle of a motion",
            where="band",
            remedy="give a lower edge, or a record with some samples before the motion",
        )
    if low < 2.0 * known_from_hz:
        raise InputError(
            "The band begins where the response of the channel is not known.",
            expected=f"a lower edge of {2.0 * known_from_hz:.6g} Hz or more (the band falls to "
            f"zero over the octave below, and the known response begins at {known_from_hz:.6g} Hz)",
            found=f"{low:g} Hz",
            where="band",
            remedy="give a higher edge, or state the known_response of [response] further down",
        )
    return PassBand(low, high, "stated by the user")


def _candidates(first: float, last: float) -> FloatArray:
    count = max(1, round(BINS_PER_OCTAVE * np.log2(max(last / first, 1.0)))) + 1
    return np.geomspace(first, last, count) if last > first else np.array([last])
