"""One natural frequency and damping ratio from free decays, by variable projection.

Initial state, offset, a straight drift and tones of the mains enter each record linearly; the best ones are solved
for at every (fn, δ), and the derivative is Kaufman's (1975). Samples are weighed by the record's own noise, so the
estimate is maximum likelihood and its covariance the Cramér-Rao bound (Golub & Pereyra 2003).

The free motion of a damped oscillator, at any damping, is

    y(t) = e^{-δ ωn t} (a cosh μt + b ωn sinh(μt)/μ),   μ² = ωn² (δ² − 1)

Every output of a linear second-order sensor moves like this when nothing drives it: displacement or velocity pickup,
delayed or averaged. Both functions depend on μ² alone, so they pass smoothly from oscillation (μ imaginary) to two real
poles. The gain only scales a and b.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.decay.noise import WHITE, Noise, tone_columns

STEP = 1e-5  # step of the central differences in (ln fn, δ): error and rounding are below 1e-9 of the motion
MOST_GROWTH = 300.0  # exponent of a motion that grows, as a fit may try on its way
STEPS = 60  # most steps of the descent
SETTLED = 1e-13  # it has settled where a step gains less than this part of the cost
RANK = 1e-10  # singular values below this part of the largest belong to directions that the samples do not show
MOST_DAMPING = 300.0  # largest damping ratio of the search
FASTEST = 20.0  # highest natural frequency of the search, in sampling rates


def free_motion(natural_frequency_hz: float, damping_ratio: float, time_s: FloatArray) -> FloatArray:
    """The two functions that span the free motion, shape (samples, 2).

    ``natural_frequency_hz``: of the undamped oscillator; ``damping_ratio``: any; slightly negative values are what a
    fit passes on its way; ``time_s``: from the beginning of the motion, shape (samples,).
    """
    angle = 2.0 * np.pi * natural_frequency_hz * np.asarray(time_s, dtype=float)
    square = damping_ratio**2 - 1.0
    if square < 0.0:
        envelope = np.exp(np.minimum(-damping_ratio * angle, MOST_GROWTH))
        turned = np.sqrt(-square) * angle
        return np.stack([envelope * np.cos(turned), envelope * angle * np.sinc(turned / np.pi)], axis=1)
    slow = np.exp(-(damping_ratio - np.sqrt(square)) * angle)
    twice = 2.0 * np.sqrt(square) * angle
    ratio = np.where(twice > 0, -np.expm1(-twice) / np.where(twice > 0, twice, 1.0), 1.0)
    return np.stack([0.5 * slow * (1.0 + np.exp(-twice)), slow * angle * ratio], axis=1)


def motion_slopes(natural_frequency_hz: float, damping_ratio: float, time_s: FloatArray) -> FloatArray:
    """Derivatives of :func:`free_motion` by (ln fn, δ), shape (2, samples, 2), by central differences."""
    up, down = np.exp(STEP), np.exp(-STEP)
    by_frequency = free_motion(natural_frequency_hz * up, damping_ratio, time_s) - free_motion(
        natural_frequency_hz * down, damping_ratio, time_s
    )
    by_damping = free_motion(natural_frequency_hz, damping_ratio + STEP, time_s) - free_motion(
        natural_frequency_hz, damping_ratio - STEP, time_s
    )
    return np.stack([by_frequency, by_damping]) / (2.0 * STEP)


@dataclass(frozen=True, eq=False)
class Stretch:
    """The part of a record in which the sensor moves freely."""

    name: str  # of the record
    first: int  # index of the stretch's first sample in the record
    response: FloatArray  # shape (samples,), filled where not valid
    valid: BoolArray  # shape (samples,)
    rate_hz: float  # samples per second
    noise: Noise = WHITE  # what whitens it
    scale: float = 1.0  # standard deviation of the whitened noise
    drift: bool = False  # whether a straight line is among the unknowns
    more: FloatArray | None = None  # further unknowns' columns, shape (samples, n); None for no further unknowns

    @property
    def time_s(self) -> FloatArray:
        """From the stretch's first sample."""
        return np.arange(self.response.size) / self.rate_hz

    @property
    def rows(self) -> BoolArray:
        """Samples that count once whitened."""
        return self.noise.rows(self.valid)

    def whitened(self, columns: FloatArray) -> FloatArray:
        """Columns, shape (samples, n), in units of the noise: the rows that count."""
        return self.noise.applied(columns)[self.rows] / self.scale

    def beside(self) -> FloatArray:
        """Offset, drift, tones and further linear unknowns, shape (samples, n)."""
        time = self.time_s
        parts = [np.ones((time.size, 1))]
        if self.drift:
            parts.append((time / time[-1] - 0.5)[:, None])
        if self.more is not None:
            parts.append(self.more)
        if self.noise.tones_hz:
            parts.append(tone_columns(self.noise.tones_hz, time))
        return np.concatenate(parts, axis=1)


@dataclass(frozen=True, eq=False)
class Local:
    """A stretch at one (fn, δ)."""

    residual: FloatArray  # whitened, with the linear unknowns at their best, shape (rows,)
    slopes: FloatArray  # of the residual by (ln fn, δ), shape (rows, 2)
    spanned: FloatArray  # orthonormal basis of the linear unknowns' columns, shape (rows, n)
    linear: FloatArray  # the linear unknowns: the two of the motion first


@dataclass(frozen=True, eq=False)
class DecayFit:
    """What the stretches say together."""

    natural_frequency_hz: float  # value
    damping_ratio: float  # value, zero or above
    covariance: FloatArray  # of (ln fn, δ), shape (2, 2), for whitened noise of variance one
    stretches: tuple[Stretch, ...]  # with their noise
    locals: tuple[Local, ...]  # one a stretch, at the values
    costs: tuple[float, ...]  # sum of squares at each iteration
    path: tuple[tuple[float, float], ...]  # (fn, δ) at each iteration

    @property
    def cost(self) -> float:
        """Sum of squares of the whitened residual."""
        return self.costs[-1]


def local(stretch: Stretch, natural_frequency_hz: float, damping_ratio: float) -> Local:
    """Solve for everything linear at given (fn, δ)."""
    time = stretch.time_s
    motion = free_motion(natural_frequency_hz, damping_ratio, time)
    columns = np.concatenate([motion, stretch.beside()], axis=1)
    seen = stretch.whitened(columns)
    sizes = np.linalg.norm(seen, axis=0)
    sizes[sizes == 0.0] = 1.0
    u, s, vt = np.linalg.svd(seen / sizes, full_matrices=False)
    kept = s > RANK * s[0]
    spanned = u[:, kept]
    target = stretch.whitened(stretch.response[:, None])[:, 0]
    linear = (vt[kept].T @ ((spanned.T @ target) / s[kept])) / sizes
    slopes = motion_slopes(natural_frequency_hz, damping_ratio, time) @ linear[:2]
    turned = stretch.whitened(slopes.T)
    turned = turned - spanned @ (spanned.T @ turned)
    return Local(target - spanned @ (spanned.T @ target), -turned, spanned, linear)


def fit(stretches: Sequence[Stretch], natural_frequency_hz: float, damping_ratio: float) -> DecayFit:
    """Levenberg-Marquardt on (ln fn, δ) from a start."""
    theta: FloatArray = np.array([np.log(natural_frequency_hz), damping_ratio])
    longest = max(s.response.size / s.rate_hz for s in stretches)
    edges = np.log([1e-3 / longest, FASTEST * max(s.rate_hz for s in stretches)])
    now = _locals(stretches, theta)
    cost, damping = _cost(now), 1e-4
    costs, path = [cost], [_values(theta)]
    rows = sum(len(x.residual) for x in now)
    for _ in range(STEPS):
        matrix = sum(x.slopes.T @ x.slopes for x in now)
        gradient = sum(x.slopes.T @ x.residual for x in now)
        step = -np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)) + 1e-300 * np.eye(2), gradient)
        step = np.clip(
            np.asarray(step, dtype=float), [-0.5, -0.5 * (0.1 + abs(theta[1]))], [0.5, 0.5 * (0.1 + abs(theta[1]))]
        )
        trial = theta + step
        trial[0] = np.clip(trial[0], *edges)
        trial[1] = np.clip(trial[1], -3.0 / (2.0 * np.pi * np.exp(trial[0]) * longest), MOST_DAMPING)
        then = _locals(stretches, trial)
        if _cost(then) <= cost * (1.0 + 1e-13):
            gain, cost = cost - _cost(then), _cost(then)
            theta, now, damping = trial, then, max(damping / 10.0, 1e-12)
            costs.append(cost)
            path.append(_values(theta))
            expected = abs(float(gradient @ step))
            if gain <= SETTLED * cost or (gain <= 1e-4 * cost / rows and expected <= 1e-4 * cost / rows):
                break
        else:
            damping *= 10.0
            if damping > 1e12:
                break
    if theta[1] < 0.0:  # no oscillator feeds itself: the least damping there is
        theta = _at_no_damping(stretches, theta)
        now = _locals(stretches, theta)
        costs.append(_cost(now))
        path.append(_values(theta))
    matrix = np.asarray(sum(x.slopes.T @ x.slopes for x in now))
    frequency, damping_found = _values(theta)
    return DecayFit(frequency, damping_found, _inverse(matrix), tuple(stretches), tuple(now), tuple(costs), tuple(path))


def _at_no_damping(stretches: Sequence[Stretch], theta: FloatArray) -> FloatArray:
    theta = np.array([theta[0], 0.0])
    for _ in range(8):
        now = _locals(stretches, theta)
        steepness = sum(float(x.slopes[:, 0] @ x.slopes[:, 0]) for x in now)
        step = sum(float(x.slopes[:, 0] @ x.residual) for x in now) / max(steepness, 1e-300)
        theta[0] -= float(np.clip(step, -0.01, 0.01))
    return theta


def _inverse(matrix: FloatArray) -> FloatArray:
    """Inverse of a normal matrix of two; a direction that the data leave open gets a very large variance."""
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(size, size))
    return (vectors / np.maximum(values, 1e-14)) @ vectors.T / np.outer(size, size)


def _values(theta: FloatArray) -> tuple[float, float]:
    return float(np.exp(theta[0])), float(theta[1])


def _locals(stretches: Sequence[Stretch], theta: FloatArray) -> list[Local]:
    return [local(stretch, *_values(theta)) for stretch in stretches]


def _cost(found: Sequence[Local]) -> float:
    return sum(float(x.residual @ x.residual) for x in found)


def shortened(stretch: Stretch, first: int, last: int | None = None) -> Stretch:
    """The samples of a stretch from ``first`` to ``last``, as a stretch."""
    response, valid = stretch.response[first:last], stretch.valid[first:last]
    return replace(stretch, first=stretch.first + first, response=response, valid=valid)
