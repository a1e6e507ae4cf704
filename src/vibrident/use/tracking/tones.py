"""A known tone in recursive Fourier form: what the two channels have at its frequency, stretch by stretch.

Each stretch of some periods is fitted in both channels by the tone, its harmonics, a mean and a trend (IEEE Std
1057-2017), so that harmonics of sensor and drive do not count. The response less the model's, at the tone alone, is a
measurement of two numbers; its uncertainty is from its scatter between stretches, in which noise of the reference is
contained, and from the relative model error that the certificate states, which all stretches share.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.tones import HARMONICS
from vibrident.physics.models.slopes import response_and_slopes
from vibrident.use.tracking.network import Network

#: Periods and samples of a stretch, at least: mean, trend and tone are told apart.
PERIODS, SAMPLES = 2.0, 64
#: Highest harmonic's part of the sampling rate.
HIGHEST = 0.45


@dataclass(eq=False)
class Tone:
    """A run of one tone."""

    frequency_hz: float  # of the tone
    length: int  # samples of a stretch
    taken: int  # samples of the run so far
    amplitudes: list[tuple[complex, complex]]  # of reference and response of each stretch, complex, at the run's start

    @classmethod
    def of(cls, frequency_hz: float, interval_s: float) -> Tone:
        """Nothing taken yet."""
        return cls(frequency_hz, max(SAMPLES, int(np.ceil(PERIODS / frequency_hz / interval_s))), 0, [])

    def take(self, reference: FloatArray, response: FloatArray, interval_s: float) -> None:
        """A stretch, shape (length,) each; samples that are not numbers are left out."""
        turns = self.frequency_hz * interval_s
        good = np.isfinite(reference) & np.isfinite(response)
        t = self.taken + np.flatnonzero(good)
        self.taken += len(response)
        orders = np.arange(1, max(1, min(HARMONICS, int(HIGHEST / turns))) + 1)
        if len(t) < 4 * len(orders) + 4:
            return
        waves: ComplexArray = np.exp(2j * np.pi * turns * orders[:, None] * t)
        basis = np.vstack([waves.real, waves.imag, np.ones(len(t)), (t - t.mean()) / len(t)])
        found, _, rank, _ = np.linalg.lstsq(basis.T, np.column_stack([reference[good], response[good]]), rcond=None)
        if rank == len(basis):
            u, y = found[0] - 1j * found[len(orders)]
            self.amplitudes.append((complex(u), complex(y)))

    def rows(self, network: Network, point: FloatArray, model_error: float) -> tuple[FloatArray, float]:
        """The tone as two rows of unit variance, shape (2, P + 1), and the degrees of freedom of that variance.

        ``point``: coordinates of linearisation, shape (P,). No degree of freedom: it is not known.
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
