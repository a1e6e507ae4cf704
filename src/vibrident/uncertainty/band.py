"""Does a parameter move when the band is cut? A model that is right says the same with any part of its data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from vibrident.naming import amount, in_words
from vibrident.problem import Coordinates
from vibrident.records import BoolArray, FloatArray
from vibrident.records.basis import distinct
from vibrident.result import ResultWarning
from vibrident.uncertainty.identifiability import WEAK
from vibrident.uncertainty.linearised import Linearised

CUT = 1.0 / 3.0  # part of the frequencies that is cut off, at either end
SIGNIFICANT = 4.5  # a shift counts beyond this many of its standard deviations …
LEAST = 0.1  # … each at least this part of the parameter's own
FEWEST_FREEDOM = 6.0  # fewer degrees of freedom of a row's standard deviation count as so many
IRRELEVANT = 1e-4  # shifts of the coordinates (relative, nearly) below this are of no use to anybody


def band_sensitive(
    linear: Linearised,
    coordinates: Coordinates,
    z: FloatArray,
    covariance: FloatArray,
    units: Mapping[str, str],
    variance_factor: float = 1.0,
    common: FloatArray | None = None,
    freedom: FloatArray | None = None,
) -> list[ResultWarning]:
    """A warning for each parameter that the lower or the upper two thirds of the frequencies would move.

    A part that hardly determines a parameter says nothing of it.

    Args:
        linear: the fit, linearised at ``z``.
        coordinates: the map from z to parameters.
        z: the estimate, shape (p,).
        covariance: of z, as stated, shape (p, p); a shift within its standard uncertainty is covered.
        units: of the parameters, by name.
        variance_factor: of the rows, by their scatter.
        common: systematic effects of unknown amount in the rows, in their standard deviations, shape (m, K).
        freedom: degrees of freedom of each row's standard deviation, shape (m,); None: known.
    """
    frequencies = distinct(linear.frequency_hz)
    if len(frequencies) < 6:
        return []
    whole_covariance = linear.solve()[1]
    low, high = np.quantile(frequencies, [CUT, 1.0 - CUT])
    stated = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    worst: dict[int, tuple[float, str]] = {}
    for keep, label in (
        (linear.frequency_hz <= high, f"without the frequencies above {high:.4g} Hz"),
        (linear.frequency_hz >= low, f"without the frequencies below {low:.4g} Hz"),
    ):
        if keep.sum() < len(z) + 3:
            continue
        part_covariance = linear.solve(keep)[1]
        shift, scatter = shift_without(linear, keep, freedom)
        variance = np.maximum(scatter, LEAST**2 * np.diag(whole_covariance)) * variance_factor
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


def shift_without(linear: Linearised, keep: BoolArray, freedom: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """What the estimate from some rows alone has beyond that from all, and its variance, each of shape (p,).

    For weights that are known the variance is that of the part less that of the whole (Hausman 1978). Weights that were
    estimated, with ν degrees of freedom each, prefer rows whose noise seems small by chance; what these add scatters
    ν/(ν − 4) times as much as the weights say.

    ``linear``: m rows, linearised at any coordinates nearby; ``keep``: rows of the part, shape (m,); ``freedom``:
    degrees of freedom of each row's standard deviation, shape (m,); None: known.
    """
    (part, of_part), (whole, of_whole) = linear.solve(keep), linear.solve()
    of_rows = np.where(keep, of_part @ linear.matrix.T, 0.0) - of_whole @ linear.matrix.T
    excess = np.ones(len(keep)) if freedom is None else 1.0 / (1.0 - 4.0 / np.maximum(freedom, FEWEST_FREEDOM))
    return part - whole, of_rows**2 @ excess


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
