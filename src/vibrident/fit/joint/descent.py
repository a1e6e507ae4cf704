"""The joint fit: first the sum of the calibrations' costs, robust against a bad separate fit, then their moments.

The sum of costs finds the place: Levenberg–Marquardt on the summed normal equations, from the separate estimates in
turn, each record weighted by its residual there. A separate fit that is worse on its own data had stopped at a local
optimum, and is repeated from there. The moments (:mod:`vibrident.fit.joint.moments`) then weight each calibration by
its stated covariance, which gives the least variance.
"""

from __future__ import annotations

import contextlib
import functools
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vibrident.base.errors import NotConverged
from vibrident.data.records import FloatArray
from vibrident.fit.descent.optimise import Progress, Trace, levenberg_marquardt
from vibrident.fit.information import inverse_normal
from vibrident.fit.joint.decays import FreeDecays, with_decays
from vibrident.fit.joint.moments import MomentConditions, Score
from vibrident.fit.joint.sharing import Joint, Place, places
from vibrident.fit.judge import Fitted
from vibrident.fit.problem import Local

ROUNDS = 4  # rounds of the sum of costs with refreshed weights, and of the moments with refreshed covariance
SETTLED = 1e-3  # change of the joint coordinates, in standard uncertainties, that ends the rounds
STEPS = 25  # most evaluations of the moments in a round
#: A separate fit was no optimum if the joint cost is lower by this part; the moments have left it if it is higher.
BETTERED = 0.2
OTHER_FACTOR = 2.0  # a separate fit whose frequencies differ by more than this factor from the joint one's …
OTHER_U = 5.0  # … and by so many of its standard uncertainties is another optimum
UNSEEN = 1e-24  # a coordinate with less than this part of the largest information is not identifiable


@dataclass(frozen=True, eq=False)
class Together:
    """The calibrations of a joint fit, and where their coordinates lie in its own."""

    fitted: tuple[Fitted, ...]  # the separate fits
    decays: tuple[FreeDecays, ...]  # calibrations of free decays alone
    numbers: tuple[Joint, ...]  # the parameters of the joint fit

    @functools.cached_property
    def places(self) -> tuple[Place, ...]:
        """Of the fits, then of the decays."""
        coordinates = [one.estimate.coordinates for one in self.fitted]
        parts = places(self.numbers, coordinates)
        return (*parts, *(one.place(self.numbers, parts, coordinates) for one in self.decays))

    @functools.cached_property
    def whole(self) -> tuple[Joint, ...]:
        """The numbers with the decays among their members."""
        return with_decays(self.numbers, self.decays, len(self.fitted))

    def at(self, theta: FloatArray) -> list[FloatArray]:
        """Coordinates of each fit."""
        return [place.z(theta) for place in self.places[: len(self.fitted)]]

    def summed(self, local: Sequence[Callable[[FloatArray], Local]]) -> Callable[[Any, Any], Local]:
        """The costs of the fits, and of the decays, in the joint coordinates, as an objective."""
        every = [*local, *(one.local for one in self.decays)]

        def objective(theta: Any, _: Any) -> Local:
            at = np.asarray(theta)
            found = [one(place.z(at)) for place, one in zip(self.places, every, strict=True)]
            matrix = sum(p.matrix.T @ f.matrix @ p.matrix for p, f in zip(self.places, found, strict=True))
            gradient = sum(p.matrix.T @ f.gradient for p, f in zip(self.places, found, strict=True))
            return Local(matrix, gradient, sum(f.cost for f in found))

        return objective


@dataclass(frozen=True, eq=False)
class Balance:
    """The joint estimate by moments."""

    theta: FloatArray  # joint coordinates, shape (q,)
    covariance: FloatArray  # of theta, shape (q, q)
    information: tuple[FloatArray, ...]  # of the coordinates of each fit, then of the decays, shapes (p, p)
    steps: tuple[FloatArray, ...]  # from the joint estimate to each fit's own, to first order, shapes (p,)


@dataclass(frozen=True, eq=False)
class Descent:
    """The joint estimate."""

    together: Together  # what was fitted, after repetition
    balance: Balance
    near: tuple[Score, ...]  # residual of each fit near the joint estimate
    trace: Trace  # of the optimiser
    alone: tuple[int, ...]  # fits whose own estimate is used; others are worse on their own data, or too far off


def descend(together: Together, covariance: Callable[[Fitted], FloatArray], progress: Progress) -> Descent:
    """Fit all calibrations together; ``covariance`` states that of a separate fit from its data alone, shape (p, p).

    Raises:
        NotConverged: no start leads to a finite joint fit.
    """
    theta, near, trace = _found(together, progress)
    fitted, there = list(together.fitted), together.at(theta)
    repeated = [i for i, one in enumerate(fitted) if _bettered(one, near[i], there[i])]
    if repeated:
        for i in repeated:
            values = fitted[i].estimate.coordinates.values(there[i])
            with contextlib.suppress(NotConverged):  # then the first fit stays
                fitted[i] = fitted[i].again(values, progress)
        together = replace(together, fitted=tuple(fitted))
        theta, near, trace = _found(together, progress)
        there = together.at(theta)
    lost = {i for i, one in enumerate(fitted) if _bettered(one, near[i], there[i]) or _elsewhere(one, there[i])}
    while True:
        moments = []
        for i, (one, z) in enumerate(zip(fitted, there, strict=True)):
            if i in lost:
                variance = near[i].colour(z) * (one.judgement.scatter or 1.0) ** 2
                moments.append(MomentConditions.plain(near[i], z, variance))
            else:
                own = Score.of(one).near(one.estimate.z)
                moments.append(MomentConditions.of(own, one.estimate.z, covariance(one), near[i]))
        balance = _balanced(together, moments, theta, progress)
        moved = together.at(balance.theta)
        left = {i for i, one in enumerate(fitted) if i not in lost and _left(one, near[i], there[i], moved[i])}
        if not left:
            break
        lost |= left
    led = replace(together, decays=())
    trace = _followed(trace, balance.theta, led.summed([score.local for score in near]))
    return Descent(together, balance, tuple(near), trace, tuple(i for i in range(len(fitted)) if i not in lost))


def _balanced(
    together: Together, moments: Sequence[MomentConditions], theta: FloatArray, progress: Progress
) -> Balance:
    for _ in range(ROUNDS):
        local = [_held(m, m.weight(z)) for m, z in zip(moments, together.at(theta), strict=True)]
        way = levenberg_marquardt(together.summed(local), theta, None, tolerance=1e-6, most=STEPS, progress=progress)
        known = [m.information(z) for m, z in zip(moments, together.at(way.last), strict=True)]
        known += [one.information for one in together.decays]
        whole = sum(p.matrix.T @ i @ p.matrix for p, i in zip(together.places, known, strict=True))
        joint = inverse_normal(np.asarray(whole))
        moved = np.abs(way.last - theta) / np.sqrt(np.maximum(np.diag(joint), np.finfo(float).tiny))
        theta = way.last
        if np.max(moved) < SETTLED:
            break
    steps = tuple(m.step(z) for m, z in zip(moments, together.at(theta), strict=True))
    return Balance(theta, joint, tuple(known), steps)


def _held(moments: MomentConditions, weight: FloatArray) -> Callable[[FloatArray], Local]:
    return lambda z: moments.local(z, weight)


def _found(together: Together, progress: Progress) -> tuple[FloatArray, list[Score], Trace]:
    """The best optimum of the summed costs, the residuals weighted there, and the trace."""
    best: tuple[float, FloatArray, list[Score], Trace] | None = None
    for theta in _starts(together):
        scores = [Score.of(one).near(z) for one, z in zip(together.fitted, together.at(theta), strict=True)]
        try:
            for _ in range(ROUNDS):
                objective = together.summed([score.local for score in scores])
                trace = levenberg_marquardt(objective, theta, None, tolerance=1e-6, progress=progress)
                settled = bool(np.allclose(trace.last, theta, rtol=0.0, atol=1e-6))
                theta = trace.last
                scores = [score.near(z) for score, z in zip(scores, together.at(theta), strict=True)]
                if settled:
                    break
        except NotConverged:
            continue
        deviance = sum(score.deviance(z) for score, z in zip(scores, together.at(theta), strict=True))
        beside = together.places[len(together.fitted) :]
        deviance += sum(one.local(p.z(theta)).cost for one, p in zip(together.decays, beside, strict=True))
        if np.isfinite(deviance) and (best is None or deviance < best[0]):
            best = (deviance, theta, scores, trace)
    if best is None:
        raise NotConverged("No start value gives a finite joint fit: do these calibrations belong to one sensor?")
    return best[1:]


def _starts(together: Together) -> list[FloatArray]:
    """Joint coordinates by each calibration in turn: shared ones from it, and once more with its delay for all."""
    fitted, starts = together.fitted, []
    for preferred, by_preferred in itertools.product(range(len(fitted)), (False, True)):
        values = fitted[preferred].estimate.coordinates.values(fitted[preferred].estimate.z)
        theta = np.zeros(len(together.numbers))
        for column, number in enumerate(together.numbers):
            owner, index = next((m for m in number.members if m[0] == preferred), number.members[0])
            place = together.places[owner]
            offset, scale = place.offset[index], place.matrix[index, column]
            theta[column] = (fitted[owner].estimate.z[index] - offset) / scale
            model = fitted[owner].evidence.model
            if by_preferred and model.parameters[index].describes == "channel":
                unit = fitted[owner].estimate.coordinates.time_unit_s
                theta[column] = (values.get(number.name, 0.0) / unit - offset) / scale
        if not any(np.allclose(theta, other, rtol=0.0, atol=1e-9) for other in starts):
            starts.append(theta)
    return starts


def _bettered(one: Fitted, near: Score, z: FloatArray) -> bool:
    """Whether the joint fit explains these data better than their own fit did."""
    before = replace(Score.of(one), noise=near.noise).local(one.estimate.z).cost
    return _at_end(one) or near.local(z).cost < (1.0 - BETTERED) * before


def _left(one: Fitted, near: Score, there: FloatArray, moved: FloatArray) -> bool:
    """Whether the moments have left the optimum of these data, from ``there`` to ``moved``."""
    if near.noise is None:
        return False
    own = replace(Score.of(one), noise=near.noise).local(one.estimate.z).cost
    most = (1.0 + BETTERED) * max(near.local(there).cost, own)
    return not near.local(moved).cost < most


def _at_end(one: Fitted) -> bool:
    """Whether a parameter lies at the end of the range searched, where the data do not determine it."""
    diagonal = np.diag(Score.of(one).local(one.estimate.z).matrix)
    return not np.all(diagonal > UNSEEN * np.max(diagonal))  # also for NaN


def _elsewhere(one: Fitted, z: FloatArray) -> bool:
    """Whether a separate fit ended at another optimum than the joint one, where its slopes say nothing of this."""
    own = one.estimate
    logarithmic = [spec.kind in ("log", "duration") for spec in own.coordinates.model.parameters]
    scatter = one.judgement.scatter or 1.0
    u = scatter * np.sqrt(np.maximum(np.diag(own.covariance), 0.0))
    apart = np.abs(own.z - z)
    return bool(np.any((apart > np.maximum(np.log(OTHER_FACTOR), OTHER_U * u))[logarithmic]))


def _followed(trace: Trace, theta: FloatArray, objective: Callable[[Any, Any], Local]) -> Trace:
    """The trace with the last step, by the moments."""
    cost = float(objective(theta, None).cost)
    path = np.concatenate([trace.coordinates, theta[None]])
    status = f"{trace.status}; the last point: each calibration weighted by its stated covariance"
    return Trace(trace.optimiser, trace.converged, status, (*trace.costs, cost), path)
