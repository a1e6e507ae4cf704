"""Do the tones alone say what the records say, and a part of the band what all of it says?

A model that is right says the same with any part of its data.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from vibrident.base.amounts import amount
from vibrident.data.records import BoolArray, FloatArray
from vibrident.data.records.basis import distinct
from vibrident.fit.estimators import Estimate
from vibrident.fit.problem import Coordinates
from vibrident.fit.uncertainty.linearised import Linearised
from vibrident.fit.uncertainty.parameters import WEAK
from vibrident.physics.naming import in_words
from vibrident.result import ResultWarning

SIGNIFICANT = 4.0  # joint standard uncertainties by which estimates of the same data may differ
IRRELEVANT = 1e-4  # shifts of the coordinates (relative, nearly) below this are of no use to anybody
CUT = 1.0 / 3.0  # part of the frequencies that is cut off, at either end
SIGNIFICANT_SHIFT = 4.5  # a shift counts beyond this many of its standard deviations …
LEAST = 0.1  # … each at least this part of the parameter's own
FEWEST_FREEDOM = 6.0  # fewer degrees of freedom of a row's standard deviation count as so many


def estimators_disagree(
    tones: Linearised,
    covariance: FloatArray,
    units: Mapping[str, str],
    estimator: str,
    fitted: Callable[[], Estimate] | None,
) -> list[ResultWarning]:
    """A warning if the maximum-likelihood estimate from the tones alone differs.

    ``tones``: their complex amplitudes, linearised at the estimate; ``covariance``: of the estimate, shape (p, p);
    ``fitted``: the fit of the tones, which decides if these suggest a difference; None if there is no such fit.
    """
    coordinates, z = tones.coordinates, tones.z
    if len(tones.rest) < len(z) + 2:
        return []
    shift, own = tones.solve()
    index, size = _farthest(shift, np.diag(own) + np.diag(covariance))
    if index is None:
        return []
    other, about = None, " about"
    if fitted is not None:
        other, about = fitted(), ""
        shift, variance = _from(coordinates, z, other)
        index, size = _farthest(shift, variance + np.diag(covariance))
        if index is None:
            return []
    spec = coordinates.model.parameters[index]
    moved = np.array(z)
    moved[index] += shift[index]
    unit = units[spec.name]
    there = coordinates.values(moved) if other is None else other.coordinates.values(other.z)
    before, after = coordinates.values(z)[spec.name], there[spec.name]
    text = (
        f"For the {in_words(spec.name)} {estimator} says {amount(before, unit, 6)}, the complex amplitudes of "
        f"the tones (maximum likelihood){about} {amount(after, unit, 6)}: {size:.1f} joint standard "
        "uncertainties apart."
    )
    return [ResultWarning("estimators_disagree", text)]


def _farthest(shift: FloatArray, variance: FloatArray) -> tuple[int | None, float]:
    """The coordinate that differs most, in standard deviations; None if no difference is significant."""
    size = np.abs(shift) / np.sqrt(np.maximum(variance, 1e-300))
    index = int(np.argmax(size))
    found = size[index] > SIGNIFICANT and abs(shift[index]) > IRRELEVANT
    return (index if found else None), float(size[index])


def _from(coordinates: Coordinates, z: FloatArray, other: Estimate) -> tuple[FloatArray, FloatArray]:
    """How far another estimate is from ``z`` in its coordinates, nearly, and the variance of that estimate."""
    at = other.coordinates.values(other.z)
    away = np.array([at[name] - value for name, value in coordinates.values(z).items()])
    slope, its = np.abs(coordinates.slopes(z)), np.abs(other.coordinates.slopes(other.z))
    slope = np.maximum(slope, 1e-300)
    return away / slope, np.maximum(np.diag(other.covariance), 0.0) * (its / slope) ** 2


def band_sensitive(
    linear: Linearised,
    covariance: FloatArray,
    units: Mapping[str, str],
    variance_factor: float = 1.0,
    common: FloatArray | None = None,
    freedom: FloatArray | None = None,
) -> list[ResultWarning]:
    """A warning for each parameter that the lower or the upper two thirds of the frequencies would move.

    A part that hardly determines a parameter says nothing of it.

    Args:
        linear: the fit, linearised at the estimate.
        covariance: of the estimate, as stated, shape (p, p); a shift within its standard uncertainty is covered.
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
        if keep.sum() < len(linear.z) + 3:
            continue
        part_covariance = linear.solve(keep)[1]
        shift, scatter = shift_without(linear, keep, freedom)
        variance = np.maximum(scatter, LEAST**2 * np.diag(whole_covariance)) * variance_factor
        for effect in () if common is None else common.T:
            with_it = replace(linear, rest=effect)
            variance = variance + (with_it.solve(keep)[0] - with_it.solve()[0]) ** 2
        spread = np.sqrt(variance)
        moved = np.abs(shift) > np.maximum(np.maximum(SIGNIFICANT_SHIFT * spread, IRRELEVANT), stated)
        told = variance_factor * np.diag(part_covariance) < WEAK**2
        for index in np.flatnonzero(moved & told):
            size = float(abs(shift[index]) / spread[index])
            if size > worst.get(int(index), (0.0, ""))[0]:
                times = float(abs(shift[index]) / stated[index]) if stated[index] > 0 else size
                worst[int(index)] = (size, _sentence(linear, shift, int(index), label, times, units))
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
    linear: Linearised, shift: FloatArray, index: int, label: str, times: float, units: Mapping[str, str]
) -> str:
    coordinates, moved = linear.coordinates, np.array(linear.z)
    spec = coordinates.model.parameters[index]
    moved[index] += shift[index]
    before, after = coordinates.values(linear.z)[spec.name], coordinates.values(moved)[spec.name]
    unit = units[spec.name]
    return (
        f"The {in_words(spec.name)} would be about {amount(after, unit)} instead of {amount(before, unit)} "
        f"{label}: {times:.1f} times its stated u."
    )
