"""The descent of a residual by Levenberg and Marquardt, one step at a time.

An objective ``quadratic(z, args)`` gives cost, gradient and JᵀJ of the weighted residual at
coordinates z, shape (p,), however many residuals there are; a step needs no more. What a large
residual adds to JᵀJ is learned from the gradients on the way.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from vibrident.base.errors import NotConverged
from vibrident.data.records import FloatArray

#: Large residuals converge slowly. No more is to be known where the gains of so many steps fall to
#: half …
SLOW_STEPS = 5
#: … and are less than this (or the tolerance) together: what remains is less than a tenth of a
#: standard uncertainty.
MAX_SLOW_GAIN = 0.01
#: Directions of which the residual says less than this, relative to the best, promise no gain.
MIN_EIGENVALUE = 1e-14

NO_START = (
    "No start value gives a finite fit: the records do not show how the response follows the "
    "reference. Check columns, rate and units; a step needs samples of rest before it."
)
NOT_FINITE = (
    "The cost is not finite at the start values: the discretisation is unstable for this sensor at "
    "this sampling rate (Euler needs Ts < 2 δ/ωn), or the records hold values that cannot be "
    "squared."
)


class Quadratic(Protocol):
    """The value of an objective: rᵀr, Jᵀr with J = −∂r/∂z, and JᵀJ."""

    @property
    def cost(self) -> Any:
        """Return the sum of squares rᵀr."""

    @property
    def gradient(self) -> Any:
        """Return Jᵀr, shape (p,)."""

    @property
    def matrix(self) -> Any:
        """Return JᵀJ, shape (p, p)."""


Objective = Callable[[Any, Any], Quadratic]


class Progress(Protocol):
    """A function called after each iteration with its number, the most of them, and the cost."""

    def __call__(self, iteration: int, most: int, cost: float) -> None:
        """Show progress."""


def silent(iteration: int, most: int, cost: float) -> None:
    """Show nothing of the progress."""


@dataclass(frozen=True)
class Trace:
    """The course of an optimisation: its accepted iterates, and the reason for its end.

    ``costs`` and ``coordinates`` are those at each iterate; ``changes`` are the iterates from which
    on the residual has other weights.
    """

    optimiser: str
    converged: bool
    status: str
    costs: tuple[float, ...]
    coordinates: FloatArray  # (iterates, p)
    changes: tuple[int, ...] = ()

    def then(self, following: Trace) -> Trace:
        """Return this course and another after it, in other weights."""
        count = len(self.costs)
        return replace(
            following,
            costs=self.costs + following.costs,
            coordinates=np.concatenate([self.coordinates, following.coordinates]),
            changes=(*self.changes, count, *(count + change for change in following.changes)),
        )

    @property
    def last(self) -> FloatArray:
        """Return the final coordinates, shape (p,)."""
        return self.coordinates[-1]


def levenberg_marquardt(
    objective: Objective,
    start: FloatArray,
    args: Any,
    *,
    moved: Callable[[FloatArray, FloatArray], FloatArray] = np.add,
    tolerance: float = 1e-9,
    max_cost: float = np.inf,
    max_evaluations: int = 60,
    progress: Progress = silent,
) -> Trace:
    """Minimise by Levenberg and Marquardt's damped Gauss–Newton steps from ``start``.

    Source: Nocedal & Wright 2006, ch. 10. Beside a large residual, of a model that does not suit,
    these converge slowly: JᵀJ lacks the residual's own curvature. A secant approximation of it is
    added where it foretold the last step's gain better (Dennis, Gay & Welsch 1981).

    It stops when a full Gauss–Newton step would lower the cost by less than ``tolerance``, or,
    after a step that was rejected, the next one. With residuals in units of their standard
    deviation that step is √tolerance standard uncertainties long, so nothing that could be known
    remains.

    Args:
        objective: cost, Jᵀr and JᵀJ at a point.
        start: shape (p,).
        args: anything the objective needs.
        moved: coordinates and a step to the coordinates behind it, along any curve of that slope.
        tolerance: decrease of the cost that is not worth a step.
        max_cost: cost above which that decrease grows in proportion to the cost: residuals are in
            units of deviations that are too small.
        max_evaluations: of the objective.
        progress: called after each iteration.

    Returns:
        The accepted iterates, and whether they converged.

    Raises:
        NotConverged: the cost is not finite at the start.
    """
    current = _Iterate.evaluate(np.asarray(start, dtype=float), objective, args)
    if not np.isfinite(current.cost):
        raise NotConverged(NOT_FINITE)
    iterates = [current]
    damping = 1.0  # in units of the coordinates, which are near one
    rejected = 0
    min_share = max(tolerance / max(max_cost, 1.0), 1e-15)
    no_curvature = curvature = curvature_used = np.zeros((len(current.z), len(current.z)))

    def has_converged() -> bool:
        min_gain = max(tolerance, min_share * current.cost)
        if current.gain < min_gain or _is_slow(iterates, tolerance):
            return True
        if not rejected:
            return False
        next_step = current.step(damping, curvature_used)
        return current.promised(next_step, curvature_used) < min_gain

    progress(1, max_evaluations, current.cost)
    for iteration in range(2, max_evaluations + 1):
        if has_converged():
            break
        step = current.step(damping, curvature_used)
        trial = _Iterate.evaluate(moved(current.z, step), objective, args)
        promised_gain = current.promised(step, curvature_used)
        gain = current.cost - trial.cost
        gain_ratio = gain / promised_gain if promised_gain > 0.0 else -np.inf
        gain_ratio = gain_ratio if np.isfinite(gain_ratio) else -np.inf
        if gain_ratio >= 0.01:  # of what the linear residual promises
            misses = [abs(gain - current.promised(step, c)) for c in (curvature, no_curvature)]
            foretells = misses[0] < misses[1]
            change = trial.z - current.z
            curvature = secant(curvature, change, current.gradient - trial.gradient, trial.matrix)
            curvature_used = curvature if foretells else no_curvature
            current = trial
            rejected = 0
            iterates.append(current)
            damping *= 1.0 / 3.5 if gain_ratio > 0.9 else 1.0  # the residual is nearly linear
        else:
            # More after each rejection, to fit any size of the residual (Nielsen 1999).
            damping *= 4.0 * 2.0**rejected
            rejected += 1
        progress(iteration, max_evaluations, current.cost)
    converged = has_converged()
    status = "converged" if converged else f"stopped after {max_evaluations} evaluations"
    path = np.array([point.z for point in iterates])
    costs = tuple(point.cost for point in iterates)
    return Trace("levenberg-marquardt", converged, status, costs, path)


@dataclass(frozen=True, eq=False)
class _Iterate:
    """An objective at coordinates z."""

    z: FloatArray
    cost: float
    gradient: FloatArray
    matrix: FloatArray

    @classmethod
    def evaluate(cls, z: FloatArray, objective: Objective, args: Any) -> _Iterate:
        """Evaluate an objective; its cost is infinite where gradient or JᵀJ are not finite."""
        with np.errstate(all="ignore"):  # a step may be far too long
            local = objective(z, args)
        gradient = np.asarray(local.gradient)
        matrix = np.asarray(local.matrix)
        finite = np.all(np.isfinite(matrix)) and np.all(np.isfinite(gradient))
        return cls(z, float(local.cost) if finite else np.inf, gradient, matrix)

    def step(self, damping: float, curvature: FloatArray | float = 0.0) -> FloatArray:
        """Return the damped step by JᵀJ and the curvature that it lacks, shape (p,).

        It is zero along directions without influence on the residual.
        """
        matrix = self.matrix + damping * np.eye(len(self.z))
        diagonal = np.diag(matrix)
        # Rounding makes zero influence negative.
        scale = np.sqrt(np.where(diagonal > 0.0, diagonal, np.inf))
        values, vectors = np.linalg.eigh((matrix + curvature) / scale[:, None] / scale)
        if values[0] < 0.0:  # no direction of descent
            values, vectors = np.linalg.eigh(matrix / scale[:, None] / scale)
        determined = values > MIN_EIGENVALUE
        return (
            (vectors[:, determined] / values[determined])
            @ (vectors[:, determined].T @ (self.gradient / scale))
            / scale
        )

    def promised(self, step: FloatArray, curvature: FloatArray) -> float:
        """Return by how much a step should lower the cost."""
        return float(2.0 * step @ self.gradient - step @ (self.matrix + curvature) @ step)

    @functools.cached_property
    def gain(self) -> float:
        """Return by how much a full Gauss–Newton step should lower the cost."""
        return float(self.step(0.0) @ self.gradient)


def _is_slow(iterates: Sequence[_Iterate], tolerance: float) -> bool:
    """Return whether the gains of the last steps fall to half and are little together."""
    gains = [
        previous.cost - following.cost
        for previous, following in itertools.pairwise(iterates[-1 - SLOW_STEPS :])
    ]
    return (
        len(gains) == SLOW_STEPS
        and sum(gains) < max(tolerance, MAX_SLOW_GAIN)
        and gains[-1] < 0.5 * gains[0]
    )


def secant(
    curvature: FloatArray, step: FloatArray, change: FloatArray, matrix: FloatArray
) -> FloatArray:
    """Return what JᵀJ lacks of half the Hessian, shape (p, p), after a step.

    The update of Dennis, Gay & Welsch (ACM TOMS 7, 1981), with their sizing.

    Args:
        curvature: what it lacked before, shape (p, p).
        step: shape (p,).
        change: fall of the gradient along the step, shape (p,).
        matrix: JᵀJ behind the step, shape (p, p).
    """
    fall = float(step @ change)
    fall_beyond = change - matrix @ step
    curvature_along = float(step @ curvature @ step)
    if not fall > 0.0:
        return curvature
    sized = curvature * (
        min(1.0, abs(step @ fall_beyond) / abs(curvature_along)) if curvature_along else 1.0
    )
    remainder = fall_beyond - sized @ step
    product = np.outer(remainder, change) / fall
    return sized + product + product.T - (remainder @ step) * np.outer(change, change) / fall**2
