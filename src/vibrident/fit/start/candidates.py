"""Candidates of the search for start values, from a grid over natural frequency and damping.

Places are compared by magnitude. Each is combined with every guess of the parameters of add-ons.
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

#: Natural frequencies of the grid in a decade …
FREQUENCIES_PER_DECADE = 24
#: … and its decades outside the band.
DECADES_OUTSIDE = 1.5
#: Most points by which the grid is compared.
MAX_SCORED_POINTS = 80
#: Number of cores from the grid …
CORES = 6
#: … of a core that states start values, whose grid is coarse …
CORES_OF_COARSE_GRID = 24
#: … and largest number of combinations of cores with add-ons that begin to descend.
MAX_COMBINATIONS = 64
#: Least relative deviation of a point: neither the grid nor the first steps are finer.
MIN_DEVIATION = 0.01


def candidates(
    sought: TargetFRF, chart: LogCoordinates, band_hz: tuple[float, float]
) -> FloatArray:
    """Return coordinates of the best places of the grid with all guesses of add-ons, shape (C, P).

    The best come first.
    """
    cores = _cores(sought, chart, band_hz)
    return likely(with_guesses(cores, chart.model, band_hz), len(cores), sought, chart)


def likely(
    combined: FloatArray, cores: int, sought: TargetFRF, chart: LogCoordinates
) -> FloatArray:
    """Return the combinations of best magnitudes, at most MAX_COMBINATIONS, the best first.

    Args:
        combined: coordinates of cores with guesses, shape (C, P); their gains are adjusted.
        cores: number of different cores among them.
        sought: the response.
        chart: of the coordinates.
    """
    if len(combined) <= MAX_COMBINATIONS:
        return combined
    scored = sought.few(MAX_SCORED_POINTS)
    target = np.log(np.abs(scored.response))
    weight = 1.0 / np.maximum(scored.deviation, MIN_DEVIATION) ** 2
    difference = target - np.log(
        np.abs(chart.at(scored).response(combined, np.ones(len(combined))))
    )
    mean = difference @ weight / np.sum(weight)
    score = (difference - mean[:, None]) ** 2 @ weight
    gain = [spec.kind for spec in chart.model.parameters].index("gain")
    combined[:, gain] += np.where(np.isfinite(mean), mean, 0.0)
    score = np.where(np.isfinite(score), score, np.inf)
    # Of combinations that differ in the later guesses alone only the best is taken: the first guess
    # determines the place, and all places are to be tried.
    places = next(len(spec.guesses) for spec in chart.model.parameters if spec.guesses) * cores
    by_place = score.reshape(places, -1)
    rows = np.arange(places) * by_place.shape[1] + np.argmin(by_place, axis=1)
    return combined[rows[np.argsort(score[rows], kind="stable")[:MAX_COMBINATIONS]]]


def _cores(sought: TargetFRF, chart: LogCoordinates, band_hz: tuple[float, float]) -> FloatArray:
    """Return the best and most different values of the core's grid, with add-ons at zero."""
    model = chart.model
    scored = sought.few(MAX_SCORED_POINTS)
    naturals = _naturals(sought.frequency_hz, band_hz)
    specs, axes, grid, log_unit = _grid(
        model.core, naturals.tobytes(), scored.frequency_hz.tobytes()
    )
    weight = 1.0 / np.maximum(scored.deviation, MIN_DEVIATION) ** 2
    log_quantity = DERIVATIVES[chart.quantity] * np.log(2.0 * np.pi * scored.frequency_hz)
    difference = np.log(np.abs(scored.response)) - log_quantity - log_unit
    mean = difference @ weight / np.sum(weight)
    score = (difference - mean[..., None]) ** 2 @ weight
    # Natural frequencies that differ by a fifth, and others by a factor of e, are apart.
    apart = [0.2 if spec.grid == "band" else 1.0 for spec in specs]
    scaled_axes = [
        chart.coordinate(spec, axis) / distance
        for spec, axis, distance in zip(specs, axes, apart, strict=True)
    ]
    mesh = np.meshgrid(*scaled_axes, indexing="ij")
    places = np.reshape(mesh, (len(scaled_axes), score.size))
    likeliest = np.argsort(score, axis=None)
    chosen = []
    limit = CORES_OF_COARSE_GRID if any(spec.start is not None for spec in specs) else CORES
    while likeliest.size and len(chosen) < limit:
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


@functools.lru_cache(maxsize=4)  # a poor fit is repeated in several ways
def _grid(
    core: Model, naturals: bytes, frequency: bytes
) -> tuple[list[ParameterSpec], list[FloatArray], dict[str, FloatArray], FloatArray]:
    """Return the grid of a core: parameters, axes, values by name, and log |H| by acceleration.

    Arrays of the grid have one axis for each parameter and one of frequency.

    Args:
        core: the model.
        naturals: natural frequencies, Hz, as bytes.
        frequency: of the points, Hz, as bytes.
    """
    model = SensorModel(core.name, core)
    points = np.frombuffer(frequency)
    specs = [spec for spec in core.parameters if spec.grid]
    axes = [np.frombuffer(naturals) if s.grid == "band" else np.array(s.grid) for s in specs]
    grid = {
        s.name: values[..., None]
        for s, values in zip(specs, np.meshgrid(*axes, indexing="ij"), strict=True)
    }
    trial = {
        name: grid.get(name, 1.0 if name == model.gain_name else 0.0)
        for name in model.parameter_names
    }
    return specs, axes, grid, np.log(np.abs(model.frequency_response(trial, points)))


def _naturals(frequency_hz: FloatArray, band_hz: tuple[float, float]) -> FloatArray:
    """Return natural frequencies to try: evenly over the band and beyond.

    Where points are few, also between neighbours.
    """
    low = np.log10(band_hz[0]) - DECADES_OUTSIDE
    high = np.log10(band_hz[1]) + DECADES_OUTSIDE
    even = np.logspace(low, high, int((high - low) * FREQUENCIES_PER_DECADE) + 1)
    points = distinct(frequency_hz)
    if points.size > MAX_SCORED_POINTS:
        return even
    log = np.log(points)
    between = [np.exp(log[:-1] + fraction * np.diff(log)) for fraction in (0.25, 0.5, 0.75)]
    return distinct(np.concatenate([even, *between]))


def with_guesses(
    cores: FloatArray,
    model: SensorModel,
    band_hz: tuple[float, float],
    names: Sequence[str] | None = None,
) -> FloatArray:
    """Return every core with every combination of guesses, the best core first.

    Args:
        cores: coordinates, shape (C, P), the best first.
        model: whose parameters have guesses.
        band_hz: lowest and highest frequency of the data.
        names: parameters whose guesses are used; None for all.
    """
    low, high = band_hz
    unit = {"lowest": low, "highest": high, "period": 1.0 / high, "one": 1.0}
    names = model.parameter_names if names is None else names
    guessed = [i for i, spec in enumerate(model.parameters) if spec.guesses and spec.name in names]
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
    combinations = np.array(list(itertools.product(*choices)))
    combined = np.repeat(cores, len(combinations), axis=0)
    combined[:, guessed] = np.tile(combinations, (len(cores), 1))
    return combined
