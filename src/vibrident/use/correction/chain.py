"""Sensor with its recording channel, as a correction inverts it: response, slopes, covariance."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vibrident.data.effects import SystematicEffect
from vibrident.data.known import KnownResponse, RationalResponse
from vibrident.data.known.unsure import change_by
from vibrident.data.records import FloatArray
from vibrident.physics.models.slopes import ComplexArray
from vibrident.result.sensor import IdentifiedSensor

#: End of the low-pass, in units of the first zero of an averaging window.
MAX_STOP_OF_WINDOW_ZERO = 0.9
#: A channel that passes less than this part of its largest response has reached a zero.
MIN_PASSED = 1e-3
ZERO_SEARCH_POINTS = 4096


@dataclass(frozen=True, eq=False)
class MeasuringChain:
    """A sensor, and the known response of the channel that records it.

    Attributes:
        sensor: as identified.
        channel: its recording channel's response; None where the records are the sensor's output.
    """

    sensor: IdentifiedSensor
    channel: KnownResponse | None = None

    def frequency_response(self, frequency_hz: FloatArray) -> ComplexArray:
        """Return what the record holds per acceleration (or drive), shape (points,)."""
        value = self.sensor.frequency_response(frequency_hz)
        return value if self.channel is None else value * self.channel.value(frequency_hz)

    def relative_slopes(self, frequency_hz: FloatArray) -> ComplexArray:
        """Return ∂log response/∂(parameter, then effect of the channel), shape (q, points)."""
        response = self.sensor.frequency_response(frequency_hz)
        slopes = self.sensor.slopes(frequency_hz) / response
        changes = [change_by(effect, frequency_hz) for effect in self._effects]
        return np.concatenate([slopes, changes]) if changes else slopes

    @cached_property
    def covariance(self) -> FloatArray:
        """Return the covariance of the parameters and of the channel's effects, shape (q, q)."""
        count = len(self.sensor.covariance)
        covariance = np.eye(count + len(self._effects))
        covariance[:count, :count] = self.sensor.covariance
        return covariance

    @property
    def _effects(self) -> tuple[SystematicEffect, ...]:
        return () if self.channel is None else self.channel.effects

    @property
    def zeros_at_rest(self) -> int:
        """Return the number of zeros at frequency zero of the response to acceleration."""
        return self.sensor.zeros_at_rest + sum(
            int(np.sum(shape.zeros == 0.0)) - int(np.sum(shape.poles == 0.0))
            for shape in self._rational
        )

    @property
    def delay_s(self) -> float:
        """Return the delay of sensor and channel."""
        delay_s = float(self.sensor.model.delay_s(self.sensor.values))
        return delay_s + sum(shape.delay_s for shape in self._rational)

    @property
    def zeros(self) -> ComplexArray:
        """Return the zeros of sensor and channel, rad/s, at which the inverse rings."""
        rational = self.sensor.model.rational(self.sensor.values)
        numerator = np.trim_zeros(np.array(rational.numerator, dtype=float), "f")
        roots = [np.roots(numerator[::-1])] if numerator.size > 1 else []
        roots += [shape.zeros[shape.zeros != 0.0] for shape in self._rational]
        return np.concatenate([np.zeros(0, dtype=complex), *roots])

    @property
    def _rational(self) -> list[RationalResponse]:
        shapes = () if self.channel is None else self.channel.shapes
        return [shape for shape in shapes if isinstance(shape, RationalResponse)]

    @property
    def known_from_hz(self) -> float:
        """Return the lowest frequency at which the channel is known; 0 where it is at rest."""
        return 0.0 if self.channel is None else self.channel.band_hz[0]

    def highest_frequency(self, rate_hz: float, last_hz: float) -> tuple[float, str]:
        """Return the frequency at which the low-pass must be zero, Hz, and the reason.

        Args:
            rate_hz: sampling rate.
            last_hz: that of the sampling alone.
        """
        why = "half the sampling rate"
        values = self.sensor.values
        length_s = max((values[name] for name in self.sensor.model.windows), default=0.0)
        if length_s and MAX_STOP_OF_WINDOW_ZERO / length_s < last_hz:
            last_hz = MAX_STOP_OF_WINDOW_ZERO / length_s
            why = "the first zero of the averaging window"
        if self.channel is None:
            return last_hz, why
        top_hz = min(self.channel.band_hz[1], 0.5 * rate_hz)
        at = np.linspace(max(self.known_from_hz, 1e-6 * top_hz), top_hz, ZERO_SEARCH_POINTS)
        passed = np.abs(self.channel.value(at))
        top = int(np.argmax(passed))
        lost = np.flatnonzero(passed[top:] < MIN_PASSED * passed[top])
        end_hz = float(at[top + lost[0]]) if lost.size else self.channel.band_hz[1]
        if end_hz < last_hz:
            return end_hz, "the known response of the channel"
        return last_hz, why
