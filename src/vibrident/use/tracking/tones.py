"""A known tone, fitted stretch by stretch: the amplitudes of both channels at its frequency.

Each stretch of some periods is fitted in both channels by the tone, its harmonics, a mean and a
trend (IEEE Std 1057-2017), so that harmonics of sensor and drive do not count. The response less
the model's, at the tone alone, is a measurement of two numbers; its uncertainty is from its scatter
between stretches, which contains the noise of the reference, and from the relative model error
that the certificate states, which all stretches share.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.tones import HARMONICS
from vibrident.physics.models.slopes import response_and_slopes
from vibrident.use.tracking.network import SensorNetwork

#: A stretch of this length tells mean, trend and tone apart.
MIN_STRETCH_PERIODS = 2.0
MIN_STRETCH_SAMPLES = 64
#: Frequency of the highest harmonic, as a part of the sampling rate.
MAX_HARMONIC_OF_RATE = 0.45


@dataclass(eq=False)
class Tone:
    """A run of one tone."""

    frequency_hz: float  # of the tone
    length: int  # samples of a stretch
    samples: int  # of the run so far
    # complex amplitudes of reference and response, one pair a stretch, referred to the run's start
    amplitudes: list[tuple[complex, complex]]

    @classmethod
    def from_frequency(cls, frequency_hz: float, interval_s: float) -> Tone:
        """Return a tone without samples."""
        periods = int(np.ceil(MIN_STRETCH_PERIODS / frequency_hz / interval_s))
        return cls(frequency_hz, max(MIN_STRETCH_SAMPLES, periods), 0, [])

    def take(self, reference: FloatArray, response: FloatArray, interval_s: float) -> None:
        """Fit a stretch, shape (length,) each; samples that are not numbers are left out."""
        turns = self.frequency_hz * interval_s
        good = np.isfinite(reference) & np.isfinite(response)
        t = self.samples + np.flatnonzero(good)
        self.samples += len(response)
        orders = np.arange(1, max(1, min(HARMONICS, int(MAX_HARMONIC_OF_RATE / turns))) + 1)
        if len(t) < 4 * len(orders) + 4:
            return
        waves: ComplexArray = np.exp(2j * np.pi * turns * orders[:, None] * t)
        basis = np.vstack([waves.real, waves.imag, np.ones(len(t)), (t - t.mean()) / len(t)])
        coefficients, _, rank, _ = np.linalg.lstsq(
            basis.T, np.column_stack([reference[good], response[good]]), rcond=None
        )
        if rank == len(basis):
            u, y = coefficients[0] - 1j * coefficients[len(orders)]
            self.amplitudes.append((complex(u), complex(y)))

    def rows(
        self, network: SensorNetwork, point: FloatArray, model_error: float
    ) -> tuple[FloatArray, float]:
        """Return the tone as two rows of unit variance, and that variance's degrees of freedom.

        The rows have shape (2, P + 1); ``point`` holds the coordinates of linearisation, shape
        (P,). Zero degrees of freedom: the variance is not known.
        """
        u, y = np.array(self.amplitudes, dtype=complex).reshape(-1, 2).T
        freedom = 2.0 * (len(y) - 1)
        values = dict(zip(network.model.parameter_names, point * network.scale, strict=True))
        frequency = np.array([self.frequency_hz])
        response, slopes = response_and_slopes(network.model, values, frequency, network.quantity)
        off = y - response[0] * u
        if not (freedom > 0.0 and np.any(off != off[0])):
            return np.zeros((2, len(point) + 1)), 0.0
        row: ComplexArray = np.append(slopes[:, 0] * network.scale * u.mean(), off.mean())
        scatter = np.sum(np.abs(off - off.mean()) ** 2) / freedom / len(y)
        variance = scatter + (model_error * abs(response[0] * u.mean())) ** 2
        return np.array([row.real, row.imag]) / np.sqrt(variance), freedom
