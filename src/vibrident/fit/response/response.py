"""The nonparametric response: complex amplitudes of both channels, and the noise beside them."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.response.level import level_at_tone, levels

#: Smallest deviation over the amplitude: interpolation between samples is not better.
MIN_RELATIVE_DEVIATION = 1e-7

ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class MeasuredResponse:
    """Complex amplitudes of both channels at n excited frequencies, with K noise lines beside each.

    The lines are scaled so that the mean of |line|² is the variance of the real (and of the
    imaginary) part of the amplitude beside it. Kept for both channels and at their own frequencies,
    they give the variance of Y − H X for any model H, whether the noise is vibration of the sensor
    (it then cancels) or of one channel (it does not).

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
        distortion: rms of harmonics 2… over the fundamental, of both channels, shape (n, 2).
        rounding: variance of the real part of X and of Y by a converter's errors that return from
            period to period, so that no line shows them, shape (n, 2); None for none.
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
    rounding: FloatArray | None = None

    @property
    def points(self) -> int:
        """Return the number of excited frequencies n."""
        return int(self.frequency_hz.shape[0])

    def at(self, points: BoolArray) -> MeasuredResponse:
        """Return the points at which ``points``, shape (n,), is true."""
        columns: dict[str, Any] = {}
        for field in fields(self):
            values = getattr(self, field.name)
            columns[field.name] = None if values is None else values[points]
        return MeasuredResponse(**columns)

    @property
    def ratio(self) -> ComplexArray:
        """Return the measured complex sensitivity Y/X, shape (n,)."""
        return self.response / self.reference

    def error_deviation(
        self, model: Callable[[FloatArray], ComplexArray] | None = None
    ) -> FloatArray:
        """Return the standard deviation of the real part of Y − H X, shape (n,).

        Args:
            model: complex sensitivity H at frequencies in Hz; None takes the measured ratio at each
                point, which is right where H hardly changes between a tone and its noise lines.
        """
        h_at_tone = self.ratio if model is None else model(self.frequency_hz)
        if model is None:
            ratio = self.line_hz / self.frequency_hz[:, None]
            error = np.abs(self.line_response - h_at_tone[:, None] * self.line_reference) ** 2
            _, variance = levels(error, ratio, self.line_weight)
        else:
            variance = self._variance_beside(h_at_tone, model)
        if self.rounding is not None:
            variance = variance + self.rounding[:, 1] + np.abs(h_at_tone) ** 2 * self.rounding[:, 0]
        floor = (MIN_RELATIVE_DEVIATION * np.abs(self.response)) ** 2 + np.finfo(float).tiny
        return np.sqrt(np.maximum(variance, floor))

    def _variance_beside(
        self, h_at_tone: ComplexArray, model: Callable[[FloatArray], ComplexArray]
    ) -> FloatArray:
        """Return the variance of Y − H X by the lines, once for each H; shape (n,)."""
        h = model(self.line_hz.ravel()).reshape(self.line_hz.shape)
        key = h_at_tone.tobytes() + h.tobytes()
        if key not in self._variances:
            ratio = self.line_hz / self.frequency_hz[:, None]
            lines = (self.line_reference, self.line_response)
            self._variances[key] = level_at_tone(
                lines, self._levels_of_channels, h, h_at_tone, ratio, self.line_weight
            )
        return self._variances[key]

    @functools.cached_property
    def _variances(self) -> dict[bytes, FloatArray]:
        """Return the variances of Y − H X that were computed, by the bytes of H."""
        return {}

    @functools.cached_property
    def _levels_of_channels(self) -> list[tuple[FloatArray, FloatArray]]:
        """Return the level of the noise of each channel, at the lines and at the tones."""
        ratio = np.tile(self.line_hz / self.frequency_hz[:, None], (2, 1))
        power = np.abs(np.concatenate([self.line_reference, self.line_response])) ** 2
        at_lines, at_tones = levels(power, ratio, np.tile(self.line_weight, (2, 1)))
        return list(zip(np.split(at_lines, 2), np.split(at_tones, 2), strict=True))

    @staticmethod
    def join(responses: Sequence[MeasuredResponse]) -> MeasuredResponse:
        """Return all points of several measurements, in order."""
        columns: dict[str, NDArray[Any]] = {}
        for field in fields(MeasuredResponse):
            parts = [getattr(response, field.name) for response in responses]
            if field.name == "rounding":
                parts = [
                    np.zeros((response.points, 2)) if part is None else part
                    for response, part in zip(responses, parts, strict=True)
                ]
            if field.name.startswith("line_"):
                columns[field.name] = _padded(parts, 1.0 if field.name == "line_hz" else 0.0)
            else:
                columns[field.name] = np.concatenate(parts)
        return MeasuredResponse(**columns)


def _padded(parts: Sequence[NDArray[Any]], fill: float) -> NDArray[Any]:
    """Return rows of several widths below each other, filled up to the largest."""
    width = max(part.shape[1] for part in parts)
    padded = np.full((sum(map(len, parts)), width), fill, dtype=parts[0].dtype)
    begin = 0
    for part in parts:
        padded[begin : begin + len(part), : part.shape[1]] = part
        begin += len(part)
    return padded
