"""Is there another solution that fits as well? Then the data do not choose, and it is named.

Two sources. Some parameters give exactly the same response (:mod:`vibrident.models.labels`): a rule chose, which is
said where the others mean another sensor, or where noise decides between the labels. And the search for start values
met other optima: each is brought down the residual of the points once more, and counts where it explains them as well.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vibrident.estimators.search import Chart, Sought, descend, differences
from vibrident.estimators.start import Start
from vibrident.models import SensorModel
from vibrident.models.labels import canonical, labels_of, relabellings
from vibrident.naming import amount, in_words
from vibrident.records import FloatArray, Quantity
from vibrident.result import ResultWarning

#: Another optimum fits as well where its χ² is larger by less than this: it would be the true one in 1 of 370 cases …
ALIKE = 9.0
#: … and it is another one where a parameter differs by so many of its standard uncertainties …
FAR = 5.0
#: … and by this part of its value.
DIFFERENT = 0.01
#: Steps on the way down.
STEPS = 30
#: Other optima that are tried.
MOST = 4


@dataclass(frozen=True)
class Solution:
    """An estimate, in the one form of its labels.

    Attributes:
        values: of the parameters, by name.
        uncertainty: standard uncertainty of each.
    """

    values: Mapping[str, float]
    uncertainty: Mapping[str, float]


def other_solutions(
    model: SensorModel,
    quantity: Quantity,
    sought: Sought,
    solution: Solution,
    begin: Start | None,
    units: Mapping[str, str],
) -> Iterator[ResultWarning]:
    """A warning ``weakly_determined`` for each solution that fits as well as the estimate.

    Args:
        model: a linear model.
        quantity: what the reference is.
        sought: the points, with their deviations.
        solution: the estimate.
        begin: the start, with the other optima that were met.
        units: of the parameters, by name.
    """
    values, uncertainty = solution.values, solution.uncertainty
    same = [{name: float(value) for name, value in change(values).items()} for change in relabellings(model, values)]
    labels = labels_of(model)
    if same and labels is not None and labels.undecided(values, uncertainty):
        yield _same_response(labels.question, same, units)
    if begin is None or not begin.others:
        return
    found = _refined(model, quantity, sought, [dict(values), *(at for at, _ in begin.others[:MOST])])
    if found is None:
        return
    costs, refined = found
    named: list[Mapping[str, float]] = [values]
    for cost, other in zip(costs[1:], refined[1:], strict=True):
        mine = canonical(model, other)
        delays = [spec.name for spec in model.parameters if spec.kind == "time"]
        if cost < costs[0] + ALIKE and all(_differ(mine, one, uncertainty, sought, delays) for one in named):
            named.append(mine)
            yield _as_good(mine, values, cost - costs[0], units)


def _refined(
    model: SensorModel, quantity: Quantity, sought: Sought, starts: list[dict[str, float]]
) -> tuple[FloatArray, list[dict[str, float]]] | None:
    """χ² at the estimate and at the optima of the others, and where these are; None where that is no number."""
    unit = 1.0 / (2.0 * np.pi * float(np.max(sought.frequency_hz)))
    chart = Chart(model, quantity, sought.frequency_hz, unit)
    placed = [chart.place(at) for at in starts]
    u, sign = np.array([p for p, _ in placed]), np.array([s for _, s in placed])
    front = descend(chart, u, sign, differences(sought), STEPS)
    if not np.isfinite(front.cost[0]):
        return None
    return front.cost, [chart.named(front.u, front.sign, row) for row in range(len(u))]


def _differ(
    one: Mapping[str, float],
    other: Mapping[str, float],
    uncertainty: Mapping[str, float],
    sought: Sought,
    delays: Sequence[str],
) -> bool:
    """Whether these are two solutions; delays a period of the highest frequency apart are one, written twice."""
    later = sum(one[name] - other[name] for name in delays)
    if abs(later) * float(np.max(sought.frequency_hz)) > 0.4:
        return False
    return any(
        abs(value - other[name]) > max(FAR * uncertainty[name], DIFFERENT * abs(other[name]))
        for name, value in one.items()
        if name not in delays
    )


def _same_response(question: str, same: Sequence[Mapping[str, float]], units: Mapping[str, str]) -> ResultWarning:
    others = "; or ".join(_listed(other, units) for other in same)
    return ResultWarning("weakly_determined", f"The response does not tell {question}. The same response: {others}.")


def _as_good(
    other: Mapping[str, float], values: Mapping[str, float], more: float, units: Mapping[str, str]
) -> ResultWarning:
    changed = {n: v for n, v in other.items() if abs(v - values[n]) > 1e-3 * abs(values[n])}
    text = f"Another solution explains the data as well (χ² larger by {max(more, 0.0):.2g}): {_listed(changed, units)}."
    return ResultWarning("weakly_determined", f"{text} A wider band of frequencies would tell.")


def _listed(values: Mapping[str, float], units: Mapping[str, str]) -> str:
    return ", ".join(f"{in_words(name)} {amount(value, units[name])}" for name, value in values.items())
