"""Start values from the nonparametric response alone: no user ever gives one.

A grid over natural frequency and damping, compared by magnitude; the gain's size from the mean ratio; its sign and
the delay from the phase; then a few Levenberg–Marquardt runs from the best and most different candidates.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vibrident.errors import NotConverged
from vibrident.estimators.objectives import response_objective
from vibrident.estimators.optimise import levenberg_marquardt
from vibrident.models import SensorModel
from vibrident.problem import Coordinates, FrequencyProblem
from vibrident.records import FloatArray

DAMPING_GRID = (0.003, 0.02, 0.08, 0.2, 0.4, 0.6, 0.8, 1.2, 2.5)
FREQUENCIES_PER_DECADE = 24
DECADES_OUTSIDE = 1.5
CANDIDATES = 4
#: No other candidate is tried once the cost per residual is below this: no better optimum can hide.
GOOD_ENOUGH = 2.0
MOST_POINTS, MOST_SCORED = 200, 400
#: No point counts for more than this relative deviation would allow: the grid is coarse.
LEAST_DEVIATION = 0.01


@dataclass(frozen=True)
class Start:
    """Where an estimator begins, and the way there from the grid.

    Attributes:
        values: parameters near the optimum, by name, in physical units.
        costs: cost at each iterate of the way.
        equations: number of residuals.
        path: parameters at each iterate.
    """

    values: dict[str, float]
    costs: tuple[float, ...]
    equations: int
    path: tuple[dict[str, float], ...]


def start_values(problem: FrequencyProblem, model: SensorModel) -> dict[str, float]:
    """Parameters near the optimum, by name, in physical units; see :func:`find_start`."""
    return find_start(problem, model).values


def find_start(problem: FrequencyProblem, model: SensorModel) -> Start:
    """The best fit of the nonparametric response from the grid's candidates.

    What makes a model nonlinear has no part in the response to small signals, and starts at zero. A start that the
    problem knows is taken as it is.

    Raises:
        NotConverged: no candidate leads to a finite fit.
    """
    if problem.start is not None:
        return _known(problem, model, problem.start)
    whole, model = model, model.linear
    candidates = _with_guesses(_grid_candidates(problem, model), problem, model)
    best: Start | None = None
    kind = (problem.polar, problem.has_phase, problem.quantity)
    for candidate in candidates:
        coordinates = Coordinates.at(model, candidate, problem.band_hz)
        try:
            trace = levenberg_marquardt(
                response_objective, coordinates.first, (coordinates, kind, problem.padded), tolerance=1e-2
            )
        except NotConverged:
            continue
        cost = trace.costs[-1]
        if np.isfinite(cost) and (best is None or cost < best.costs[-1]):
            path = tuple(
                {name: coordinates.values(z).get(name, 0.0) for name in whole.parameter_names}
                for z in trace.coordinates
            )
            best = Start(path[-1], trace.costs, problem.equations, path)
        if best is not None and best.costs[-1] < GOOD_ENOUGH * problem.equations:
            break
    if best is None:
        raise NotConverged("No start value gives a finite fit: are the columns and units right?")
    return best


def _known(problem: FrequencyProblem, model: SensorModel, values: Mapping[str, float]) -> Start:
    coordinates = Coordinates.at(model, values, problem.band_hz)
    kind = (problem.polar, problem.has_phase, problem.quantity)
    local = response_objective(coordinates.first, (coordinates, kind, problem.padded))
    return Start(dict(values), (float(local.cost),), problem.equations, (dict(values),))


def _grid_candidates(problem: FrequencyProblem, model: SensorModel) -> list[dict[str, float]]:
    frequency, response, deviation = _thinned(problem)
    log_measured = np.log(np.abs(response))
    weight = 1.0 / np.maximum(deviation, LEAST_DEVIATION) ** 2
    low, high = np.log10(problem.band_hz[0]) - DECADES_OUTSIDE, np.log10(problem.band_hz[1]) + DECADES_OUTSIDE
    naturals = np.logspace(low, high, int((high - low) * FREQUENCIES_PER_DECADE) + 1)
    grid = {"natural_frequency": naturals[:, None, None], "damping_ratio": np.array(DAMPING_GRID)[None, :, None]}
    trial = {name: grid.get(name, 1.0 if name == model.gain_name else 0.0) for name in model.parameter_names}
    unit = model.frequency_response(trial, frequency, problem.quantity)  # (naturals, dampings, points)
    difference = log_measured - np.log(np.abs(unit))
    mean = difference @ weight / np.sum(weight)
    score = (difference - mean[..., None]) ** 2 @ weight
    order = np.argsort(score, axis=None)[:MOST_SCORED]
    scored = [
        {**_trial(model, naturals[i], DAMPING_GRID[j]), model.gain_name: float(np.exp(mean[i, j]))}
        for i, j in zip(*np.unravel_index(order, score.shape), strict=True)
    ]
    chosen: list[dict[str, float]] = []
    for trial in scored:
        if all(_different(trial, other) for other in chosen):
            chosen.append(trial)
        if len(chosen) == CANDIDATES:
            break
    return [_with_sign_and_delay(trial, problem, model, frequency, response, weight) for trial in chosen]


def _trial(model: SensorModel, natural: float, damping: float) -> dict[str, float]:
    values = {"natural_frequency": float(natural), "damping_ratio": float(damping)}  # add-ons as if they were not there
    return {name: values.get(name, 1.0 if name == model.gain_name else 0.0) for name in model.parameter_names}


def _with_guesses(
    candidates: list[dict[str, float]], problem: FrequencyProblem, model: SensorModel
) -> list[dict[str, float]]:
    """Every candidate with every combination of the add-ons' guesses; the best core first."""
    low, high = problem.band_hz
    unit = {"lowest": low, "highest": high, "period": 1.0 / high, "one": 1.0}
    guessed = [spec for spec in model.parameters if spec.guesses]
    if not guessed:
        return candidates
    choices = [[guess * unit[spec.guess_at] for guess in spec.guesses] for spec in guessed]
    names = [spec.name for spec in guessed]
    return [{**c, **dict(zip(names, combo, strict=True))} for c in candidates for combo in itertools.product(*choices)]


def _different(one: dict[str, float], other: dict[str, float]) -> bool:
    ratio = abs(np.log(one["natural_frequency"] / other["natural_frequency"]))
    return ratio > 0.2 or abs(np.log(one["damping_ratio"] / other["damping_ratio"])) > 1.0


def _with_sign_and_delay(
    trial: dict[str, float],
    problem: FrequencyProblem,
    model: SensorModel,
    frequency: FloatArray,
    response: NDArray[np.complex128],
    weight: FloatArray,
) -> dict[str, float]:
    if not problem.has_phase:
        return trial
    turn = response / model.frequency_response(trial, frequency, problem.quantity)
    turn = weight * turn / np.abs(turn)
    if not model.has_delay:
        sign = 1.0 if np.sum(turn).real >= 0 else -1.0
        return {**trial, model.gain_name: sign * trial[model.gain_name]}
    # The delay that lines all phases up, searched over some periods of the highest frequency either way.
    delays = np.linspace(-6.0, 6.0, 481) / problem.band_hz[1]
    sums = np.real(np.exp(2j * np.pi * delays[:, None] * frequency[None, :]) @ turn)
    # Of nearly equal alignments the shortest delay is the likely one.
    preference = np.abs(sums) * (1.0 - 1e-3 * np.abs(delays) * problem.band_hz[1])
    best = int(np.argmax(preference))
    sign = 1.0 if sums[best] >= 0 else -1.0
    return {**trial, model.gain_name: sign * trial[model.gain_name], "delay": float(delays[best])}


def _thinned(problem: FrequencyProblem) -> tuple[FloatArray, NDArray[np.complex128], FloatArray]:
    usable = np.flatnonzero(np.abs(problem.response) > 0)
    if usable.size > MOST_POINTS:
        order = usable[np.argsort(np.asarray(problem.data[0])[usable])]
        usable = order[np.linspace(0, order.size - 1, MOST_POINTS).astype(int)]
    return np.asarray(problem.data[0])[usable], problem.response[usable], problem.relative_deviation[usable]
