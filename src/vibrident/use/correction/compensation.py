"""Filter L(f)/H(f) on a whole record, with its response to noise and to the record's ends.

Where the sensor has no response to constant acceleration (a velocity pickup, a charge amplifier),
1/H has poles at frequency zero. A record that begins at rest is then integrated from its first
sample on, as many times as there are poles, and the rest of the inverse is regular; the trapezoidal
rule's own response is divided out, so the integral is that of the band-limited signal. Other
records keep a lower edge of the band.

Beyond its ends a record is continued: by rest if it is at rest, by its point reflection otherwise,
or by its mirror image where a lower edge would spread the step of the former. The
error of that continuation is a sum over the response's own samples, so its variance follows from
the response's autocovariance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import fft

from vibrident.base.fft_lengths import fast_length
from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.response.transform import line_counts
from vibrident.physics.models.slopes import ComplexArray
from vibrident.use.correction.band import PassBand
from vibrident.use.correction.chain import MeasuringChain
from vibrident.use.correction.quiet import Baseline, periodogram

#: Length of the filter's kernel on either side, in periods of the narrowest slope of L.
KERNEL_PERIODS = 8.0
POLE_TIME_CONSTANTS = 8.0  # of 1/H's poles that the kernel covers
EDGE_POINTS = 48  # instants near an end with a computed error of the continuation
MAX_NOISE_LAG_SAMPLES = 256  # of the noise's autocovariance
#: The response near an end is that within so many lengths of the continuation …
NEAR_END_LENGTHS = 2
MIN_NEAR_END_SAMPLES = 64  # … and at least so many samples
KERNEL_SHARE = 0.99  # part of the kernel's sum of magnitudes within its reach


@dataclass(frozen=True, eq=False)
class Compensation:
    """Compensation of one record."""

    chain: MeasuringChain  # whose response is inverted
    band: PassBand  # to restore
    rate: float  # samples per second
    samples: int  # of the record
    integrations: int  # from rest, before the filter: 0, 1 or 2
    baseline: Baseline  # where the record begins or ends at rest, it is continued by rest
    mirrored: bool = False  # continued by its mirror image, where it is not at rest

    @classmethod
    def from_baseline(
        cls, chain: MeasuringChain, band: PassBand, rate: float, samples: int, baseline: Baseline
    ) -> Compensation:
        """Return the compensation for a record with its baseline."""
        poles = max(chain.zeros_at_rest, 0) if band.low_hz == 0.0 else 0
        return cls(chain, band, rate, samples, poles, baseline)

    @cached_property
    def pad(self) -> int:
        """Return the number of samples by which the record is continued on either side."""
        slope = min(self.band.high_hz, 0.5 * self.band.low_hz or np.inf)
        reach = KERNEL_PERIODS * self.rate / slope + abs(self.chain.delay_s) * self.rate
        roots = self.chain.zeros
        if roots.size:  # the inverse rings at the zeros
            reach += POLE_TIME_CONSTANTS * self.rate / max(float(np.min(np.abs(roots.real))), 1e-9)
        return int(np.clip(np.ceil(reach), 16, self.samples - 1))

    @cached_property
    def size(self) -> int:
        """Return the length of the transform."""
        return fast_length(self.samples + 2 * self.pad)

    @cached_property
    def frequency_hz(self) -> FloatArray:
        """Return the frequencies of the transform's lines.

        The first is slightly above zero, where 1/H may have a pole.
        """
        frequency = np.array(fft.rfftfreq(self.size, 1.0 / self.rate), dtype=float)
        frequency[0] = 1e-6 * frequency[1]
        return frequency

    @cached_property
    def lowpass(self) -> FloatArray:
        """Return L at the lines."""
        return self.band.passed(self.frequency_hz)

    @cached_property
    def _within(self) -> BoolArray:
        return self.lowpass > 0.0

    @cached_property
    def total(self) -> ComplexArray:
        """Return L/H at the lines."""
        gain = np.zeros(self.frequency_hz.shape, dtype=complex)
        inside = self._within
        gain[inside] = self.lowpass[inside] / self.chain.frequency_response(
            self.frequency_hz[inside]
        )
        return gain

    @cached_property
    def rule(self) -> ComplexArray:
        """Return one over the response of the trapezoidal integrations, at the lines."""
        return (2j * self.rate * np.tan(np.pi * self.frequency_hz / self.rate)) ** self.integrations

    @cached_property
    def after_integration(self) -> ComplexArray:
        """Return L/H at the lines, divided by the response of the integrations."""
        return self.total * self.rule

    @cached_property
    def slopes(self) -> ComplexArray:
        """Return the derivative of ``after_integration`` by each parameter and effect: −G H'/H.

        Its shape is (parameters + effects, lines).
        """
        relative = self.chain.relative_slopes(self.frequency_hz[self._within])
        gain = np.zeros((len(relative), self.frequency_hz.size), dtype=complex)
        gain[:, self._within] = -self.after_integration[self._within] * relative
        return gain

    def with_better_ends(self, values: FloatArray) -> Compensation:
        """Return the compensation with the mirror image beyond the ends where its error is less.

        Only a lower edge spreads the step of a point reflection, which is that of the last sample,
        over the record. ``values``: the response without its offset.
        """
        if self.band.low_hz == 0.0:
            return self
        both = self, replace(self, mirrored=True)
        return min(both, key=lambda stretch: float(np.sum(stretch.end_deviation(values) ** 2)))

    def spectrum(self, values: FloatArray) -> ComplexArray:
        """Return the transform of the record, integrated and continued, shape (lines,).

        ``values``: the response without its offset.
        """
        for _ in range(self.integrations):
            values = (np.cumsum(values) - 0.5 * values) / self.rate
        return np.asarray(fft.rfft(self._continued(values), self.size))

    def restored(self, spectrum: ComplexArray, gain: ComplexArray | None = None) -> FloatArray:
        """Return the acceleration at the record's samples, shape (samples,).

        For rows of gains its shape is (rows, samples).
        """
        series = np.asarray(
            fft.irfft(
                spectrum * (self.after_integration if gain is None else gain), self.size, axis=-1
            )
        )
        return series[..., self.pad : self.pad + self.samples]

    def _continued(self, values: FloatArray) -> FloatArray:
        before = after = np.zeros(self.pad)
        about, sign = (0.0, 1.0) if self.mirrored else (2.0, -1.0)
        if not self.baseline.rest_samples:
            before = (about * values[0] + sign * values[self.pad : 0 : -1]) * self._taper[::-1]
        # the integral of a rest continues by reflection
        if not self.baseline.rests_at_end or self.integrations:
            after = (about * values[-1] + sign * values[-2 : -self.pad - 2 : -1]) * self._taper
        return np.concatenate([before, values, after])

    @cached_property
    def _taper(self) -> FloatArray:
        """Return a taper, shape (pad,): 1 next to the record, falling to 0 over the outer half."""
        x = np.clip(2.0 * np.arange(1, self.pad + 1) / self.pad - 1.0, 0.0, 1.0)
        return 0.5 + 0.5 * np.cos(np.pi * x)

    @cached_property
    def kernel(self) -> FloatArray:
        """Return the impulse response after the integrations, shape (size,).

        Its middle is at index 0, and it is circular.
        """
        return np.asarray(fft.irfft(self.after_integration, self.size))

    @cached_property
    def reach(self) -> int:
        """Return the number of samples on either side beyond which the kernel is negligible."""
        index = np.arange(self.size)
        folded = np.bincount(np.minimum(index, self.size - index), weights=np.abs(self.kernel))
        share = np.cumsum(folded) / np.sum(folded)
        return int(np.searchsorted(share, KERNEL_SHARE))

    def line_mean(self, power: FloatArray) -> float:
        """Return the mean over all frequencies, both signs, of a power at the lines."""
        return float(np.sum(power * line_counts(self.size)) / self.size)

    @cached_property
    def noise_deviation(self) -> FloatArray:
        """Return the standard deviation of the noise in the acceleration, shape (samples,).

        It is constant for a plain filter, and grows from the first sample on where the response is
        integrated.
        """
        power = self.baseline.noise(self.frequency_hz)
        if self.integrations == 0:
            return np.full(self.samples, np.sqrt(self.line_mean(np.abs(self.total) ** 2 * power)))
        impulse = np.zeros(self.samples)
        impulse[0] = 1.0
        impulse_response = np.asarray(
            fft.irfft(self.spectrum(impulse) * self.after_integration, self.size)
        )
        kernel = impulse_response[
            : self.pad + self.samples
        ]  # from pad samples before the impulse on
        reach = min(MAX_NOISE_LAG_SAMPLES, (self.size - 1) // 2)
        colour = np.roll(np.asarray(fft.irfft(np.sqrt(power), self.size)), reach)[: 2 * reach + 1]
        coloured = _convolved(kernel, colour) if np.ptp(power) > 0 else kernel * np.sqrt(power[0])
        return np.sqrt(np.cumsum(coloured**2)[self.pad :])

    def end_deviation(self, values: FloatArray) -> FloatArray:
        """Return the standard deviation of the continuation's error, shape (samples,).

        ``values``: the response without its offset.
        """
        total = np.zeros(self.samples)
        rests = self.baseline.rest_samples > 0, self.baseline.rests_at_end
        if all(rests):
            return total
        covariance = self._autocovariance(values)
        length = max(NEAR_END_LENGTHS * self.pad, MIN_NEAR_END_SAMPLES)
        for at_left, at_rest in zip((True, False), rests, strict=True):
            if not at_rest:
                side = self._edge(covariance, at_left=at_left)
                if not self.integrations:
                    # The response near the end may be faster than the rest of the record.
                    near = values[:length] if at_left else values[-length:]
                    side = np.maximum(side, self._edge(self._autocovariance(near), at_left=at_left))
                inwards = total if at_left else total[::-1]
                inwards[: side.size] += side[: self.samples]
        return np.sqrt(total)

    def _autocovariance(self, values: FloatArray) -> FloatArray:
        """Return the autocovariance of the filter's input, lags 0 … 2 pad.

        The input is the response or, formally, its integrals.
        """
        window = np.hanning(values.size) if self.integrations else np.ones(values.size)
        size = fast_length(values.size + 2 * self.pad + 1)
        power = periodogram(values, window, size)
        if self.integrations:
            power[0] = 0.0
            power[1:] /= (2.0 * self.rate * np.sin(np.pi * np.arange(1, power.size) / size)) ** (
                2 * self.integrations
            )
        return np.asarray(fft.irfft(power, size))[: 2 * self.pad + 1]

    def _edge(self, covariance: FloatArray, *, at_left: bool) -> FloatArray:
        """Return the variance of the continuation's error from an end inwards, shape (pad,)."""
        kernel = self.kernel if at_left else np.concatenate([self.kernel[:1], self.kernel[:0:-1]])
        pad = self.pad
        # An integral drifts; only its second difference, without the taper, has a variance.
        taper = np.ones(pad) if self.integrations else self._taper
        size = fast_length(4 * pad + 2)
        circular = np.zeros(size)
        circular[: 2 * pad + 1] = covariance
        circular[-2 * pad :] = covariance[:0:-1]
        weight = np.maximum(np.real(np.asarray(fft.rfft(circular))), 0.0) * line_counts(size)
        steps = np.unique(np.concatenate([[0], np.geomspace(1, pad, EDGE_POINTS).astype(int)]))
        computed = steps[steps < pad]
        beyond = np.arange(1, pad + 1)
        variances = []
        for step in computed:
            taps = np.where(
                step + beyond < self.size // 2, kernel[(step + beyond) % self.size], 0.0
            )
            weights = np.zeros(2 * pad + 1)  # of the true samples −pad … pad about the end
            weights[pad - beyond] = taps
            weights[pad + beyond] = taps * taper * (-1.0 if self.mirrored else 1.0)
            weights[pad] = 0.0 if self.mirrored else -2.0 * np.sum(taps * taper)
            power = np.abs(np.asarray(fft.rfft(weights, size))) ** 2
            variances.append(float(np.sum(power * weight)) / size)
        return np.interp(np.arange(pad), computed, variances)


def _convolved(values: FloatArray, kernel: FloatArray) -> FloatArray:
    """Convolve values with a kernel of odd length, its middle at each sample.

    The result has the shape of ``values``.
    """
    length = len(values) + len(kernel) - 1
    size = fast_length(length)
    product = np.asarray(fft.rfft(values, size)) * np.asarray(fft.rfft(kernel, size))
    return np.asarray(fft.irfft(product, size))[len(kernel) // 2 :][: len(values)]
