"""The joint fit, stacked: first the sum of all costs, robust against a bad separate fit, then moment conditions.

The sum of costs finds the place: Levenberg–Marquardt on the summed normal equations, from the separate estimates in
turn, each record weighted by its residual there. A separate fit that stopped at another optimum is repeated from there.
The moment conditions (:mod:`vibrident.fit.joint.moments`) then weight each calibration by its stated covariance, and
the stated systematic effects are columns beside the parameters, each with an amount whose prior is N(0, 1) in its
standard uncertainties (random effects; with the amounts eliminated, by Woodbury's identity, the estimate of generalised
least squares). A calibration against a better reference thus has the greater weight on what the references limit.
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
from vibrident.fit.joint.moments import MomentConditions, Score
from vibrident.fit.joint.sharing import Joint, Place, places
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.optimise import Objective, Progress, Trace, levenberg_marquardt
from vibrident.fit.problem import Local
from vibrident.fit.uncertainty.budget import shift_of_effect

ROUNDS = 4  # most rounds of the sum of costs, and of the moments, with refreshed weights
TOLERANCE = 1e-6  # decrease of a cost that is not worth a step: 10⁻³ standard uncertainties

Parts = Sequence[Callable[[FloatArray], Local]]


@dataclass(frozen=True, eq=False)
class Together:
    """The calibrations of a joint fit, and where their coordinates lie in its own."""

    fitted: tuple[Fitted, ...]  # the separate fits
    numbers: tuple[Joint, ...]  # the parameters of the joint fit

    @functools.cached_property
    def places(self) -> tuple[Place, ...]:
        """Of the fits."""
        return places(self.numbers, [one.estimate.coordinates for one in self.fitted])

    def at(self, theta: FloatArray) -> list[FloatArray]:
        """Coordinates of each fit."""
        return [place.z(theta) for place in self.places]


def stacked(where: Sequence[Place], parts: Parts, prior: FloatArray | float = 0.0) -> Objective:
    """The costs of calibrations in the coordinates of the joint fit, as one objective.

    ``where``: of each in these; ``prior``: information on these about zero, of each, shape (q,).
    """

    def objective(theta: FloatArray, _: object) -> Local:
        found = [part(place.z(theta)) for place, part in zip(where, parts, strict=True)]
        matrix = sum(p.matrix.T @ f.matrix @ p.matrix for p, f in zip(where, found, strict=True))
        gradient = sum(p.matrix.T @ f.gradient for p, f in zip(where, found, strict=True))
        held = prior * theta
        return Local(
            matrix + np.diag(prior * np.ones_like(theta)),
            gradient - held,
            sum(f.cost for f in found) + float(held @ theta),
        )

    return objective


@dataclass(frozen=True, eq=False)
class Effect:
    """A systematic effect, and the change of each calibration that has it by one standard uncertainty, shape (p,)."""

    effect: SystematicEffect
    shifts: dict[int, FloatArray]


@dataclass(frozen=True, eq=False)
class Balance:
    """The joint estimate by moments."""

    theta: FloatArray  # joint coordinates, shape (q,)
    covariance: FloatArray  # of these and of the amounts of the effects, shape (q + K, q + K)
    places: tuple[Place, ...]  # of each fit in both
    information: tuple[FloatArray, ...]  # of the coordinates of each fit, shapes (p, p)
    estimates: tuple[
        FloatArray, ...
    ]  # of each fit alone; to first order where its own is not used, shapes (p,)

    def by_data(self, index: int) -> FloatArray:
        """What the data of a calibration add to the covariance of theta, shape (q, q)."""
        gain = self.covariance[: len(self.theta)] @ self.places[index].matrix.T
        return gain @ self.information[index] @ gain.T

    def by_effect(self, number: int) -> FloatArray:
        """What one standard uncertainty of an effect does to theta, shape (q,)."""
        return self.covariance[: len(self.theta), len(self.theta) + number]


@dataclass(frozen=True, eq=False)
class Descent:
    """The joint estimate."""

    together: Together  # what was fitted, after repetition
    effects: tuple[Effect, ...]  # each once
    balance: Balance
    near: tuple[Score, ...]  # residual of each fit near the joint estimate
    trace: Trace  # of the optimiser
    alone: tuple[int, ...]  # fits whose own estimate is used; others ended at another optimum


def descend(
    together: Together, covariance: Callable[[Fitted], FloatArray], progress: Progress
) -> Descent:
    """Fit all calibrations together; ``covariance`` states that of a separate fit from its data alone, shape (p, p).

    Raises:
        NotConverged: no start leads to a finite joint fit.
    """
    theta, near, trace = _found(together, progress)
    lost = _elsewhere(together, near, theta)
    if lost:
        fitted = list(together.fitted)
        for i in lost:
            values = fitted[i].estimate.coordinates.values(together.at(theta)[i])
            with contextlib.suppress(NotConverged):  # then the first fit stays
                fitted[i] = fitted[i].anew(fitted[i].evidence, values)
        together = replace(together, fitted=tuple(fitted))
        theta, near, trace = _found(together, progress)
        lost = _elsewhere(together, near, theta)
    while True:
        balance, effects = _balanced(together, near, theta, lost, covariance, progress)
        left = _elsewhere(together, near, balance.theta) - lost
        if not left:
            break
        lost |= left
    cost = stacked(together.places, [score.local for score in near])(balance.theta, None).cost
    path = np.concatenate([trace.coordinates, balance.theta[None]])
    status = f"{trace.status}; the last point: each calibration weighted by its stated covariance"
    trace = Trace(trace.optimiser, trace.converged, status, (*trace.costs, float(cost)), path)
    alone = tuple(i for i in range(len(together.fitted)) if i not in lost)
    return Descent(together, effects, balance, tuple(near), trace, alone)


def _balanced(
    together: Together,
    near: Sequence[Score],
    theta: FloatArray,
    lost: set[int],
    covariance: Callable[[Fitted], FloatArray],
    progress: Progress,
) -> tuple[Balance, tuple[Effect, ...]]:
    """The joint estimate by moments, from where the sum of costs led; ``lost``: fits whose own estimate is not used."""
    moments = []
    there = together.at(theta)
    for i, (one, z) in enumerate(zip(together.fitted, there, strict=True)):
        if i in lost:
            spread = near[i].covariance(z) * (one.judgement.scatter or 1.0) ** 2
            moments.append(MomentConditions.of(near[i], z, spread, near[i], optimum=False))
        else:
            moments.append(
                MomentConditions.of(Score.of(one), one.estimate.z, covariance(one), near[i])
            )
    effects = _effects(together.fitted, there)
    where = tuple(_with_effects(place, i, effects) for i, place in enumerate(together.places))
    prior = np.concatenate([np.zeros(len(theta)), np.ones(len(effects))])
    way = np.concatenate([theta, np.zeros(len(effects))])
    for _ in range(ROUNDS):
        begin = way
        there = [place.z(way) for place in where]
        parts = [
            functools.partial(m.local, weight=m.weight(z))
            for m, z in zip(moments, there, strict=True)
        ]
        way = levenberg_marquardt(
            stacked(where, parts, prior), begin, None, tolerance=TOLERANCE, progress=progress
        ).last
        if np.allclose(way, begin, rtol=0.0, atol=1e-6):
            break
    known = tuple(m.information(place.z(way)) for m, place in zip(moments, where, strict=True))
    whole = sum(p.matrix.T @ i @ p.matrix for p, i in zip(where, known, strict=True)) + np.diag(
        prior
    )
    estimates = [
        one.estimate.z if i not in lost else place.z(way) + moments[i].step(place.z(way))
        for i, (one, place) in enumerate(zip(together.fitted, where, strict=True))
    ]
    return Balance(
        way[: len(theta)], inverse_normal(np.asarray(whole)), where, known, tuple(estimates)
    ), effects


def _effects(fitted: Sequence[Fitted], there: Sequence[FloatArray]) -> tuple[Effect, ...]:
    """Every systematic effect once: equal statements in two calibrations are one effect, as of one instrument.

    At the joint values ``there``: relative effects at each measured value would draw these down (Peelle's puzzle;
    D'Agostini 1994).
    """
    found: dict[SystematicEffect, dict[int, FloatArray]] = {}
    for index, (one, z) in enumerate(zip(fitted, there, strict=True)):
        linear = replace(one, estimate=replace(one.estimate, z=z)).linear
        for effect in one.effects:
            found.setdefault(effect, {})[index] = shift_of_effect(effect, linear)
    return tuple(Effect(effect, shifts) for effect, shifts in found.items())


def _with_effects(place: Place, index: int, effects: Sequence[Effect]) -> Place:
    """The place of a calibration in the joint coordinates and the amounts of the effects."""
    columns = [effect.shifts.get(index, np.zeros(len(place.offset))) for effect in effects]
    return replace(place, matrix=np.column_stack([place.matrix, *columns]))


def _found(together: Together, progress: Progress) -> tuple[FloatArray, list[Score], Trace]:
    """The best optimum of the summed costs, the residuals weighted there, and the trace."""
    best: tuple[float, FloatArray, list[Score], Trace] | None = None
    for theta in _starts(together):
        scores = [
            Score.of(one).near(z)
            for one, z in zip(together.fitted, together.at(theta), strict=True)
        ]
        try:
            for _ in range(ROUNDS):
                objective = stacked(together.places, [score.local for score in scores])
                trace = levenberg_marquardt(
                    objective, theta, None, tolerance=TOLERANCE, progress=progress
                )
                settled = bool(np.allclose(trace.last, theta, rtol=0.0, atol=1e-6))
                theta = trace.last
                scores = [
                    score.near(z) for score, z in zip(scores, together.at(theta), strict=True)
                ]
                if settled:
                    break
        except NotConverged:
            continue
        deviance = sum(
            score.deviance(z) for score, z in zip(scores, together.at(theta), strict=True)
        )
        if np.isfinite(deviance) and (best is None or deviance < best[0]):
            best = (deviance, theta, scores, trace)
    if best is None:
        raise NotConverged(
            "No start value gives a finite joint fit: do these calibrations belong to one sensor?"
        )
    return best[1:]


def _starts(together: Together) -> list[FloatArray]:
    """Joint coordinates by each calibration in turn: shared ones from it, and once more with its delay for all."""
    fitted = together.fitted
    starts = []
    for preferred, by_preferred in itertools.product(range(len(fitted)), (False, True)):
        values = fitted[preferred].estimate.coordinates.values(fitted[preferred].estimate.z)
        theta = np.zeros(len(together.numbers))
        for column, number in enumerate(together.numbers):
            owner, index = next((m for m in number.members if m[0] == preferred), number.members[0])
            place = together.places[owner]
            estimate = fitted[owner].estimate
            z = estimate.z[index]
            if (
                by_preferred
                and fitted[owner].evidence.model.parameters[index].describes == "channel"
            ):
                z = values.get(number.name, 0.0) / estimate.coordinates.time_unit_s
            theta[column] = (z - place.offset[index]) / place.matrix[index, column]
        if not any(np.allclose(theta, other, rtol=0.0, atol=1e-9) for other in starts):
            starts.append(theta)
    return starts


def _elsewhere(together: Together, near: Sequence[Score], theta: FloatArray) -> set[int]:
    """Calibrations whose own fit is not the optimum that a Gauss–Newton step from the joint estimate leads to.

    What that step promises is what the own optimum gains, unless this is another one or too far off for the moment
    conditions; or the own fit is the worse one.
    """
    found = set()
    for i, (one, score, z) in enumerate(
        zip(together.fitted, near, together.at(theta), strict=True)
    ):
        here, own = (score.local(at) for at in (z, one.estimate.z))
        gains = here.cost - own.cost + _promised(own)
        # Within one standard uncertainty, or a step promises at least half of what is gained.
        if not abs(gains) <= 1.0 and not _promised(here) >= 0.5 * gains > 0.0:
            found.add(i)
    return found


def _promised(local: Local) -> float:
    """What a full Gauss–Newton step would lower the cost by."""
    return float(local.gradient @ inverse_normal(local.matrix) @ local.gradient)
