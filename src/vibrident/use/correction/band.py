"""The band to restore: a balance of what the low-pass removes and the noise that the inverse amplifies.

The compensation is L(f)/H(f), with L real: one within the band, falling to zero over the octave above it (and over the
octave below it, if the sensor has no response to constant acceleration). Following Eichstädt et al. (Metrologia 47,
2010; 53, 2016) the error of a compensation is bounded by the input's spectrum where L is below one,

    |Δa(t)| ≤ 2 ∫ (1 − L) |A(f)| df,

with A from the record's own spectrum where it stands above the noise, and an envelope falling by a power of the
frequency beyond.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft

from vibrident.base.errors import InputError
from vibrident.data.records import BoolArray, FloatArray
from vibrident.result.sensor import IdentifiedSensor
from vibrident.use.correction.quiet import Surroundings, periodogram

BINS = 12  # spectral bins and candidate bands, an octave
HEARD = 6.0  # a bin holds motion if its power exceeds the noise by this many standard deviations of the bin's mean
LEAST_SLOPE = 2.0  # least exponent of the falling envelope of |A|² (a pulse with steps)
STEEPEST = 200.0  # largest exponent
SHOWN_OCTAVES = 1.5  # octaves below the last bin with motion that determine the exponent
LOBE_OCTAVES = 0.5  # a pulse's spectrum rises again so many octaves beyond a zero
FEWEST_SHOWN = 6  # fewest bins with motion in them
TAPER = 0.05  # part of a record in which its window rises from zero, and falls to it again
LAST_OF_HALF = 0.98  # end of the low-pass over half the sampling rate, at most
LAST_OF_ZERO = 0.9  # end of the low-pass over the first zero of an averaging window, at most
PERIODS = 4.0  # fewest periods of the lower edge, and of the upper, in a record


@dataclass(frozen=True)
class Band:
    """The band that the compensation passes."""

    low_hz: float  # L = 1 from here; zero if L passes constant acceleration. L = 0 below low_hz/2.
    high_hz: float  # L = 1 up to here; L = 0 from 2 high_hz
    chosen: str  # how it was chosen, in words

    @property
    def stop_hz(self) -> float:
        """Frequency from which L is zero."""
        return 2.0 * self.high_hz

    def passed(self, frequency_hz: FloatArray) -> FloatArray:
        """L at the frequencies."""
        return passed(frequency_hz, self.low_hz, self.high_hz)


def passed(frequency_hz: FloatArray, low_hz: float | FloatArray, high_hz: float | FloatArray) -> FloatArray:
    """L of a band; broadcasts. Its slopes have two continuous derivatives, so its kernel falls quickly."""
    upper = _step(2.0 - frequency_hz / high_hz)
    low = np.asarray(low_hz)
    return upper * np.where(low > 0, _step(2.0 * frequency_hz / np.where(low > 0, low, 1.0) - 1.0), 1.0)


def _step(x: FloatArray) -> FloatArray:
    x = np.clip(x, 0.0, 1.0)
    return x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)


@dataclass(frozen=True, eq=False)
class Content:
    """Acceleration and noise of a record in bins of frequency; powers as in ``quiet``."""

    frequency_hz: FloatArray  # of the bins, shape (bins,)
    lines: FloatArray  # two-sided spectral lines in each, over the number of samples: Σ lines · power is a mean square
    acceleration: FloatArray  # power of the acceleration, the noise subtracted, shape (bins,)
    noise: FloatArray  # power of the noise after the inverse 1/H, shape (bins,)
    samples: int  # of the record
    event: float  # part of the record with motion
    heard: BoolArray  # bins with motion, shape (bins,)

    def noise_deviation(self, low: FloatArray, high: FloatArray) -> FloatArray:
        """Standard deviation of the noise that bands pass, m/s²; low and high broadcast against one another."""
        gain = passed(self.frequency_hz, np.asarray(low)[..., None], np.asarray(high)[..., None]) ** 2
        return np.sqrt(np.sum(gain * self.noise * self.lines, axis=-1))

    def removed(self, low: FloatArray, high: FloatArray) -> FloatArray:
        """Rms of the removed acceleration during the motion, m/s²."""
        gain = (1.0 - passed(self.frequency_hz, np.asarray(low)[..., None], np.asarray(high)[..., None])) ** 2
        return np.sqrt(np.sum(gain * self.acceleration * self.lines, axis=-1) / self.event)

    def bound(self, band: Band) -> float:
        """Upper bound of the removed acceleration, m/s²."""
        amplitude = np.sqrt(np.maximum(self.acceleration, 0.0) * self.samples)
        return float(np.sum((1.0 - band.passed(self.frequency_hz)) * amplitude * self.lines))

    def ratio(self, band: Band) -> float:
        """Rms of what the low-pass removes over that of what it keeps in its highest octave."""
        weights = self.acceleration * self.lines
        removed = 1.0 - passed(self.frequency_hz, 0.0, band.high_hz)
        kept = top_octave(self.frequency_hz, band)
        return float(np.sqrt(np.sum(removed**2 * weights) / max(np.sum(kept**2 * weights), np.finfo(float).tiny)))


def top_octave(frequency_hz: FloatArray, band: Band) -> FloatArray:
    """Gain that selects the highest octave of the band."""
    return band.passed(frequency_hz) - passed(frequency_hz, band.low_hz, 0.5 * band.high_hz)


def event_of(values: FloatArray) -> float:
    """Part of a record with motion: 1 for a sine, the duration of a shock over the record's length."""
    squares = values**2
    fourth = float(np.mean(squares**2))
    return float(np.clip(1.5 * np.mean(squares) ** 2 / fourth, 2.0 / values.size, 1.0)) if fourth > 0 else 1.0


def content(
    values: FloatArray, rate: float, sensor: IdentifiedSensor, around: Surroundings, event: float, highest: float
) -> Content:
    """Spectra of a record's acceleration and noise.

    ``values``: response without its offset, shape (samples,); ``event``: part of the record with motion, 0 to 1;
    ``highest``: highest frequency used, Hz.
    """
    count = values.size
    transient = around.rest_samples > 0 and around.rests_at_end
    window = np.ones(count) if transient else np.hanning(count)
    power = periodogram(values, window)
    if not transient:  # the last of a sweep is as fast as nothing before, and a window that falls so slowly hides it
        upper = np.cumsum(power) > 0.5 * np.sum(power)
        power[upper] = np.maximum(power[upper], periodogram(values, _tapered(count))[upper])
    frequency = np.array(fft.rfftfreq(count, 1.0 / rate), dtype=np.float64)
    used = (frequency > 0) & (frequency <= highest)
    frequency, power = frequency[used], power[used]
    inverse = 1.0 / np.abs(sensor.frequency_response(frequency)) ** 2
    noise = around.noise(frequency)
    number = np.floor(BINS * np.log2(frequency / frequency[0])).astype(int)
    _, number, size = np.unique(number, return_inverse=True, return_counts=True)

    def mean(line: FloatArray) -> FloatArray:
        return np.bincount(number, weights=line) / size

    centre, level = mean(frequency), mean(noise)
    spread = (1.0 if transient else 1.94) / size + around.spread
    heard = mean(power) > level * (1.0 + HEARD * np.sqrt(spread))
    acceleration = np.maximum(mean((power - noise) * inverse), 0.0)
    limit = level * mean(inverse) * (1.0 + HEARD * np.sqrt(spread))
    acceleration = _with_envelope(centre, acceleration, heard, limit, LOBE_OCTAVES if transient else 0.0)
    lines = 2.0 * size / count
    return Content(centre, lines, acceleration, mean(noise * inverse), count, event, heard)


def _tapered(count: int) -> FloatArray:
    """A window that falls to zero near the ends only."""
    ramp = np.hanning(2 * max(round(TAPER * count), 1))
    half = ramp.size // 2
    return np.concatenate([ramp[:half], np.ones(count - ramp.size), ramp[half:]])


def _with_envelope(
    frequency: FloatArray, acceleration: FloatArray, heard: BoolArray, limit: FloatArray, lobe_octaves: float
) -> FloatArray:
    """The power with an envelope beyond the last bin with motion: the slope of the octave before, or steeper by
    ``limit``.

    A shock's spectrum falls below the noise, and its envelope continues there. A tone, or random motion with an edge,
    ends: with a flatter envelope the bins beyond would show motion (``limit``). A pulse's spectrum has zeros, though,
    and rises again within ``lobe_octaves``: silence counts from there.
    """
    if not heard.any():
        return np.zeros_like(acceleration)
    last = int(np.flatnonzero(heard)[-1])
    x = np.log(frequency / frequency[last])
    shown = heard & (x >= -SHOWN_OCTAVES * np.log(2.0)) & (acceleration > 0)
    slope = LEAST_SLOPE
    if shown.sum() >= FEWEST_SHOWN:
        slope = max(slope, float(-np.polyfit(x[shown], np.log(acceleration[shown]), 1)[0]))
    level = float(np.mean(acceleration[shown] * np.exp(slope * x[shown])))
    silent = np.flatnonzero(x > lobe_octaves * np.log(2.0))[1:]
    if silent.size and level > 0:
        slope = float(np.clip(np.max(np.log(level / limit[silent]) / x[silent]), slope, STEEPEST))
    envelope = np.exp(np.maximum(np.log(max(level, 1e-300)) - slope * np.maximum(x, 0.0), -690.0))
    return np.where(x > 0, envelope, acceleration)


def highest_frequency(sensor: IdentifiedSensor, rate: float) -> tuple[float, str]:
    """Frequency at which the low-pass must be zero, Hz, and why."""
    last, why = LAST_OF_HALF * 0.5 * rate, "half the sampling rate"
    length = max((sensor.values[name] for name in sensor.model.windows), default=0.0)
    if length and LAST_OF_ZERO / length < last:
        last, why = LAST_OF_ZERO / length, "the first zero of the averaging window"
    return last, why


def choose(found: Content, rate: float, highest: float, *, low_edge: bool) -> Band:
    """The band with the least sum of noise and removed part.

    ``found``: spectra of the record; ``highest``: frequency at which the low-pass must be zero, Hz; ``low_edge``:
    whether a lower edge is needed, because the sensor has no response to constant acceleration.
    """
    least = PERIODS * rate / found.samples
    high = _candidates(min(least, 0.25 * highest), 0.5 * highest)
    low = _candidates(least, max(0.25 * high[-1], least)) if low_edge else np.zeros(1)
    cost = found.noise_deviation(low[:, None], high[None, :]) ** 2 + found.removed(low[:, None], high[None, :]) ** 2
    cost = np.where(2.0 * low[:, None] <= high[None, :], cost, np.inf)
    first, second = np.unravel_index(int(np.argmin(cost)), cost.shape)
    words = "least sum of noise and removed part"
    if second == high.size - 1:
        words = "widest that sampling rate and sensor allow"
    return Band(float(low[first]), float(high[second]), words)


def stated(band_hz: tuple[float, float], highest: float, why: str, *, low_edge: bool) -> Band:
    """The band that the user asks for."""
    low, high = (float(edge) for edge in band_hz)
    reasonable = np.isfinite([low, high]).all() and 0.0 <= low < high and 2.0 * high <= highest * (1.0 + 1e-9)
    if not reasonable:
        raise InputError(
            "The band cannot be restored.",
            expected=f"0 ≤ low < high ≤ {0.5 * highest:.6g} Hz (the low-pass falls over the octave above high, and "
            f"{why} ends it)",
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
    return Band(low, high, "stated by the user")


def _candidates(first: float, last: float) -> FloatArray:
    count = max(1, round(BINS * np.log2(max(last / first, 1.0)))) + 1
    return np.geomspace(first, last, count) if last > first else np.array([last])
