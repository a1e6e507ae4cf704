"""Do the tones alone say what the records say?"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from vibrident.base.amounts import amount
from vibrident.data.records import FloatArray
from vibrident.fit.estimators import Estimate
from vibrident.fit.problem import Coordinates
from vibrident.fit.uncertainty.linearised import Linearised
from vibrident.physics.naming import in_words
from vibrident.result import ResultWarning

SIGNIFICANT = 4.0  # joint standard uncertainties by which estimates of the same data may differ
IRRELEVANT = 1e-4  # shifts of the coordinates (relative, nearly) below this are of no use to anybody


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
