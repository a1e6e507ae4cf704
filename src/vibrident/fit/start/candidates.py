"""Where the search for start values begins: a grid over natural frequency and damping, compared by magnitude.

Each place of the grid is combined with every guess of the add-ons' parameters.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.data.records.basis import distinct
from vibrident.fit.start.search import LogCoordinates, TargetFRF
from vibrident.physics.models import Model, ParameterSpec, SensorModel
from vibrident.physics.models.base import DERIVATIVES

#: Natural frequencies of the grid: so many a decade, and so many decades outside the band.
FREQUENCIES_PER_DECADE, DECADES_OUTSIDE = 24, 1.5
#: Most points by which the grid is compared.
MOST_SCORED_POINTS = 80
#: Cores that are taken from the grid, and combinations of them with add-ons that go down some steps.
CORES, FIRST = 6, 64
#: … of a core that states start values, whose grid is coarse.
CORES_OF_COARSE_GRID = 24
#: Least relative deviation of a point: neither the grid nor the first steps of the search are finer.
LEAST_DEVIATION = 0.01


def candidates(
    sought: TargetFRF, chart: LogCoordinates, band_hz: tuple[float, float]
) -> FloatArray:
    """Coordinates of the grid's best, with what the add-ons guess, the best first; shape (C, P)."""
    cores = _cores(sought, chart, band_hz)
    return likely(with_guesses(cores, chart.model, band_hz), len(cores), sought, chart)


def likely(
    combined: FloatArray, cores: int, sought: TargetFRF, chart: LogCoordinates
) -> FloatArray:
    """Those of the combinations of so many cores with guesses that have the best magnitudes, the best first."""
    if len(combined) <= FIRST:
        return combined
    few = sought.few(MOST_SCORED_POINTS)
    goal, weight = (
        np.log(np.abs(few.response)),
        1.0 / np.maximum(few.deviation, LEAST_DEVIATION) ** 2,
    )
    off = goal - np.log(np.abs(chart.at(few).response(combined, np.ones(len(combined)))))
    mean = off @ weight / np.sum(weight)
    score = (off - mean[:, None]) ** 2 @ weight
    gain = [spec.kind for spec in chart.model.parameters].index("gain")
    combined[:, gain] += np.where(np.isfinite(mean), mean, 0.0)
    score = np.where(np.isfinite(score), score, np.inf)
    # Of those that differ in the later guesses alone, the best: the first one says where, and all places shall be seen.
    places = next(len(spec.guesses) for spec in chart.model.parameters if spec.guesses) * cores
    alike = score.reshape(places, -1)
    rows = np.arange(places) * alike.shape[1] + np.argmin(alike, axis=1)
    return combined[rows[np.argsort(score[rows], kind="stable")[:FIRST]]]


def _cores(sought: TargetFRF, chart: LogCoordinates, band_hz: tuple[float, float]) -> FloatArray:
    """The best and most different values of the core's grid by magnitude, add-ons as if not there."""
    model, few = chart.model, sought.few(MOST_SCORED_POINTS)
    places = _naturals(sought.frequency_hz, band_hz)
    specs, axes, grid, log_unit = _grid(model.core, places.tobytes(), few.frequency_hz.tobytes())
    weight = 1.0 / np.maximum(few.deviation, LEAST_DEVIATION) ** 2
    of_quantity = DERIVATIVES[chart.quantity] * np.log(2.0 * np.pi * few.frequency_hz)
    difference = np.log(np.abs(few.response)) - of_quantity - log_unit
    mean = difference @ weight / np.sum(weight)
    score = (difference - mean[..., None]) ** 2 @ weight
    # Natural frequencies that differ by a fifth, and others by a factor of e, are apart.
    apart = [0.2 if spec.grid == "band" else 1.0 for spec in specs]
    own = [
        chart.coordinate(spec, axis) / far
        for spec, axis, far in zip(specs, axes, apart, strict=True)
    ]
    places = np.reshape(np.meshgrid(*own, indexing="ij"), (len(own), score.size))
    likeliest, chosen = np.argsort(score, axis=None), []
    most = CORES_OF_COARSE_GRID if any(spec.start is not None for spec in specs) else CORES
    while likeliest.size and len(chosen) < most:
        first = int(likeliest[0])
        values = {name: float(grid[name].flat[first]) for name in grid}
        values[model.gain_name] = float(np.exp(mean.flat[first]))
        chosen.append(
            chart.place({name: values.get(name, 0.0) for name in model.parameter_names})[0]
        )
        likeliest = likeliest[
            np.any(np.abs(places[:, likeliest] - places[:, first, None]) > 1.0, axis=0)
        ]
    return np.array(chosen)


@functools.lru_cache(maxsize=4)  # what does not suit is searched for in several ways
def _grid(
    core: Model, naturals: bytes, frequency: bytes
) -> tuple[list[ParameterSpec], list[FloatArray], dict[str, FloatArray], FloatArray]:
    """Parameters of the grid, their axes and values, and log |H| there by acceleration, one axis each and of frequency.

    ``naturals``: natural frequencies; ``frequency``: of the points, both as bytes.
    """
    alone, points = SensorModel(core.name, core), np.frombuffer(frequency)
    specs = [spec for spec in core.parameters if spec.grid]
    axes = [np.frombuffer(naturals) if s.grid == "band" else np.array(s.grid) for s in specs]
    grid = {
        s.name: values[..., None]
        for s, values in zip(specs, np.meshgrid(*axes, indexing="ij"), strict=True)
    }
    trial = {
        name: grid.get(name, 1.0 if name == alone.gain_name else 0.0)
        for name in alone.parameter_names
    }
    return specs, axes, grid, np.log(np.abs(alone.frequency_response(trial, points)))


def _naturals(frequency_hz: FloatArray, band_hz: tuple[float, float]) -> FloatArray:
    """Natural frequencies to try: evenly over the band and beyond, and between neighbours of few points."""
    low, high = np.log10(band_hz[0]) - DECADES_OUTSIDE, np.log10(band_hz[1]) + DECADES_OUTSIDE
    even = np.logspace(low, high, int((high - low) * FREQUENCIES_PER_DECADE) + 1)
    points = distinct(frequency_hz)
    if points.size > MOST_SCORED_POINTS:
        return even
    log = np.log(points)
    between = [np.exp(log[:-1] + part * np.diff(log)) for part in (0.25, 0.5, 0.75)]
    return distinct(np.concatenate([even, *between]))


def with_guesses(
    cores: FloatArray,
    model: SensorModel,
    band_hz: tuple[float, float],
    names: Sequence[str] | None = None,
) -> FloatArray:
    """Every core with every combination of the add-ons' guesses, or those of some parameters; the best core first."""
    low, high = band_hz
    unit = {"lowest": low, "highest": high, "period": 1.0 / high, "one": 1.0}
    of = model.parameter_names if names is None else names
    guessed = [i for i, spec in enumerate(model.parameters) if spec.guesses and spec.name in of]
    if not guessed:
        return cores
    choices = []
    for spec in (model.parameters[i] for i in guessed):
        guesses = np.array(spec.guesses)
        physical = (
            low * (high / low) ** guesses
            if spec.guess_at == "band"
            else guesses * unit[spec.guess_at]
        )
        choices.append((physical if spec.kind == "ratio" else np.log(physical)).tolist())
    combos = np.array(list(itertools.product(*choices)))
    found = np.repeat(cores, len(combos), axis=0)
    found[:, guessed] = np.tile(combos, (len(cores), 1))
    return found
