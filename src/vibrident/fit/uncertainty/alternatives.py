"""Other solutions that fit as well as the estimate, so that the data do not choose.

They have three sources:

- Several sets of parameters may give exactly the same response
  (:mod:`vibrident.physics.models.labels`). A rule chooses one; the others are named where noise
  decides between them.
- The search for start values may have met other optima. Each descends the residual of the points
  once more, and counts where it explains them as well.
- Two modes beyond the band trade against each other along a curved valley. It leads further than
  the standard uncertainties say, which know its direction at the estimate alone. Each parameter in
  turn is held far from its estimate while the others follow. In other models the interval of a
  hardly determined parameter says as much (:mod:`vibrident.fit.uncertainty.profile`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
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
from vibrident.fit.uncertainty.parameters import WEAK_UNCERTAINTY
from vibrident.physics.models import SensorModel
from vibrident.physics.models.labels import canonical, labels_of, relabellings
from vibrident.physics.naming import in_words
from vibrident.result import ResultWarning

#: An optimum is as good where its χ² is larger by less: chance rejects the true one once in 370.
MAX_CHI2_RISE = 9.0
MAX_STEPS = 30  # of a descent
#: A mode beyond the band is tried at so many times its highest frequency …
RATIO_BEYOND = 10.0
#: … with these shares of the response at low frequency.
SHARES_BEYOND = (-0.3, 0.3)


@dataclass(frozen=True)
class Solution:
    """An estimate in the canonical form of its labels."""

    values: Mapping[str, float]  # of the parameters, by name
    uncertainty: Mapping[str, float]  # standard uncertainty of each


def other_solutions(
    model: SensorModel,
    quantity: Quantity,
    sought: TargetFRF,
    solution: Solution,
    begin: Start | None,
    units: Mapping[str, str],
    rival_optima: Sequence[tuple[float, Mapping[str, float]]] = (),
) -> Iterator[ResultWarning]:
    """Yield a warning ``weakly_determined`` for each solution that fits as well as the estimate.

    Args:
        model: a linear model.
        quantity: what the reference is.
        sought: the points, with their deviations.
        solution: the estimate.
        begin: the start, with the other optima that were met.
        units: of the parameters, by name.
        rival_optima: optima of the records, each with its rise of χ² and the parameters.
    """
    values = solution.values
    uncertainty = solution.uncertainty
    relabelled = [change(values) for change in relabellings(model, values)]
    labels = labels_of(model)
    if relabelled and labels is not None and labels.undecided(values, uncertainty):
        same_response = "; or ".join(_list_values(candidate, units) for candidate in relabelled)
        text = f"The response does not tell {labels.question}. The same response: {same_response}."
        yield ResultWarning("weakly_determined", text)
    time_unit_s = 1.0 / (2.0 * np.pi * float(np.max(sought.frequency_hz)))
    chart = LogCoordinates(model, quantity, sought.frequency_hz, time_unit_s)
    goal = differences(sought)
    met = [] if begin is None else [optimum for optimum, _ in begin.other_optima]
    optima = [*rival_optima, *_optima_from(chart, goal, solution, met)]
    if model.shares:
        optima += _optima_along_valley(chart, goal, solution)
        beyond = _with_mode_beyond(model, values, float(np.max(sought.frequency_hz)))
        optima += _optima_from(chart, goal, solution, beyond)
    known: list[Mapping[str, float]] = [values]
    rises = []
    for rise, optimum in optima:
        candidate = canonical(model, optimum)
        if rise < MAX_CHI2_RISE and all(
            _differ_clearly(candidate, known_values, uncertainty, chart) for known_values in known
        ):
            known.append(candidate)
            rises.append(rise)
    if rises:
        yield _warn_of_solutions(list(zip(rises, known[1:], strict=True)), solution, units)


def _optima_from(
    chart: LogCoordinates,
    goal: Residual,
    solution: Solution,
    begins: Sequence[Mapping[str, float]],
) -> Iterator[tuple[float, dict[str, float]]]:
    """Yield the optima that descents from some values lead to, each with its rise of χ².

    A rise is over the χ² of the estimate.
    """
    if not begins:
        return
    places = [chart.place(dict(values)) for values in (solution.values, *begins)]
    u = np.array([coordinates for coordinates, _ in places])
    sign = np.array([signs for _, signs in places])
    front = descend(chart, u, sign, goal, MAX_STEPS)
    if np.isfinite(front.cost[0]):
        for row in range(1, len(u)):
            yield float(front.cost[row] - front.cost[0]), chart.named(front.u, front.sign, row)


def _optima_along_valley(
    chart: LogCoordinates, goal: Residual, solution: Solution
) -> Iterator[tuple[float, dict[str, float]]]:
    """Yield optima with one parameter held six u away, each with its rise of χ², furthest first.

    Weakly determined parameters are not held. A rise is over the χ² of the estimate.
    """
    u, sign = chart.place(dict(solution.values))
    above, _ = chart.place(
        {name: value + solution.uncertainty[name] for name, value in solution.values.items()}
    )
    at_estimate = descend(chart, u[None], np.array([sign]), goal, 0)
    optimum = descend(chart, u[None], np.array([sign]), goal, MAX_STEPS)
    if not np.isfinite(at_estimate.cost[0]):
        return
    # The estimate is not the optimum of the points alone, so a rise counts from the estimate where
    # that is not far above the optimum.
    reference_cost = min(float(at_estimate.cost[0]), float(optimum.cost[0]) + MAX_CHI2_RISE)
    covariance = inverse_normal(information_at(chart, optimum.u, optimum.sign, goal)[0])
    deviation = np.sqrt(np.diag(covariance))
    stated = np.maximum(np.abs(above - u), deviation)
    offsets = [
        (k, side)
        for k in np.flatnonzero(stated < WEAK_UNCERTAINTY).tolist()
        for side in (-6.0, 6.0)
    ]
    if not offsets:
        return
    # The other parameters begin where they would follow along a straight valley.
    shifts = np.array([side * stated[k] / deviation[k] ** 2 * covariance[k] for k, side in offsets])
    held = np.zeros(shifts.shape, dtype=bool)
    held[np.arange(len(offsets)), [k for k, _ in offsets]] = True
    front = descend(
        chart, optimum.u + shifts, np.full(len(offsets), optimum.sign[0]), goal, MAX_STEPS, held
    )
    for row in np.argsort(-np.max(np.abs(front.u - u) / stated, axis=1), kind="stable").tolist():
        yield float(front.cost[row] - reference_cost), chart.named(front.u, front.sign, row)


def _with_mode_beyond(
    model: SensorModel, values: Mapping[str, float], top_hz: float
) -> list[dict[str, float]]:
    """Return values with the second mode far above the band, which ends at ``top_hz``.

    There it adds a constant, and only the sum of both sensitivities is seen. It is an optimum where
    the mode of the estimate explains next to nothing.
    """
    beyond = list[dict[str, float]]()
    for add_on in model.add_ons:
        if not add_on.share or add_on.oscillator is None:
            continue
        frequency, damping = add_on.oscillator
        for share in SHARES_BEYOND:
            mode = {add_on.share: share, frequency: RATIO_BEYOND * top_hz, damping: 0.1}
            gain = values[model.gain_name] / (1.0 + share)
            beyond.append({**values, **mode, model.gain_name: gain})
    return beyond


def _differ_clearly(
    first: Mapping[str, float],
    second: Mapping[str, float],
    uncertainty: Mapping[str, float],
    chart: LogCoordinates,
) -> bool:
    """Return whether a parameter other than a delay differs by five u and a hundredth of its value.

    Solutions whose delays differ by a period of the highest frequency are one, written twice.
    """
    delays = [spec.name for spec in chart.model.parameters if spec.kind == "time"]
    delay_difference = sum(first[name] - second[name] for name in delays)
    if abs(delay_difference) * float(np.max(chart.frequency_hz)) > 0.4:
        return False
    return any(
        abs(value - second[name]) > max(5.0 * uncertainty[name], 0.01 * abs(second[name]))
        for name, value in first.items()
        if name not in delays
    )


def _warn_of_solutions(
    alternatives: Sequence[tuple[float, Mapping[str, float]]],
    solution: Solution,
    units: Mapping[str, str],
) -> ResultWarning:
    """Return the warning of other solutions, each with its rise of χ².

    It states the parameters of the likeliest one that differ from the estimate, and names those in
    which the others differ.
    """
    values = solution.values
    limits = {
        name: min(1e-3 * abs(value), 3.0 * solution.uncertainty[name])
        for name, value in values.items()
    }

    def changes(alternative: Mapping[str, float]) -> dict[str, float]:
        return {
            name: value
            for name, value in alternative.items()
            if abs(value - values[name]) > limits[name]
        }

    rise, likeliest = min(alternatives, key=lambda scored: scored[0])
    text = (
        f"Another solution explains the data as well (χ² larger by {max(rise, 0.0):.2g}): "
        f"{_list_values(changes(likeliest), units)}."
    )
    if len(alternatives) > 1:
        changed = {name for _, alternative in alternatives for name in changes(alternative)}
        parameters = ", ".join(in_words(name) for name in values if name in changed)
        more = len(alternatives) - 1
        text += f" {more} more {'differ' if more > 1 else 'differs'} in {parameters}."
    return ResultWarning("weakly_determined", f"{text} A wider band of frequencies would tell.")


def _list_values(values: Mapping[str, float], units: Mapping[str, str]) -> str:
    """Return the values in words, with their units, separated by commas."""
    return ", ".join(
        f"{in_words(name)} {amount(value, units[name])}" for name, value in values.items()
    )
