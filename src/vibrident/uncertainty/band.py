"""Does a parameter move when the band is cut? A model that is right says the same with any part of its data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from vibrident.naming import amount, in_words
from vibrident.problem import Coordinates
from vibrident.records import FloatArray
from vibrident.result import ResultWarning
from vibrident.uncertainty.identifiability import WEAK
from vibrident.uncertainty.linearised import Linearised

#: Part of the frequencies that is cut off, at either end.
CUT = 1.0 / 3.0
#: A shift counts beyond this many of its standard deviations …
SIGNIFICANT = 4.5
#: … each at least this part of the parameter's own.
LEAST = 0.1
#: Shifts of the coordinates (relative, nearly) below this are of no use to anybody.
IRRELEVANT = 1e-4


def band_sensitive(
    linear: Linearised,
    coordinates: Coordinates,
    z: FloatArray,
    covariance: FloatArray,
    units: Mapping[str, str],
    variance_factor: float = 1.0,
    common: FloatArray | None = None,
) -> list[ResultWarning]:
    """A warning for each parameter that the lower or the upper two thirds of the frequencies would move.

    A part that hardly determines a parameter says nothing of it.

    For efficient estimates the variance of the shift is that of the part less that of the whole (Hausman 1978).

    Args:
        linear: the fit, linearised at ``z``.
        coordinates: the map from z to parameters.
        z: the estimate, shape (p,).
        covariance: of z, as stated, shape (p, p); a shift within its standard uncertainty is covered.
        units: of the parameters, by name.
        variance_factor: of the rows, by their scatter.
        common: systematic effects of unknown amount in the rows, in their standard deviations, shape (m, K).
    """
    frequencies = np.unique(linear.frequency_hz)
    if len(frequencies) < 6:
        return []
    whole, whole_covariance = linear.solve()
    low, high = np.quantile(frequencies, [CUT, 1.0 - CUT])
    stated = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    worst: dict[int, tuple[float, str]] = {}
    for keep, label in (
        (linear.frequency_hz <= high, f"without the frequencies above {high:.4g} Hz"),
        (linear.frequency_hz >= low, f"without the frequencies below {low:.4g} Hz"),
    ):
        if keep.sum() < len(z) + 3:
            continue
        part, part_covariance = linear.solve(keep)
        shift = part - whole
        own = np.diag(whole_covariance)
        variance = variance_factor * np.maximum(np.diag(part_covariance) - own, LEAST**2 * own)
        for effect in () if common is None else common.T:
            with_it = replace(linear, rest=effect)
            variance = variance + (with_it.solve(keep)[0] - with_it.solve()[0]) ** 2
        spread = np.sqrt(variance)
        moved = np.abs(shift) > np.maximum(np.maximum(SIGNIFICANT * spread, IRRELEVANT), stated)
        told = variance_factor * np.diag(part_covariance) < WEAK**2
        for index in np.flatnonzero(moved & told):
            size = float(abs(shift[index]) / spread[index])
            if size > worst.get(int(index), (0.0, ""))[0]:
                times = float(abs(shift[index]) / stated[index]) if stated[index] > 0 else size
                worst[int(index)] = (size, _sentence(coordinates, z, shift, int(index), label, times, units))
    return [ResultWarning("band_sensitive", text) for _, text in worst.values()]


def _sentence(
    coordinates: Coordinates,
    z: FloatArray,
    shift: FloatArray,
    index: int,
    label: str,
    times: float,
    units: Mapping[str, str],
) -> str:
    spec = coordinates.model.parameters[index]
    moved = np.array(z)
    moved[index] += shift[index]
    before, after = coordinates.values(z)[spec.name], coordinates.values(moved)[spec.name]
    unit = units[spec.name]
    return (
        f"The {in_words(spec.name)} would be about {amount(after, unit)} instead of {amount(before, unit)} "
        f"{label}: {times:.1f} times its stated u."
    )
