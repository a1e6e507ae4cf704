"""The nonparametric response: complex amplitudes of both channels at each excited frequency, and the noise there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vibrident.records import FloatArray

#: No deviation below this part of the amplitude is believed: interpolation between samples is no better than that.
LEAST_DEVIATION = 1e-7
#: Lines count by their distance from the tone, a normal curve of this width in the logarithm of frequency.
NEAR = 0.7
#: The logarithm of a periodogram line has mean ln(level) − 0.577 and this deviation (correlated in neighbours).
LOG_BIAS, LOG_DEVIATION = 0.5772156649, 1.2825 * 1.394
#: A slope counts beyond this many standard deviations.
SIGNIFICANT = 4.0

ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class MeasuredResponse:
    """What n excited frequencies say, each beside K neighbouring spectral lines that hold only noise.

    The lines are scaled so that the mean of |line|² is the variance of the real (and of the imaginary) part of the
    amplitude beside it. Kept for both channels and at their own frequencies, they give the variance of Y − H X for
    any model H, whether the noise was felt by the sensor (it then cancels) or belongs to one channel (it does not).

    Attributes:
        frequency_hz: shape (n,).
        reference: complex amplitudes X, SI unit of the reference quantity, shape (n,).
        response: complex amplitudes Y, response unit, shape (n,).
        line_hz: frequencies of the noise lines, shape (n, K).
        line_reference: shape (n, K).
        line_response: shape (n, K).
        line_weight: one for a line that exists, zero for padding, shape (n, K).
        degrees_of_freedom: of each variance estimate, shape (n,).
        record: index of the record of each point, shape (n,).
        distortion: harmonic distortion of both channels, (n, 2): rms of harmonics 2… over the fundamental.
    """

    frequency_hz: FloatArray
    reference: ComplexArray
    response: ComplexArray
    line_hz: FloatArray
    line_reference: ComplexArray
    line_response: ComplexArray
    line_weight: FloatArray
    degrees_of_freedom: FloatArray
    record: NDArray[np.int64]
    distortion: FloatArray

    @property
    def points(self) -> int:
        """Number of excited frequencies n."""
        return int(self.frequency_hz.shape[0])

    @property
    def ratio(self) -> ComplexArray:
        """Measured complex sensitivity Y/X, shape (n,)."""
        return self.response / self.reference

    def error_deviation(self, model: Callable[[FloatArray], ComplexArray] | None = None) -> FloatArray:
        """Standard deviation of the real part of Y − H X, shape (n,).

        Args:
            model: complex sensitivity H at frequencies; None takes the measured ratio at each point, which is right
                where H hardly changes between a tone and its noise lines.
        """
        h = self.ratio[:, None] if model is None else model(self.line_hz.ravel()).reshape(self.line_hz.shape)
        error = np.abs(self.line_response - h * self.line_reference) ** 2
        variance = _level_at_tone(error, self.line_hz / self.frequency_hz[:, None], self.line_weight)
        floor = (LEAST_DEVIATION * np.abs(self.response)) ** 2 + np.finfo(float).tiny
        return np.sqrt(np.maximum(variance, floor))

    @staticmethod
    def join(parts: Sequence[MeasuredResponse]) -> MeasuredResponse:
        """All points of several measurements, in order."""
        width = max(p.line_hz.shape[1] for p in parts)

        def padded(array: NDArray, fill: float) -> NDArray:
            return np.pad(array, ((0, 0), (0, width - array.shape[1])), constant_values=fill)

        return MeasuredResponse(
            np.concatenate([p.frequency_hz for p in parts]),
            np.concatenate([p.reference for p in parts]),
            np.concatenate([p.response for p in parts]),
            np.concatenate([padded(p.line_hz, 1.0) for p in parts]),
            np.concatenate([padded(p.line_reference, 0.0) for p in parts]),
            np.concatenate([padded(p.line_response, 0.0) for p in parts]),
            np.concatenate([padded(p.line_weight, 0.0) for p in parts]),
            np.concatenate([p.degrees_of_freedom for p in parts]),
            np.concatenate([p.record for p in parts]),
            np.concatenate([p.distortion for p in parts]),
        )


def _level_at_tone(power: FloatArray, ratio: FloatArray, weight: FloatArray) -> FloatArray:
    """Noise power at the tone from that of the lines around it, shape (n,).

    The mean, where the lines are level. Where they fall or rise with frequency beyond doubt (1/f noise, the foot of
    mains hum), the power law through the lines near the tone, by regression of their logarithms.

    Args:
        power: |line|², shape (n, K).
        ratio: frequency of each line over the tone's, shape (n, K).
        weight: one for a line, zero for padding, shape (n, K).
    """
    mean = np.sum(weight * power, axis=1) / np.sum(weight, axis=1)
    x = np.log(np.maximum(ratio, 1e-6))
    p = np.log(np.maximum(power, 1e-300))
    near = weight * np.exp(-0.5 * (x / NEAR) ** 2) * (power > 0)
    total = np.maximum(np.sum(near, axis=1), 1e-300)
    x_mean, p_mean = np.sum(near * x, axis=1) / total, np.sum(near * p, axis=1) / total
    dx = x - x_mean[:, None]
    spread = np.maximum(np.sum(near * dx**2, axis=1), 1e-300)
    slope = np.sum(near * dx * (p - p_mean[:, None]), axis=1) / spread
    doubt = LOG_DEVIATION * np.sqrt(np.sum((near * dx) ** 2, axis=1)) / spread
    sloped = np.abs(slope) > SIGNIFICANT * doubt
    return np.where(sloped, np.exp(p_mean - slope * x_mean + LOG_BIAS), mean)
