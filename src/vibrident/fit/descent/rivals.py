"""Other optima in the noise of an estimate: whichever is better, and those that are as good."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from vibrident.fit.descent.in_noise import iterate
from vibrident.fit.descent.settle import (
    NO_FIT,
    START_TOLERANCE,
    Descended,
    Settled,
    descend,
    settle,
)
from vibrident.fit.descent.weighting import Weighting
from vibrident.fit.optimise import Progress
from vibrident.fit.start.motion_and_noise import MotionAndNoise


def with_rivals(
    best: Settled, ends: Iterable[Descended], observed: MotionAndNoise, progress: Progress
) -> Settled:
    """Return the best estimate, with the other optima that descents from some ends lead to.

    In the noise of either of two places the better one leaves less; likelihoods, each in the noise
    that its own residual shows, differ by how that is smoothed.

    Args:
        best: the estimate.
        ends: of descents in the noise that is known without a model.
        observed: motion and noise before any model.
        progress: called after each iteration.
    """
    rivals = list(_optima_beside(best, ends, progress))
    if rivals:
        lowest = min(rivals, key=lambda end: end.at.cost)
        challenger = _settled_where_better(best, lowest, observed, progress)
        if challenger is not None:
            best = challenger
            rivals = list(_optima_beside(best, rivals, progress))
    values = best.coordinates.values(best.z)
    rival_optima = tuple(
        (end.at.cost - best.cost, end.values) for end in rivals if not end.is_at(values)
    )
    return replace(best, rival_optima=rival_optima)


def _optima_beside(
    estimate: Settled, ends: Iterable[Descended], progress: Progress
) -> Iterator[Descended]:
    """Yield the optima in the noise of an estimate, from the ends of other descents."""
    for end in ends:
        band = estimate.band.at_delay_of(end.values)
        z = estimate.coordinates.place(end.values)
        try:
            yield descend(
                band, estimate.coordinates, z, estimate.weighting, START_TOLERANCE, progress
            )
        except NO_FIT:
            continue


def _settled_where_better(
    best: Settled, end: Descended, observed: MotionAndNoise, progress: Progress
) -> Settled | None:
    """Return the estimate from the end of a descent, or None where it is no better."""
    if not end.at.cost < best.cost:
        return None
    try:
        challenger = settle(end, observed, best.weighting, progress)
    except NO_FIT:
        return None
    gain = _cost_of(best, challenger.weighting) - challenger.cost
    gain += best.cost - _cost_of(challenger, best.weighting)
    return challenger if gain > 0.0 else None


def _cost_of(estimate: Settled, weighting: Weighting) -> float:
    """Return V of an estimate in another noise."""
    band = weighting.with_nuisances(estimate.band)
    return iterate(band, estimate.coordinates, weighting.of_groups(band), estimate.z).cost
