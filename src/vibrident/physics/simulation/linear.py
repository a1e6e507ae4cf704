"""Linear systems in NumPy: companion state space, response to tones, exact motion in between.

Independent of ``vibrident.physics.models.state_space``, which the estimators use: truth and
estimate share only the transfer function.

States under an acceleration that is known by its values follow by Gauss–Legendre quadrature with
exact exponentials.

    x(t + h) = e^{A h} x(t) + ∫₀^h e^{A (h − τ)} b a(t + τ) dτ

The integral of every step is refined until the response no longer changes. Steps that hold a break
of the acceleration are split there, so that every integrand is smooth.
"""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import expm

from vibrident.base.errors import InputError, ModelError
from vibrident.data.records import FloatArray
from vibrident.physics.models.base import Rational
from vibrident.physics.models.slopes import ComplexArray
from vibrident.physics.simulation.checks import require
from vibrident.physics.simulation.motion import Motion, SampleGrid

#: Largest condition number of eigenvectors that are used.
MAX_CONDITION = 100.0
#: Change of the response, relative to its largest value, at which refinement stops.
TOLERANCE = 1e-12
#: Nodes a panel, tried in turn.
_NODES = (6, 9, 14, 21, 32, 48)
#: Largest |λ| times panel length, λ the sensor's fastest pole.
MAX_PANEL_PHASE = 8.0


@dataclass(frozen=True, eq=False)
class LinearSystem:
    """Linear system ẋ = A x + b a,  y = c x + d a.

    The states are x, ẋ/w, ẍ/w², … in units of the angular scale w.

    Attributes:
        a: shape (n, n), 1/s.
        b: shape (n,).
        c: shape (n,).
        d: direct part.
        scale: w, rad/s.
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: float
    scale: float

    @classmethod
    def from_rational(cls, rational: Rational) -> LinearSystem:
        """Build the companion form of a proper transfer function.

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
        gain = float(rational.gain)
        d = num[-1]
        a = np.eye(order, k=1)
        a[-1] = -den[:-1]
        b = np.zeros(order)
        b[-1] = w * gain
        return cls(w * a, b, num[:-1] - d * den[:-1], gain * d, w)

    @property
    def order(self) -> int:
        """Return the number of states n."""
        return int(self.b.shape[0])

    @functools.cached_property
    def fastest(self) -> float:
        """Return the largest magnitude of a pole, rad/s."""
        return float(np.max(np.abs(np.linalg.eigvals(self.a))))

    def tone_states(self, frequency_hz: FloatArray) -> ComplexArray:
        """Return the steady states per unit of acceleration, (jωI − A)⁻¹ b, shape (n, points)."""
        sigma = 2j * np.pi * np.asarray(frequency_hz, dtype=float) / self.scale
        denominator = sigma**self.order - np.polynomial.polynomial.polyval(
            sigma, self.a[-1] / self.scale
        )
        require(
            bool(
                np.all(np.abs(denominator) > 1e-14 * np.maximum(1.0, np.abs(sigma)) ** self.order)
            ),
            "An undamped sensor is excited at its natural frequency: "
            "its response grows without bound.",
            expected="a damping above 0, or other frequencies",
            found="damping 0",
            where="simulate",
            remedy="give the sensor some damping",
        )
        return self.b[-1] / self.scale / denominator * sigma ** np.arange(self.order)[:, None]

    def static_state(self, acceleration: float) -> FloatArray:
        """Return the state under a constant acceleration (m/s²), shape (n,)."""
        return np.asarray(np.linalg.solve(self.a, -acceleration * self.b), dtype=float)


def exponential(a: FloatArray, time_s: float) -> FloatArray:
    """Return e^{A t}, shape (n, n); cached, because all records of a calibration need the same few.

    By eigenvectors where they are far from parallel: over thousands of periods of a lightly damped
    sensor they keep the phase to ε ω t, where scaling and squaring loses two digits. Near critical
    damping by scaling and squaring.
    """
    return _exponential(a.tobytes(), a.shape[0], time_s)


@functools.lru_cache(maxsize=256)
def _exponential(a: bytes, order: int, time_s: float) -> FloatArray:
    matrix = np.frombuffer(a).reshape(order, order)
    poles, vectors = np.linalg.eig(matrix)
    if np.linalg.cond(vectors) < MAX_CONDITION:
        value = np.array(((vectors * np.exp(poles * time_s)) @ np.linalg.inv(vectors)).real)
    else:
        value = np.array(expm(matrix * time_s), dtype=float)
    value.flags.writeable = False
    return value


def propagate(a: FloatArray, state: FloatArray, grid: SampleGrid) -> FloatArray:
    """Return e^{A t} x0 at every instant t of a grid, shape (n, samples).

    Each product doubles the known part.
    """
    states = np.empty((state.shape[0], grid.samples))
    if not grid.samples:
        return states
    states[:, 0] = exponential(a, grid.start_s) @ state
    done = 1
    while done < grid.samples:
        more = min(done, grid.samples - done)
        states[:, done : done + more] = exponential(a, done * grid.interval_s) @ states[:, :more]
        done += more
    return states


def accumulate(a: FloatArray, interval_s: float, steps: FloatArray) -> FloatArray:
    """Return x_k = e^{A h} x_{k−1} + g_k with x_{−1} = 0, shape (n, samples).

    By recursive doubling (Kogge & Stone 1973). ``a``: shape (n, n); ``interval_s``: h; ``steps``:
    g_k, shape (n, samples).
    """
    states = steps
    reach = 1
    while reach < steps.shape[1]:
        longer = states.copy()
        longer[:, reach:] += exponential(a, reach * interval_s) @ states[:, :-reach]
        states = longer
        reach = 2 * reach
    return states


def driven_states(system: LinearSystem, motion: Motion, grid: SampleGrid) -> FloatArray:
    """Return the states from rest at t = 0 under ``motion``, shape (n, samples).

    The grid starts at or after 0.

    Raises:
        InputError: the acceleration is too rough between samples for the quadrature to settle.
    """
    if not grid.samples:
        return np.zeros((system.order, 0))
    last_s = grid.start_s + grid.samples * grid.interval_s
    # An instant t is known to ε t, a phase at the fastest rate therefore to ω ε t: no refinement
    # beats that.
    fastest = max(2.0 * math.pi * motion.highest_hz, system.fastest)
    tolerance = TOLERANCE + 4.0 * fastest * last_s * float(np.finfo(float).eps)
    previous = _states(system, motion, grid, _NODES[0])
    change = math.inf
    for nodes in _NODES[1:]:
        states = _states(system, motion, grid, nodes)
        largest = float(np.max(np.abs(system.c @ states)))
        change = float(np.max(np.abs(system.c @ (states - previous)))) / (largest or 1.0)
        if change <= tolerance:
            return states
        previous = states
    raise InputError(
        "The excitation is too rough between samples for an exact response.",
        expected=f"a change below {tolerance:.1e} of the largest response on refinement",
        found=f"{change:.1e} with {_NODES[-1]} nodes a step",
        where=f"excitation {motion.words!r}",
        remedy="raise the sampling rate, "
        "or list the instants where the excitation is not smooth in breaks_s",
    )


def _states(system: LinearSystem, motion: Motion, grid: SampleGrid, nodes: int) -> FloatArray:
    times = grid.times_s
    steps = np.zeros((system.order, grid.samples))
    steps[:, 0] = _integral(system, motion, 0.0, grid.start_s, nodes)
    offsets, vectors = _rule(system, grid.interval_s, nodes)
    for offset, vector in zip(offsets, vectors.T, strict=True):
        steps[:, 1:] += vector[:, None] * motion.value(times[:-1] + offset)
    for instant in motion.breaks_s:
        # A step that holds several breaks is split at all of them, each time.
        k = grid.first_from(instant)
        if 0 < k < grid.samples:
            steps[:, k] = _integral(system, motion, times[k - 1], times[k], nodes)
    return accumulate(system.a, grid.interval_s, steps)


def _integral(
    system: LinearSystem, motion: Motion, begin_s: float, end_s: float, nodes: int
) -> FloatArray:
    """Return ∫ e^{A (end − τ)} b a(τ) dτ from begin to end, split at the breaks; shape (n,)."""
    inside = sorted(instant for instant in motion.breaks_s if begin_s < instant < end_s)
    edges = [begin_s, *inside, end_s]
    state = np.zeros(system.order)
    for first_s, last_s in itertools.pairwise(edges):
        length_s = last_s - first_s
        offsets, vectors = _rule(system, length_s, nodes)
        drive = vectors @ motion.value(first_s + offsets)
        state = exponential(system.a, length_s) @ state + drive
    return state


def _rule(system: LinearSystem, length_s: float, nodes: int) -> tuple[FloatArray, FloatArray]:
    """Return offsets into the step, shape (m,), and weights w e^{A (h − offset)} b, (n, m)."""
    panels = max(1, math.ceil(system.fastest * length_s / MAX_PANEL_PHASE))
    x, w = legendre.leggauss(nodes)
    offsets = ((np.arange(panels)[:, None] + 0.5 * (x + 1.0)) * (length_s / panels)).ravel()
    weights = np.tile(0.5 * w * length_s / panels, panels)
    vectors = [exponential(system.a, float(length_s - offset)) @ system.b for offset in offsets]
    return offsets, weights * np.array(vectors).T
