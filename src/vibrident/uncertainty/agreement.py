"""Do the tones alone say what the whole records say? Two ways to look at the same data."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vibrident.naming import amount, in_words
from vibrident.problem import Coordinates
from vibrident.records import FloatArray
from vibrident.result import ResultWarning
from vibrident.uncertainty.linearised import Linearised

#: Estimates of the same data by different estimators differ by less than this many of their joint standard
#: uncertainties.
SIGNIFICANT = 4.0
#: Shifts of the coordinates (relative, nearly) below this are of no use to anybody.
IRRELEVANT = 1e-4


def estimators_disagree(
    tones: Linearised,
    coordinates: Coordinates,
    z: FloatArray,
    covariance: FloatArray,
    units: Mapping[str, str],
    estimator: str,
) -> list[ResultWarning]:
    """A warning where the maximum-likelihood estimate from the tones alone lies elsewhere.

    Args:
        tones: the complex amplitudes of the sines, linearised at ``z``.
        coordinates: the map from z to parameters.
        z: the estimate, shape (p,).
        covariance: of z, shape (p, p).
        units: of the parameters, by name.
        estimator: that made it.
    """
    if len(tones.rest) < len(z) + 2:
        return []
    shift, own = tones.solve()
    spread = np.sqrt(np.diag(own) + np.maximum(np.diag(covariance), 0.0))
    size = np.abs(shift) / np.maximum(spread, 1e-300)
    index = int(np.argmax(size))
    if not (size[index] > SIGNIFICANT and abs(shift[index]) > IRRELEVANT):
        return []
    spec = coordinates.model.parameters[index]
    moved = np.array(z)
    moved[index] += shift[index]
    unit = units[spec.name]
    before, after = coordinates.values(z)[spec.name], coordinates.values(moved)[spec.name]
    text = (
        f"For the {in_words(spec.name)} {estimator} says {amount(before, unit, 6)}, the complex amplitudes of "
        f"the tones (maximum likelihood) about {amount(after, unit, 6)}: {size[index]:.1f} joint standard "
        "uncertainties apart."
    )
    return [ResultWarning("estimators_disagree", text)]
