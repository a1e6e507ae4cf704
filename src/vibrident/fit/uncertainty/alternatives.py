"""Is there another solution that fits as well? Then the data do not choose, and it is named.

Two sources. Some parameters give exactly the same response (:mod:`vibrident.physics.models.labels`): a rule chose,
which is said where the others mean another sensor, or where noise decides between the labels. And the search for start
values met other optima: each is brought down the residual of the points once more, and counts where it explains them as
well. Two modes beyond the band trade against each other along a curved valley, which leads further than the standard
uncertainties say, as these know its direction at the estimate alone. There each parameter in turn is held far from
its estimate and the others follow: what fits as well is a solution, too. In other models the interval of what is hardly
determined says as much (:mod:`vibrident.fit.uncertainty.profile`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from vibrident.base.amounts import amount
from vibrident.data.records import Quantity
from vibrident.fit.information import inverse_normal
from vibrident.fit.start.search import (
    LogCoordinates,
    Residual,
    TargetFRF,
    descend,
    differences,
    information_at,
)
from vibrident.fit.start.start import Start
from vibrident.fit.uncertainty.parameters import WEAK
from vibrident.physics.models import SensorModel
from vibrident.physics.models.labels import canonical, labels_of, relabellings
from vibrident.physics.naming import in_words
from vibrident.result import ResultWarning

ALIKE = (
    9.0  # another optimum is as good where its χ² is larger by less: the true one in 1 of 370 cases
)
STEPS = 30  # on the way down


@dataclass(frozen=True)
class Solution:
    """An estimate, in the one form of its labels."""

    values: Mapping[str, float]  # of the parameters, by name
    uncertainty: Mapping[str, float]  # standard uncertainty of each


def other_solutions(
    model: SensorModel,
    quantity: Quantity,
    sought: TargetFRF,
    solution: Solution,
    begin: Start | None,
    units: Mapping[str, str],
) -> Iterator[ResultWarning]:
    """A warning ``weakly_determined`` for each solution that fits as well as the estimate.

    ``model``: a linear model; ``quantity``: what the reference is; ``sought``: the points, with their deviations;
    ``solution``: the estimate; ``begin``: the start, with the other optima that were met.
    """
    values = solution.values
    uncertainty = solution.uncertainty
    same = [
        {name: float(value) for name, value in change(values).items()}
        for change in relabellings(model, values)
    ]
    labels = labels_of(model)
    if same and labels is not None and labels.undecided(values, uncertainty):
        others = "; or ".join(_listed(other, units) for other in same)
        text = f"The response does not tell {labels.question}. The same response: {others}."
        yield ResultWarning("weakly_determined", text)
    chart = LogCoordinates(
        model,
        quantity,
        sought.frequency_hz,
        1.0 / (2.0 * np.pi * float(np.max(sought.frequency_hz))),
    )
    found = list(_met(chart, differences(sought), solution, begin))
    if model.shares:
        found += _along_the_valley(chart, differences(sought), solution)
    named: list[Mapping[str, float]] = [values]
    for more, other in found:
        mine = canonical(model, other)
        if more < ALIKE and all(_differ(mine, one, uncertainty, chart) for one in named):
            named.append(mine)
            yield _as_good(mine, solution, more, units)


def _met(
    chart: LogCoordinates, goal: Residual, solution: Solution, begin: Start | None
) -> Iterator[tuple[float, dict[str, float]]]:
    """The optima that the search for start values met, and by how much their χ² is larger than the estimate's."""
    if begin is None or not begin.others:
        return
    placed = [chart.place(dict(at)) for at in (solution.values, *(at for at, _ in begin.others))]
    u = np.array([p for p, _ in placed])
    sign = np.array([s for _, s in placed])
    front = descend(chart, u, sign, goal, STEPS)
    if np.isfinite(front.cost[0]):
        for row in range(1, len(u)):
            yield float(front.cost[row] - front.cost[0]), chart.named(front.u, front.sign, row)


def _along_the_valley(
    chart: LogCoordinates, goal: Residual, solution: Solution
) -> Iterator[tuple[float, dict[str, float]]]:
    """As :func:`_met`, the furthest first: optima with one parameter that is not weak held six of its u away."""
    u, sign = chart.place(dict(solution.values))
    above, _ = chart.place(
        {name: value + solution.uncertainty[name] for name, value in solution.values.items()}
    )
    first = descend(chart, u[None], np.array([sign]), goal, 0)
    here = descend(chart, u[None], np.array([sign]), goal, STEPS)
    if not np.isfinite(first.cost[0]):
        return
    # The estimate is not the optimum of the points alone; what fits them as well as it does counts, up to a limit.
    least = min(float(first.cost[0]), float(here.cost[0]) + ALIKE)
    covariance = inverse_normal(information_at(chart, here.u, here.sign, goal)[0])
    spread = np.sqrt(np.diag(covariance))
    stated = np.maximum(np.abs(above - u), spread)
    turns = [(k, side) for k in np.flatnonzero(stated < WEAK).tolist() for side in (-6.0, 6.0)]
    if not turns:
        return
    # The others begin where they would follow along a straight line.
    moved = np.array([side * stated[k] / spread[k] ** 2 * covariance[k] for k, side in turns])
    held = np.zeros(moved.shape, dtype=bool)
    held[np.arange(len(turns)), [k for k, _ in turns]] = True
    front = descend(chart, here.u + moved, np.full(len(turns), here.sign[0]), goal, STEPS, held)
    for row in np.argsort(-np.max(np.abs(front.u - u) / stated, axis=1), kind="stable").tolist():
        yield float(front.cost[row] - least), chart.named(front.u, front.sign, row)


def _differ(
    one: Mapping[str, float],
    other: Mapping[str, float],
    uncertainty: Mapping[str, float],
    chart: LogCoordinates,
) -> bool:
    """Whether a parameter differs by five u and a hundredth of its value.

    Delays a period of the highest frequency apart are one solution, written twice.
    """
    delays = [spec.name for spec in chart.model.parameters if spec.kind == "time"]
    later = sum(one[name] - other[name] for name in delays)
    if abs(later) * float(np.max(chart.frequency_hz)) > 0.4:
        return False
    return any(
        abs(value - other[name]) > max(5.0 * uncertainty[name], 0.01 * abs(other[name]))
        for name, value in one.items()
        if name not in delays
    )


def _as_good(
    other: Mapping[str, float], solution: Solution, more: float, units: Mapping[str, str]
) -> ResultWarning:
    values = solution.values
    uncertainty = solution.uncertainty
    changed = {
        n: v
        for n, v in other.items()
        if abs(v - values[n]) > min(1e-3 * abs(values[n]), 3.0 * uncertainty[n])
    }
    text = f"Another solution explains the data as well (χ² larger by {max(more, 0.0):.2g}): {_listed(changed, units)}."
    return ResultWarning("weakly_determined", f"{text} A wider band of frequencies would tell.")


def _listed(values: Mapping[str, float], units: Mapping[str, str]) -> str:
    return ", ".join(
        f"{in_words(name)} {amount(value, units[name])}" for name, value in values.items()
    )
