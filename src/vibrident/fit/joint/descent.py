"""The joint fit: first the least sum of all costs, then moment conditions.

The sum of costs finds the place, whatever a bad separate fit says: Levenberg–Marquardt descends the
summed normal equations from each separate estimate in turn, with each record weighted by its
residual there. A separate fit that stopped at another optimum is repeated from the joint one.

The moment conditions (:mod:`vibrident.fit.joint.moments`) then weight each calibration by its
stated covariance. The stated systematic effects are columns beside the parameters, each with an
amount whose prior is N(0, 1) in its standard uncertainty (random effects; with the amounts
eliminated, by Woodbury's identity, this is generalised least squares). A calibration against a
better reference thus has the greater weight where the references limit the result.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.errors import NotConverged
from vibrident.data.records import FloatArray, SystematicEffect
from vibrident.fit.information import inverse_normal
from vibrident.fit.joint.moments import CalibrationScore, MomentConditions
from vibrident.fit.joint.sharing import JointParameter, JointPlace, places
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.optimise import Objective, Progress, Trace, levenberg_marquardt
from vibrident.fit.problem import Local
from vibrident.fit.uncertainty.budget import shift_of_effect

#: Rounds of the sum of costs, and of the moments, with refreshed weights.
MAX_ROUNDS = 4
#: Decrease of a cost that is not worth a step: 10⁻³ standard uncertainties.
MIN_DECREASE = 1e-6

Costs = Sequence[Callable[[FloatArray], Local]]


@dataclass(frozen=True, eq=False)
class JointProblem:
    """The calibrations of a joint fit, with the map from its coordinates to theirs."""

    fitted: tuple[Fitted, ...]  # the separate fits
    numbers: tuple[JointParameter, ...]  # the parameters of the joint fit

    @functools.cached_property
    def places(self) -> tuple[JointPlace, ...]:
        """Return the map from the joint coordinates to those of each fit."""
        return places(self.numbers, [fit.estimate.coordinates for fit in self.fitted])

    def at(self, theta: FloatArray) -> list[FloatArray]:
        """Return the coordinates of each fit at joint ones, shape (q,)."""
        return [place.z(theta) for place in self.places]


def stacked(
    places: Sequence[JointPlace], costs: Costs, prior: FloatArray | float = 0.0
) -> Objective:
    """Return the costs of calibrations as one objective in the coordinates of the joint fit.

    Args:
        places: map from these to the coordinates of each calibration.
        costs: of each calibration, at its own coordinates.
        prior: information on the joint coordinates about zero, shape (q,).
    """

    def objective(theta: FloatArray, _: object) -> Local:
        local_costs = [cost(place.z(theta)) for place, cost in zip(places, costs, strict=True)]
        pairs = list(zip(places, local_costs, strict=True))
        matrix = sum(place.matrix.T @ local.matrix @ place.matrix for place, local in pairs)
        gradient = sum(place.matrix.T @ local.gradient for place, local in pairs)
        prior_gradient = prior * theta
        return Local(
            matrix + np.diag(prior * np.ones_like(theta)),
            gradient - prior_gradient,
            sum(local.cost for local in local_costs) + float(prior_gradient @ theta),
        )

    return objective


@dataclass(frozen=True, eq=False)
class Effect:
    """A systematic effect, and its shift of the coordinates of each calibration that has it."""

    effect: SystematicEffect
    shifts: dict[int, FloatArray]  # by one standard uncertainty, by calibration, shapes (p,)


@dataclass(frozen=True, eq=False)
class Balance:
    """The joint estimate by moments."""

    theta: FloatArray  # joint coordinates, shape (q,)
    covariance: FloatArray  # of these and of the amounts of the effects, shape (q + K, q + K)
    places: tuple[JointPlace, ...]  # map from both to the coordinates of each fit
    information: tuple[FloatArray, ...]  # on the coordinates of each fit, shapes (p, p)
    #: Separate estimates; to first order where a separate fit is not used, shapes (p,).
    estimates: tuple[FloatArray, ...]

    def by_data(self, index: int) -> FloatArray:
        """Return the contribution of a calibration's data to the covariance of theta, (q, q)."""
        gain = self.covariance[: len(self.theta)] @ self.places[index].matrix.T
        return gain @ self.information[index] @ gain.T

    def by_effect(self, number: int) -> FloatArray:
        """Return the shift of theta by one standard uncertainty of an effect, shape (q,)."""
        return self.covariance[: len(self.theta), len(self.theta) + number]


@dataclass(frozen=True, eq=False)
class Descent:
    """The joint estimate, with the fits and effects that it was made of."""

    problem: JointProblem  # with the fits that were repeated
    effects: tuple[Effect, ...]  # each once
    balance: Balance
    near: tuple[CalibrationScore, ...]  # residual of each fit near the joint estimate
    trace: Trace  # of the optimiser
    unused: frozenset[int]  # fits that ended at another optimum, whose estimate is not used


def descend(
    problem: JointProblem, covariance: Callable[[Fitted], FloatArray], progress: Progress
) -> Descent:
    """Fit all calibrations together.

    ``covariance``: of a separate fit from its data alone, shape (p, p).

    Raises:
        NotConverged: no start leads to a finite joint fit.
    """
    theta, near, trace = _best_optimum(problem, progress)
    unused = _fits_elsewhere(problem, near, theta)
    if unused:
        fitted = list(problem.fitted)
        for index in unused:
            values = fitted[index].estimate.coordinates.values(problem.at(theta)[index])
            with contextlib.suppress(NotConverged):  # then the first fit stays
                fitted[index] = fitted[index].anew(fitted[index].evidence, values)
        problem = replace(problem, fitted=tuple(fitted))
        theta, near, trace = _best_optimum(problem, progress)
        unused = _fits_elsewhere(problem, near, theta)
    while True:
        balance, effects = _balance(problem, near, theta, unused, covariance, progress)
        newly_unused = _fits_elsewhere(problem, near, balance.theta) - unused
        if not newly_unused:
            break
        unused |= newly_unused
    cost = stacked(problem.places, [score.local for score in near])(balance.theta, None).cost
    path = np.concatenate([trace.coordinates, balance.theta[None]])
    status = f"{trace.status}; the last point: each calibration weighted by its stated covariance"
    trace = Trace(trace.optimiser, trace.converged, status, (*trace.costs, float(cost)), path)
    return Descent(problem, effects, balance, tuple(near), trace, frozenset(unused))


def _balance(
    problem: JointProblem,
    near: Sequence[CalibrationScore],
    theta: FloatArray,
    unused: set[int],
    covariance: Callable[[Fitted], FloatArray],
    progress: Progress,
) -> tuple[Balance, tuple[Effect, ...]]:
    """Return the joint estimate by moments, started at the optimum of the costs, and the effects.

    ``unused``: fits whose separate estimate is not used.
    """
    moments = []
    coordinates = problem.at(theta)
    for i, (fit, z) in enumerate(zip(problem.fitted, coordinates, strict=True)):
        if i in unused:
            covariance_near = near[i].covariance(z) * (fit.judgement.scatter or 1.0) ** 2
            moments.append(
                MomentConditions.from_estimate(near[i], z, covariance_near, near[i], optimum=False)
            )
        else:
            moments.append(
                MomentConditions.from_estimate(
                    CalibrationScore.from_fit(fit), fit.estimate.z, covariance(fit), near[i]
                )
            )
    effects = _effects(problem.fitted, coordinates)
    places = tuple(_with_effects(place, i, effects) for i, place in enumerate(problem.places))
    prior = np.concatenate([np.zeros(len(theta)), np.ones(len(effects))])
    iterate = np.concatenate([theta, np.zeros(len(effects))])
    for _ in range(MAX_ROUNDS):
        iterate_before = iterate
        coordinates = [place.z(iterate) for place in places]
        costs = [
            functools.partial(conditions.local, weight=conditions.weight(z))
            for conditions, z in zip(moments, coordinates, strict=True)
        ]
        iterate = levenberg_marquardt(
            stacked(places, costs, prior),
            iterate_before,
            None,
            tolerance=MIN_DECREASE,
            progress=progress,
        ).last
        if np.allclose(iterate, iterate_before, rtol=0.0, atol=1e-6):
            break
    information = tuple(
        conditions.information(place.z(iterate))
        for conditions, place in zip(moments, places, strict=True)
    )
    total = sum(
        place.matrix.T @ known @ place.matrix
        for place, known in zip(places, information, strict=True)
    ) + np.diag(prior)
    estimates = [
        fit.estimate.z if i not in unused else place.z(iterate) + moments[i].step(place.z(iterate))
        for i, (fit, place) in enumerate(zip(problem.fitted, places, strict=True))
    ]
    return Balance(
        iterate[: len(theta)],
        inverse_normal(total),
        places,
        information,
        tuple(estimates),
    ), effects


def _effects(fitted: Sequence[Fitted], coordinates: Sequence[FloatArray]) -> tuple[Effect, ...]:
    """Return every systematic effect once.

    Equal statements in two calibrations are one effect, as of one instrument. Effects are taken at
    the joint values ``coordinates``: relative effects taken at each measured value would draw these
    down (Peelle's puzzle; D'Agostini 1994).
    """
    shifts_by_effect: dict[SystematicEffect, dict[int, FloatArray]] = {}
    for index, (fit, z) in enumerate(zip(fitted, coordinates, strict=True)):
        linear = replace(fit, estimate=replace(fit.estimate, z=z)).linear
        for effect in fit.effects:
            shifts_by_effect.setdefault(effect, {})[index] = shift_of_effect(effect, linear)
    return tuple(Effect(effect, shifts) for effect, shifts in shifts_by_effect.items())


def _with_effects(place: JointPlace, index: int, effects: Sequence[Effect]) -> JointPlace:
    """Return the map to a calibration's coordinates from the joint ones and the amounts."""
    columns = [effect.shifts.get(index, np.zeros(len(place.offset))) for effect in effects]
    return replace(place, matrix=np.column_stack([place.matrix, *columns]))


def _best_optimum(
    problem: JointProblem, progress: Progress
) -> tuple[FloatArray, list[CalibrationScore], Trace]:
    """Return the best optimum of the summed costs, the residuals weighted there, and the trace.

    Raises:
        NotConverged: no start leads to a finite joint fit.
    """
    best: tuple[float, FloatArray, list[CalibrationScore], Trace] | None = None
    for theta in _starts(problem):
        scores = [
            CalibrationScore.from_fit(fit).near(z)
            for fit, z in zip(problem.fitted, problem.at(theta), strict=True)
        ]
        try:
            for _ in range(MAX_ROUNDS):
                objective = stacked(problem.places, [score.local for score in scores])
                trace = levenberg_marquardt(
                    objective, theta, None, tolerance=MIN_DECREASE, progress=progress
                )
                settled = bool(np.allclose(trace.last, theta, rtol=0.0, atol=1e-6))
                theta = trace.last
                scores = [score.near(z) for score, z in zip(scores, problem.at(theta), strict=True)]
                if settled:
                    break
        except NotConverged:
            continue
        deviance = sum(
            score.deviance(z) for score, z in zip(scores, problem.at(theta), strict=True)
        )
        if np.isfinite(deviance) and (best is None or deviance < best[0]):
            best = (deviance, theta, scores, trace)
    if best is None:
        raise NotConverged(
            "No start value gives a finite joint fit: do these calibrations belong to one sensor?"
        )
    return best[1:]


def _starts(problem: JointProblem) -> list[FloatArray]:
    """Return joint coordinates whose shared ones are those of each calibration in turn.

    Each comes twice: with the delay of every calibration, and with its own delay for all.
    """
    fitted = problem.fitted
    starts = []
    for preferred, one_delay in itertools.product(range(len(fitted)), (False, True)):
        values = fitted[preferred].estimate.coordinates.values(fitted[preferred].estimate.z)
        theta = np.zeros(len(problem.numbers))
        for column, number in enumerate(problem.numbers):
            owner, index = next(
                (member for member in number.members if member[0] == preferred), number.members[0]
            )
            place = problem.places[owner]
            estimate = fitted[owner].estimate
            z = estimate.z[index]
            if one_delay and fitted[owner].evidence.model.parameters[index].describes == "channel":
                z = values.get(number.name, 0.0) / estimate.coordinates.time_unit_s
            theta[column] = (z - place.offset[index]) / place.matrix[index, column]
        if not any(np.allclose(theta, known, rtol=0.0, atol=1e-9) for known in starts):
            starts.append(theta)
    return starts


def _fits_elsewhere(
    problem: JointProblem, near: Sequence[CalibrationScore], theta: FloatArray
) -> set[int]:
    """Return calibrations whose separate fit is not the optimum near the joint estimate.

    A Gauss–Newton step from the joint estimate leads to that optimum. The gain that it promises is
    the gain of the separate fit, unless this is another optimum, too far off for the moment
    conditions, or the worse one.
    """
    elsewhere = set()
    for index, (fit, score, z) in enumerate(
        zip(problem.fitted, near, problem.at(theta), strict=True)
    ):
        at_joint, at_separate = (score.local(place) for place in (z, fit.estimate.z))
        gain = at_joint.cost - at_separate.cost + _promised_gain(at_separate)
        # Within one standard uncertainty, or a step promises at least half of the gain.
        if not abs(gain) <= 1.0 and not _promised_gain(at_joint) >= 0.5 * gain > 0.0:
            elsewhere.add(index)
    return elsewhere


def _promised_gain(local: Local) -> float:
    """Return by how much a full Gauss–Newton step would lower the cost."""
    return float(local.gradient @ inverse_normal(local.matrix) @ local.gradient)
