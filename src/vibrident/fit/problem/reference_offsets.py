"""Offsets of references, which a nonlinear spring feels: it rests elsewhere.

The mean of a motion that is no whole number of periods is motion in part, and offset in part. A
linear sensor does not tell them apart. A nonlinear one does: taken for an offset, motion makes its
spring look stiffer on one side. The squares of a record's residual are close to a parabola in the
offset, of which three values determine the least.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.problem.coordinates import Coordinates
from vibrident.fit.response.rest import offset_of_reference

if TYPE_CHECKING:
    from vibrident.fit.problem.time_domain import TimeProblem

#: Motions whose offset another reading shows: the constant beside a tone, the rest around a shock.
WITH_KNOWN_OFFSET = ("sine", "shock", "decay")
#: Shares of the mean between which the parabola is seen, on either side of half of it at first, and
#: of the last estimate later.
FIRST_WIDTH = 0.5
WIDTH = 0.02
PLACES = (-1.0, 0.0, 1.0)  # of the three values, in widths
#: Shares beyond are left to other causes.
MAX_SHARE = 2.0
#: Fall of χ² below which offsets are the best: a third of a standard deviation.
MIN_FALL = 0.1


def with_fitted_offsets(
    problem: TimeProblem, z: FloatArray, coordinates: Coordinates, noise: FloatArray
) -> TimeProblem:
    """Return the problem with the offsets of references that explain most; itself if none do.

    Args:
        problem: of a nonlinear sensor.
        z: coordinates of the parameters, shape (p,).
        coordinates: of the parameters.
        noise: standard deviation of each record, shape (records,).
    """
    means = np.array([offset_of_reference(record) for record in problem.records])
    is_open = np.array([record.excitation not in WITH_KNOWN_OFFSET for record in problem.records])
    is_open &= means != 0.0
    if not is_open.any():
        return problem

    # The noise that the fit began with holds the misfit of its first step, too.
    normal = problem.normal(z, coordinates, noise)
    variance = problem.record_noise(normal, noise) ** 2

    def with_shares(shares: FloatArray) -> TimeProblem:
        return problem.at_reference_offsets(np.where(is_open, shares, 1.0) * means)

    def chi2(tried: TimeProblem) -> FloatArray:
        return tried.squares(tried.normal(z, coordinates, noise), noise) / variance

    current_shares = np.asarray(problem.frame.reference_offsets or means) / np.where(
        is_open, means, 1.0
    )
    searches = [(current_shares, WIDTH)]
    if problem.frame.reference_offsets is None:  # begin with a parabola over all of the mean
        searches.insert(0, (np.full(means.shape, FIRST_WIDTH), FIRST_WIDTH))
    current_chi2 = float(np.sum(problem.squares(normal, noise) / variance))
    for middle, width in searches:
        around = [chi2(with_shares(middle + width * place)) for place in PLACES]
        if not np.all(np.isfinite(around)):  # a softening spring has no motion there
            continue
        parabolas = np.polyfit(PLACES, around, 2)
        curved = np.where(parabolas[0] > 0.0, parabolas[0], np.inf)
        shares = middle - width * 0.5 * parabolas[1] / curved
        fitted = with_shares(np.clip(shares, -MAX_SHARE, MAX_SHARE))
        if current_chi2 - float(np.sum(chi2(fitted))) > MIN_FALL:
            return fitted
    return problem
