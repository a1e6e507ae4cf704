"""The way down a residual: Levenberg–Marquardt, one step at a time.

An objective ``quadratic(z, args)`` gives cost, gradient and JᵀJ of the weighted residual at coordinates z, shape
(p,), however many residuals there are; a step needs no more. What a large residual adds to JᵀJ is learned from the
gradients on the way.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from vibrident.base.errors import NotConverged
from vibrident.data.records import FloatArray

#: Nor is more to be known where the gains of so many steps fall to half, and are less than this (or the tolerance)
#: together: large residuals converge slowly, and what is left is less than a tenth of a standard uncertainty.
SLOW = 5
LITTLE = 0.01
#: Directions of which the residual says less than this, relative to the best, promise no gain.
LEAST_SHOWN = 1e-14

NOT_FINITE = (
    "The cost is not finite at the start values: the discretisation is unstable for this sensor at "
    "this sampling rate (Euler needs Ts < 2 δ/ωn), or the records hold values that cannot be squared."
)


class Quadratic(Protocol):
    """What an objective returns: rᵀr, Jᵀr with J = −∂r/∂z, and JᵀJ."""

    @property
    def cost(self) -> Any:
        """Sum of squares."""

    @property
    def gradient(self) -> Any:
        """Shape (p,)."""

    @property
    def matrix(self) -> Any:
        """Shape (p, p)."""


Objective = Callable[[Any, Any], Quadratic]


class Progress(Protocol):
    """Called after each iteration with the iteration, the most there can be, and the cost."""

    def __call__(self, iteration: int, most: int, cost: float) -> None:
        """Show progress."""


def silent(iteration: int, most: int, cost: float) -> None:
    """Progress that shows nothing."""


@dataclass(frozen=True)
class Trace:
    """The course of an optimisation: cost and coordinates at each accepted iterate, and the reason for its end.

    ``changes`` are the iterates from which on the residual has other weights.
    """

    optimiser: str
    converged: bool
    status: str
    costs: tuple[float, ...]
    coordinates: FloatArray  # (iterates, p)
    changes: tuple[int, ...] = ()

    def then(self, other: Trace) -> Trace:
        """Return this course and another after it, in other weights."""
        count = len(self.costs)
        return replace(
            other,
            costs=self.costs + other.costs,
            coordinates=np.concatenate([self.coordinates, other.coordinates]),
            changes=(*self.changes, count, *(count + at for at in other.changes)),
        )

    @property
    def last(self) -> FloatArray:
        """Final coordinates, shape (p,)."""
        return self.coordinates[-1]


def levenberg_marquardt(
    objective: Objective,
    start: FloatArray,
    args: Any,
    *,
    tolerance: float = 1e-9,
    most: int = 60,
    progress: Progress = silent,
) -> Trace:
    """Minimise by Levenberg and Marquardt's damped Gauss–Newton steps from ``start`` (Nocedal & Wright 2006, ch. 10).

    Beside a large residual, of a model that does not suit, these converge slowly: JᵀJ lacks the residual's own
    curvature. A secant approximation of it is added where it foretold the last step's gain better (Dennis, Gay &
    Welsch 1981).

    It stops when a full Gauss–Newton step would lower the cost by less than ``tolerance``, or, after a step that was
    rejected, the next one. With residuals in units of their standard deviation that step is √tolerance standard
    uncertainties long, so nothing that could be known is left.

    Args:
        objective: cost, Jᵀr and JᵀJ at a point.
        start: shape (p,).
        args: anything the objective needs.
        tolerance: decrease of the cost that is not worth a step.
        most: most evaluations of the objective.
        progress: called after each iteration.

    Raises:
        NotConverged: the cost is not finite at the start.
    """
    here = _Point.of(np.asarray(start, dtype=float), objective, args)
    if not np.isfinite(here.cost):
        raise NotConverged(NOT_FINITE)
    way = [here]
    damping = 1.0
    rejected = 0  # in units of the coordinates, which are near one
    none = lacking = used = np.zeros((len(here.z), len(here.z)))

    def arrived() -> bool:
        gains = [one.cost - next_.cost for one, next_ in itertools.pairwise(way[-1 - SLOW :])]
        slow = (
            len(gains) == SLOW
            and sum(gains) < max(tolerance, LITTLE)
            and gains[-1] < 0.5 * gains[0]
        )
        least = max(tolerance, 1e-15 * here.cost)
        return (
            here.gain < least
            or (rejected > 0 and here.promised(here.step(damping, used), used) < least)
            or slow
        )

    progress(1, most, here.cost)
    for iteration in range(2, most + 1):
        if arrived():
            break
        step = here.step(damping, used)
        trial = _Point.of(here.z + step, objective, args)
        promised = here.promised(step, used)
        gain = here.cost - trial.cost
        gained = gain / promised if promised > 0.0 else -np.inf
        gained = gained if np.isfinite(gained) else -np.inf
        if gained >= 0.01:  # of what the linear residual promised
            better = abs(gain - here.promised(step, lacking)) < abs(
                gain - here.promised(step, none)
            )
            lacking = secant(lacking, step, here.gradient - trial.gradient, trial.matrix)
            used = lacking if better else none
            here = trial
            rejected = 0
            way.append(here)
            damping *= (
                1.0 / 3.5 if gained > 0.9 else 1.0
            )  # less where the residual is as linear as foretold
        else:
            damping *= (
                4.0 * 2.0**rejected
            )  # more after each, to fit any size of the residual (Nielsen 1999)
            rejected += 1
        progress(iteration, most, here.cost)
    converged = arrived()
    status = "converged" if converged else f"stopped after {most} evaluations"
    path = np.array([point.z for point in way])
    return Trace("levenberg-marquardt", converged, status, tuple(point.cost for point in way), path)


@dataclass(frozen=True, eq=False)
class _Point:
    """An objective at coordinates z; ``gain``: what a full Gauss–Newton step would lower the cost by."""

    z: FloatArray
    cost: float
    gradient: FloatArray
    matrix: FloatArray

    @classmethod
    def of(cls, z: FloatArray, objective: Objective, args: Any) -> _Point:
        with np.errstate(all="ignore"):  # a step may be far too long
            local = objective(z, args)
        gradient = np.asarray(local.gradient)
        matrix = np.asarray(local.matrix)
        finite = np.all(np.isfinite(matrix)) and np.all(np.isfinite(gradient))
        return cls(z, float(local.cost) if finite else np.inf, gradient, matrix)

    def step(self, damping: float, lacking: FloatArray | float = 0.0) -> FloatArray:
        """Damped step by JᵀJ and what it lacks; zero along directions without influence on the residual."""
        matrix = self.matrix + damping * np.eye(len(self.z))
        shown = np.diag(matrix)
        size = np.sqrt(
            np.where(shown > 0.0, shown, np.inf)
        )  # rounding makes zero influence negative
        values, vectors = np.linalg.eigh((matrix + lacking) / size[:, None] / size)
        if values[0] < 0.0:  # no way down
            values, vectors = np.linalg.eigh(matrix / size[:, None] / size)
        kept = values > LEAST_SHOWN
        return (
            (vectors[:, kept] / values[kept]) @ (vectors[:, kept].T @ (self.gradient / size)) / size
        )

    def promised(self, step: FloatArray, lacking: FloatArray) -> float:
        """What a step should lower the cost by."""
        return float(2.0 * step @ self.gradient - step @ (self.matrix + lacking) @ step)

    @functools.cached_property
    def gain(self) -> float:
        return float(self.step(0.0) @ self.gradient)


def secant(
    lacking: FloatArray, step: FloatArray, change: FloatArray, matrix: FloatArray
) -> FloatArray:
    """What JᵀJ lacks of half the Hessian, shape (p, p), after a step along which the gradient fell by ``change``.

    ``matrix``: JᵀJ behind the step. The update of Dennis, Gay & Welsch (ACM TOMS 7, 1981), with their sizing.
    """
    along = float(step @ change)
    off = change - matrix @ step
    now = float(step @ lacking @ step)
    if not along > 0.0:
        return lacking
    sized = lacking * (min(1.0, abs(step @ off) / abs(now)) if now else 1.0)
    rest = off - sized @ step
    both = np.outer(rest, change) / along
    return sized + both + both.T - (rest @ step) * np.outer(change, change) / along**2
