"""The joint fit: first the sum of the calibrations' costs, robust against a bad separate fit, then their moments.

The sum of costs finds the place: Levenberg–Marquardt on the summed normal equations, from the separate estimates in
turn, each record weighted by its residual there. A separate fit that is worse on its own data had stopped at a local
optimum, and is repeated from there. The moments (:mod:`vibrident.joint.moments`) then weight each calibration by its
stated covariance, which gives the least variance.
"""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vibrident.errors import NotConverged
from vibrident.estimators.optimise import Progress, Trace, levenberg_marquardt
from vibrident.information import inverse_normal
from vibrident.joint.decays import FreeDecays
from vibrident.joint.moments import Moments, Score
from vibrident.joint.sharing import Joint, Place, places
from vibrident.judge import Fitted
from vibrident.problem import Local
from vibrident.records import FloatArray

ROUNDS = 4  # rounds of the sum of costs with refreshed weights, and of the moments with refreshed covariance
SETTLED = 1e-3  # change of the joint coordinates, in standard uncertainties, that ends the rounds
STEPS = 25  # most evaluations of the moments in a round
#: A separate fit was not an optimum if the joint fit's cost is lower by this part; the moments have left it if its cost
#: rises by this part.
BETTERED = 0.2
OTHER_FACTOR = 2.0  # a separate fit whose frequencies differ by more than this factor from the joint one's …
OTHER_U = 5.0  # … and by so many of its standard uncertainties is another optimum
UNSEEN = 1e-24  # a coordinate with less than this part of the largest information is not identifiable


@dataclass(frozen=True, eq=False)
class Descent:
    """The joint estimate."""

    numbers: tuple[Joint, ...]  # the parameters of the joint fit
    places: tuple[Place, ...]  # of each calibration
    balance: Balance  # the joint estimate
    near: tuple[Score, ...]  # each calibration's residual near it
    trace: Trace  # of the optimiser
    # calibrations whose own estimate is used; the other fits are worse than the joint one on their own data, or too far
    # from it
    alone: tuple[int, ...]
    fitted: tuple[Fitted, ...]  # the separate fits, after repetition
    decays: tuple[FreeDecays, ...] = ()  # calibrations of free decays alone
    beside: tuple[Place, ...] = ()  # the places of these


def summed(parts: Sequence[Place], local: Sequence[Callable[[FloatArray], Local]]) -> Callable[[Any, Any], Local]:
    """The calibrations' costs in the joint coordinates, as an objective."""

    def objective(theta: Any, _: Any) -> Local:
        at = np.asarray(theta)
        found = [one(place.z(at)) for place, one in zip(parts, local, strict=True)]
        matrix = sum(p.matrix.T @ f.matrix @ p.matrix for p, f in zip(parts, found, strict=True))
        gradient = sum(p.matrix.T @ f.gradient for p, f in zip(parts, found, strict=True))
        return Local(matrix, gradient, sum(f.cost for f in found))

    return objective


def descend(
    fitted: Sequence[Fitted],
    numbers: tuple[Joint, ...],
    covariance: Callable[[Fitted], FloatArray],
    progress: Progress,
    decays: Sequence[FreeDecays] = (),
) -> Descent:
    """Fit all calibrations together.

    Args:
        fitted: the separate fits.
        numbers: of :func:`vibrident.joint.sharing.joined`.
        covariance: the stated covariance of a separate fit from its data alone, shape (p, p).
        progress: called after each iteration of the optimiser.
        decays: calibrations of free decays alone.

    Raises:
        NotConverged: no start leads to a finite joint fit.
    """
    fitted = list(fitted)
    theta, near, trace = _found(fitted, numbers, progress, decays)
    parts = places(numbers, [one.estimate.coordinates for one in fitted])
    repeated = [i for i, one in enumerate(fitted) if _bettered(one, near[i], parts[i].z(theta))]
    if repeated:
        for i in repeated:
            values = fitted[i].estimate.coordinates.values(parts[i].z(theta))
            with contextlib.suppress(NotConverged):  # then the first fit stays
                fitted[i] = fitted[i].again(values, progress)
        theta, near, trace = _found(fitted, numbers, progress, decays)
        parts = places(numbers, [one.estimate.coordinates for one in fitted])
    beside = _places_beside(decays, numbers, parts, fitted)
    there = [place.z(theta) for place in parts]
    lost = {i for i, one in enumerate(fitted) if _bettered(one, near[i], there[i]) or _elsewhere(one, there[i])}
    while True:
        moments = _moments(fitted, near, parts, theta, lost, covariance)
        balance = _balanced(moments, parts, theta, progress, decays, beside)
        left = {i for i, one in enumerate(fitted) if i not in lost and _left(one, near[i], parts[i], theta, balance)}
        if not left:
            break
        lost |= left
    trace = _followed(trace, balance.theta, summed(parts, [score.local for score in near]))
    alone = tuple(i for i in range(len(fitted)) if i not in lost)
    return Descent(numbers, parts, balance, tuple(near), trace, alone, tuple(fitted), tuple(decays), beside)


def _places_beside(
    decays: Sequence[FreeDecays], numbers: tuple[Joint, ...], parts: Sequence[Place], fitted: Sequence[Fitted]
) -> tuple[Place, ...]:
    coordinates = [one.estimate.coordinates for one in fitted]
    return tuple(one.place(numbers, parts, coordinates) for one in decays)


@dataclass(frozen=True, eq=False)
class Balance:
    """The joint estimate by moments."""

    theta: FloatArray  # joint coordinates, shape (q,)
    covariance: FloatArray  # of theta, shape (q, q)
    information: tuple[FloatArray, ...]  # of each calibration's coordinates, shapes (p, p)
    steps: tuple[FloatArray, ...]  # from the joint estimate to each calibration's own, to first order, shapes (p,)


def _moments(
    fitted: Sequence[Fitted],
    near: Sequence[Score],
    parts: Sequence[Place],
    theta: FloatArray,
    lost: set[int],
    covariance: Callable[[Fitted], FloatArray],
) -> list[Moments]:
    found = []
    for i, one in enumerate(fitted):
        z = parts[i].z(theta)
        if i in lost:
            scatter = one.judgement.scatter or 1.0
            found.append(Moments.plain(near[i], z, near[i].colour(z) * scatter**2))
        else:
            own = Score.of(one).near(one.estimate.z)
            found.append(Moments.of(own, one.estimate.z, covariance(one), near[i]))
    return found


def _balanced(
    moments: Sequence[Moments],
    parts: Sequence[Place],
    theta: FloatArray,
    progress: Progress,
    decays: Sequence[FreeDecays],
    beside: Sequence[Place],
) -> Balance:
    for _ in range(ROUNDS):
        weights = [m.weight(place.z(theta)) for m, place in zip(moments, parts, strict=True)]
        local = [_held(m, weight) for m, weight in zip(moments, weights, strict=True)]
        objective = summed([*parts, *beside], [*local, *(one.local for one in decays)])
        way = levenberg_marquardt(objective, theta, None, tolerance=1e-6, most=STEPS, progress=progress)
        information = tuple(m.information(place.z(way.last)) for m, place in zip(moments, parts, strict=True))
        known = [*information, *(one.information for one in decays)]
        whole = sum(p.matrix.T @ i @ p.matrix for p, i in zip([*parts, *beside], known, strict=True))
        joint = inverse_normal(np.asarray(whole))
        moved = np.abs(way.last - theta) / np.sqrt(np.maximum(np.diag(joint), np.finfo(float).tiny))
        theta = way.last
        if np.max(moved) < SETTLED:
            break
    steps = tuple(m.step(place.z(theta)) for m, place in zip(moments, parts, strict=True))
    return Balance(theta, joint, information, steps)


def _held(moments: Moments, weight: FloatArray) -> Callable[[FloatArray], Local]:
    return lambda z: moments.local(z, weight)


def _found(
    fitted: Sequence[Fitted], numbers: tuple[Joint, ...], progress: Progress, decays: Sequence[FreeDecays]
) -> tuple[FloatArray, list[Score], Trace]:
    """The best optimum of the summed costs, the residuals weighted there, and the trace."""
    parts = places(numbers, [one.estimate.coordinates for one in fitted])
    beside = _places_beside(decays, numbers, parts, fitted)
    best: tuple[float, FloatArray, list[Score], Trace] | None = None
    for theta in _starts(fitted, numbers, parts):
        scores = [Score.of(one).near(p.z(theta)) for one, p in zip(fitted, parts, strict=True)]
        try:
            for _ in range(ROUNDS):
                local = [*(score.local for score in scores), *(one.local for one in decays)]
                objective = summed([*parts, *beside], local)
                trace = levenberg_marquardt(objective, theta, None, tolerance=1e-6, progress=progress)
                settled = bool(np.allclose(trace.last, theta, rtol=0.0, atol=1e-6))
                theta = trace.last
                scores = [score.near(p.z(theta)) for score, p in zip(scores, parts, strict=True)]
                if settled:
                    break
        except NotConverged:
            continue
        deviance = sum(score.deviance(p.z(theta)) for score, p in zip(scores, parts, strict=True))
        deviance += sum(one.local(p.z(theta)).cost for one, p in zip(decays, beside, strict=True))
        if np.isfinite(deviance) and (best is None or deviance < best[0]):
            best = (deviance, theta, scores, trace)
    if best is None:
        raise NotConverged("No start value gives a finite joint fit: do these calibrations belong to one sensor?")
    return best[1:]


def _starts(fitted: Sequence[Fitted], numbers: tuple[Joint, ...], parts: Sequence[Place]) -> list[FloatArray]:
    """Joint coordinates by each calibration in turn: shared ones from it, and once more with its delay for all."""
    starts = []
    for preferred, by_preferred in itertools.product(range(len(fitted)), (False, True)):
        values = fitted[preferred].estimate.coordinates.values(fitted[preferred].estimate.z)
        theta = np.zeros(len(numbers))
        for column, number in enumerate(numbers):
            owner, index = next((m for m in number.members if m[0] == preferred), number.members[0])
            offset, scale = parts[owner].offset[index], parts[owner].matrix[index, column]
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


def _left(one: Fitted, near: Score, place: Place, theta: FloatArray, balance: Balance) -> bool:
    """Whether the moments have left the optimum of these data."""
    if near.noise is None:
        return False
    own = replace(Score.of(one), noise=near.noise).local(one.estimate.z).cost
    most = (1.0 + BETTERED) * max(near.local(place.z(theta)).cost, own)
    return not near.local(place.z(balance.theta)).cost < most


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
