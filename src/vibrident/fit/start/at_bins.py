"""Start values from a grid at the exact bins.

Natural frequency and damping come from a grid, the gain (and the share of a second mode, which the
response is linear in, too) in closed form, the delay from the peak of a correlation. A model with
add-ons starts from the best values of the model without them. No nonparametric response is needed.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence

import numpy as np

from vibrident.base.errors import NotConverged
from vibrident.fit.noise.averages import averaged_bins, typical, windowed
from vibrident.fit.optimise import NO_START
from vibrident.fit.problem.band import Band
from vibrident.fit.response.transform import power_of
from vibrident.fit.start.coarse import coarse_rows
from vibrident.fit.start.grid_search import GridSearch, StartCandidate
from vibrident.fit.start.motion_and_noise import MotionAndNoise
from vibrident.fit.start.refinement import CoarseDescent
from vibrident.physics.models import ParameterSpec, SensorModel

#: Number of natural frequencies of the grid …
FREQUENCIES = 32
#: … from this multiple of the lowest frequency of the motion …
LOWEST_RATIO = 1.0 / 3.0
#: … to this one of the highest.
HIGHEST_RATIO = 8.0
#: Number of peaks of the responses that are natural frequencies of the grid, too.
PEAKS = 3
#: Fewest bins of a group in which a peak stands out of others.
MIN_PEAK_BINS = 8
#: Fewest places of the core model from which add-ons are searched, and most with all guesses.
MIN_PLACES = 3
MAX_PLACES = 500
#: Places with add-ons that are refined at the coarse bins.
REFINED_PLACES = 12


def candidates(band: Band, observed: MotionAndNoise, most: int) -> list[StartCandidate]:
    """Return the best and most different places of the grid, at most ``most``, the best first.

    Raises:
        NotConverged: no place of the grid has a finite response.
    """
    model = band.model
    search = GridSearch(band, observed.band_hz, tuple(coarse_rows(band, observed)))
    descent = CoarseDescent(band, observed.band_hz, search.rows)
    core = [spec for spec in model.core.parameters if spec.grid]
    # Free motion at the samples has images above half the sampling rate; a band-limited reference
    # alone tells them apart.
    is_band_limited = band.problem.frame.method.is_band_limited
    grids = [group.grid for group in band.groups]
    rates = [grid.rate_hz for grid in grids if not (grid.driven and is_band_limited)]
    top_hz = min([HIGHEST_RATIO * observed.band_hz[1], *(0.5 * rate for rate in rates)])
    peaks_hz = _peaks(band, observed.band_hz)
    axes = {spec.name: _axis(spec, observed.band_hz[0], top_hz, peaks_hz) for spec in core}
    places = _places(core, list(axes.values()))
    added = [
        spec
        for add_on in model.add_ons
        for spec in add_on.parameters
        if spec.guesses and spec.name not in model.shares
    ]
    guesses = _places(added, [_guesses(spec, observed.band_hz) for spec in added])
    core_has_starts = any(spec.start is not None for spec in core)
    count = REFINED_PLACES if core_has_starts else max(most, MIN_PLACES)
    front = search.best(places, max(count, MAX_PLACES // len(guesses) if added else 0))
    first_modes = front[:MIN_PLACES]
    if added and front:
        core_values = [{spec.name: place.values[spec.name] for spec in core} for place in front]
        # An add-on in the band may hide that the core does nothing there.
        core_values += _places_in(core, axes, lambda axis: {axis[0], axis[-1]})
        front = search.best(_combined(core_values, guesses), REFINED_PLACES)
        # Steps of an add-on's grid may outweigh what rings.
        ringing = _combined(_places_in(core, axes, lambda axis: peaks_hz), guesses)
        front += search.best(ringing, PEAKS) if ringing else []
    if first_modes and model.shares:
        modes = _second_modes(model, observed.band_hz)
        front = [*front, *descent.with_second_mode(first_modes, modes)[:REFINED_PLACES]]
    if front and (added or core_has_starts):
        front = descent.refined(front)
    if not front:
        raise NotConverged(NO_START)
    return front[:most]


def _places(
    specs: Sequence[ParameterSpec], axes: Sequence[Sequence[float]]
) -> list[dict[str, float]]:
    """Return all combinations of values of the parameters, by name."""
    names = [spec.name for spec in specs]
    return [dict(zip(names, values, strict=True)) for values in itertools.product(*axes)]


def _combined(
    places: Sequence[dict[str, float]], guesses: Sequence[dict[str, float]]
) -> list[dict[str, float]]:
    """Return each place with each of the guesses of the add-ons."""
    return [place | guess for place in places for guess in guesses]


def _places_in(
    specs: Sequence[ParameterSpec],
    axes: Mapping[str, Sequence[float]],
    chosen_hz: Callable[[Sequence[float]], Iterable[float]],
) -> list[dict[str, float]]:
    """Return the places of a core whose natural frequency is among those chosen of its axis."""
    if all(spec.grid != "band" for spec in specs):
        return []
    narrow = [
        list(chosen_hz(axes[spec.name])) if spec.grid == "band" else axes[spec.name]
        for spec in specs
    ]
    return _places(specs, narrow)


def _second_modes(model: SensorModel, band_hz: tuple[float, float]) -> list[dict[str, float]]:
    """Return frequencies and damping ratios of a second mode to be tried."""
    specs = [
        spec
        for add_on in model.add_ons
        if add_on.share
        for spec in add_on.parameters
        if spec.name != add_on.share
    ]
    return _places(specs, [_guesses(spec, band_hz) for spec in specs])


def _axis(
    spec: ParameterSpec, low_hz: float, top_hz: float, peaks_hz: Sequence[float]
) -> list[float]:
    """Return the values of a parameter in the grid."""
    if spec.grid == "band":
        even = np.geomspace(LOWEST_RATIO * low_hz, top_hz, FREQUENCIES)
        return sorted([*even.tolist(), *peaks_hz])
    return list(spec.grid)


def _peaks(band: Band, band_hz: tuple[float, float]) -> list[float]:
    """Return the frequencies at which responses are loudest beside those around, Hz.

    A lightly damped sensor rings there: a peak may be narrower than the steps of a grid.
    """
    peaks: list[tuple[float, float]] = []
    for group in band.groups:
        if group.grid.bins < MIN_PEAK_BINS:
            continue
        power = power_of(windowed(group.response))
        frequency_hz = group.grid.frequency_hz[1:-1]
        excess = np.max(power / typical(power, averaged_bins(power.shape[1])), axis=0)
        neighbours = np.maximum(np.roll(excess, 1), np.roll(excess, -1))
        outside = (frequency_hz < band_hz[0]) | (frequency_hz > band_hz[1])
        excess[(excess < neighbours) | outside] = 0.0
        highest = np.argsort(-excess)[:PEAKS]
        peaks += zip(excess[highest].tolist(), frequency_hz[highest].tolist(), strict=True)
    return [hz for _, hz in sorted(peaks, reverse=True)[:PEAKS]]


def _guesses(spec: ParameterSpec, band_hz: tuple[float, float]) -> list[float]:
    """Return the guesses of a parameter of an add-on, in its unit."""
    low, high = band_hz
    guesses = np.array(spec.guesses)
    if spec.kind in ("log", "duration") and spec.guess_at != "band":
        span = guesses[-1] / guesses[0]
        guesses = np.geomspace(guesses[0], guesses[-1], 1 + int(np.ceil(np.log2(span))))
    if spec.guess_at == "band":
        return (low * (high / low) ** guesses).tolist()
    unit = {"lowest": low, "highest": high, "period": 1.0 / high, "one": 1.0}[spec.guess_at]
    return (guesses * unit).tolist()
