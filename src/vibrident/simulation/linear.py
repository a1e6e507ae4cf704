"""The sensor as a linear system in NumPy: companion state space, response to tones, exact motion between instants.

Independent of ``vibrident.models.state_space``, which the estimators use: truth and estimate share only the transfer
function.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from vibrident.errors import ModelError
from vibrident.models.base import Rational
from vibrident.records import FloatArray
from vibrident.simulation.checks import require
from vibrident.simulation.grid import SampleGrid
from vibrident.simulation.tones import ComplexArray

_PARALLEL = 100.0  # largest condition number of the eigenvectors that are used


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """ẋ = A x + b a,  y = c x + d a; the states are x, ẋ/w, ẍ/w², … in units of the angular scale w."""

    a: FloatArray  # shape (n, n), 1/s
    b: FloatArray  # shape (n,)
    c: FloatArray  # shape (n,)
    d: float  # direct part
    scale: float  # w, rad/s

    @classmethod
    def of(cls, rational: Rational) -> LinearSystem:
        """Companion form of a proper transfer function.

        Raises:
            ModelError: the numerator has a higher degree than the denominator.
        """
        order = len(rational.denominator) - 1
        if len(rational.numerator) > order + 1:
            raise ModelError(
                "This sensor's response contains the derivative of the acceleration.",
                expected="a numerator of at most the denominator's degree",
                found=f"degree {len(rational.numerator) - 1} over degree {order}",
                where="simulate",
                remedy="simulate a model without such a part",
            )
        w = float(rational.angular_scale)
        power = w ** (np.arange(order + 1) - float(order))
        den = np.array(rational.denominator, dtype=float) * power
        num = np.zeros(order + 1)
        num[: len(rational.numerator)] = np.array(rational.numerator, dtype=float)
        num *= power
        gain, d = float(rational.gain), num[-1]
        a = np.eye(order, k=1)
        a[-1] = -den[:-1]
        b = np.zeros(order)
        b[-1] = w * gain
        return cls(w * a, b, num[:-1] - d * den[:-1], gain * d, w)

    @property
    def order(self) -> int:
        """Number of states n."""
        return int(self.b.shape[0])

    @functools.cached_property
    def fastest(self) -> float:
        """Largest magnitude of a pole, rad/s."""
        return float(np.max(np.abs(np.linalg.eigvals(self.a))))

    def tone_states(self, frequency_hz: FloatArray) -> ComplexArray:
        """Steady states per unit of acceleration, (jωI − A)⁻¹ b, shape (n, points).

        Raises:
            InputError: a frequency is that of an undamped pole.
        """
        sigma = 2j * np.pi * np.asarray(frequency_hz, dtype=float) / self.scale
        denominator = sigma**self.order - np.polynomial.polynomial.polyval(sigma, self.a[-1] / self.scale)
        require(
            bool(np.all(np.abs(denominator) > 1e-14 * np.maximum(1.0, np.abs(sigma)) ** self.order)),
            "An undamped sensor is excited at its natural frequency: its response grows without bound.",
            expected="a damping above 0, or other frequencies",
            found="damping 0",
            where="simulate",
            remedy="give the sensor some damping",
        )
        return self.b[-1] / self.scale / denominator * sigma ** np.arange(self.order)[:, None]

    def static_state(self, acceleration: float) -> FloatArray:
        """State under a constant acceleration (m/s²), shape (n,)."""
        return np.asarray(np.linalg.solve(self.a, -acceleration * self.b), dtype=float)


def exponential(a: FloatArray, time_s: float) -> FloatArray:
    """e^{A t}, shape (n, n); cached, because all records of a calibration need the same few.

    By eigenvectors where they are far from parallel: over thousands of periods of a lightly damped sensor they keep
    the phase to ε ω t, where scaling and squaring loses two digits. Near critical damping by scaling and squaring.
    """
    return _exponential(a.tobytes(), a.shape[0], time_s)


@functools.lru_cache(maxsize=256)
def _exponential(a: bytes, order: int, time_s: float) -> FloatArray:
    matrix = np.frombuffer(a).reshape(order, order)
    poles, vectors = np.linalg.eig(matrix)
    if np.linalg.cond(vectors) < _PARALLEL:
        value = np.array(((vectors * np.exp(poles * time_s)) @ np.linalg.inv(vectors)).real)
    else:
        value = np.array(expm(matrix * time_s), dtype=float)
    value.flags.writeable = False
    return value


def propagate(a: FloatArray, state: FloatArray, grid: SampleGrid) -> FloatArray:
    """e^{A t} x0 at every instant t of a grid, shape (n, samples), doubling the known part each time."""
    states = np.empty((state.shape[0], grid.samples))
    if not grid.samples:
        return states
    states[:, 0] = exponential(a, grid.start_s) @ state
    known = 1
    while known < grid.samples:
        more = min(known, grid.samples - known)
        states[:, known : known + more] = exponential(a, known * grid.interval_s) @ states[:, :more]
        known += more
    return states


def accumulate(a: FloatArray, interval_s: float, steps: FloatArray) -> FloatArray:
    """x_k = e^{A h} x_{k−1} + g_k with x_{−1} = 0, shape (n, samples), by recursive doubling (Kogge & Stone 1973).

    ``a``: shape (n, n); ``interval_s``: h; ``steps``: g_k, shape (n, samples).
    """
    states, reach = steps, 1
    while reach < steps.shape[1]:
        longer = states.copy()
        longer[:, reach:] += exponential(a, reach * interval_s) @ states[:, :-reach]
        states, reach = longer, 2 * reach
    return states
