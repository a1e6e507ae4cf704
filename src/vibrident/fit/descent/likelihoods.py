"""−2 log of the likelihoods of fits, each in its own noise, to compare them by."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.descent.in_noise import GroupAt
from vibrident.fit.noise.averages import MIN_POWER, averaged_bins, mean_around
from vibrident.fit.response.transform import power_of


def minus_two_log_likelihood(groups: Sequence[GroupAt]) -> float:
    """Return Σ |R|²/S + log S/P over the bins with motion (Whittle), P the power of the response.

    Where the reference shows noise alone the data say nothing of the sensor: the one that passes
    least of that noise would be the likeliest.
    """
    total = 0.0
    for place in groups:
        power = power_of(place.group.response) / place.group.count[:, None]
        level = mean_around(power, averaged_bins(power.shape[1]), 0)
        total += float(
            np.sum(_counts(place) * (_terms(place) - 1.0 - np.log(np.maximum(level, MIN_POWER))))
        )
    return total


def mean_minus_two_log_likelihood(groups: Sequence[GroupAt]) -> float:
    """Return −2 log of the likelihood for each number of the data.

    It compares fits of which some leave out samples.
    """
    grids = [place.group.grid for place in groups for _ in place.group.segments]
    numbers = sum(float(np.sum(grid.counts)) * grid.samples for grid in grids)
    return minus_two_log_likelihood(groups) / numbers


def compared_where_all_excited(fits: Sequence[Sequence[GroupAt]]) -> FloatArray:
    """Return −2 log of the likelihood of each of several fits, in the bins that count in all.

    It compares discretisations, which differ in the bins and records where motion counts. Where
    only noise of the reference is seen, the one that passes least of it would be the likeliest.

    Args:
        fits: the groups of each fit, of the same records; a segment that one lacks is left out.
    """
    terms = [dict(_terms_by_segment(groups)) for groups in fits]
    totals = np.zeros(len(fits))
    for number in set(terms[0]).intersection(*terms[1:]):
        of_segment = [of_fit[number] for of_fit in terms]
        sums = np.array([_sum_where_all_count(of_fit, of_segment) for of_fit in of_segment])
        counts = sums[:, 1]
        if np.all(counts > 0.0):  # segments of two fits may differ by the samples at their ends
            totals += sums[:, 0] / counts * np.min(counts)
    return totals


def spread_of_gain(first: Sequence[GroupAt], second: Sequence[GroupAt]) -> float:
    """Return the standard deviation of the difference of −2 log of two fits' likelihoods.

    It is that of a sum of as many independent terms as bins count in both: two fits of which none
    contains the other differ by so much by chance (Vuong 1989). Zero where their bins differ.

    Args:
        first: the groups of a fit.
        second: those of another fit of the same records.
    """
    first_terms, second_terms = (dict(_terms_by_segment(groups)) for groups in (first, second))
    variance = 0.0
    for number in set(first_terms).intersection(second_terms):
        before = first_terms[number]
        after = second_terms[number]
        if before.terms.size == after.terms.size:
            counts = np.minimum(before.counts, after.counts)
            variance += float(np.sum((counts * (before.terms - after.terms)) ** 2))
    return float(np.sqrt(variance))


class _SegmentTerms(NamedTuple):
    """−2 log of the likelihood of a segment, by bins.

    Attributes:
        frequency_hz: shape (K,).
        terms: of each number, shape (K,).
        counts: of the numbers that show motion, shape (K,).
    """

    frequency_hz: FloatArray
    terms: FloatArray
    counts: FloatArray


def _terms_by_segment(groups: Sequence[GroupAt]) -> Iterator[tuple[int, _SegmentTerms]]:
    """Yield the number of each segment of a fit with its terms."""
    for place in groups:
        grid = place.group.grid
        hz = np.arange(grid.bins, dtype=float) * (grid.rate_hz / grid.samples)
        for number, terms, row in zip(
            place.group.segments, _terms(place), _counts(place), strict=True
        ):
            yield number, _SegmentTerms(hz, terms, row)


def _sum_where_all_count(
    of_fit: _SegmentTerms, of_all: Sequence[_SegmentTerms]
) -> tuple[float, float]:
    """Return the sum of a fit's terms in the bins that count in all fits, and their count."""
    hz = of_fit.frequency_hz
    counts = [np.interp(hz, terms.frequency_hz, terms.counts, right=0.0) for terms in of_all]
    common = np.min(counts, axis=0)
    return float(np.sum(common * of_fit.terms)), float(np.sum(common))


def _counts(place: GroupAt) -> FloatArray:
    """Return the count of numbers that show motion at the bins of a group, shape (R, K)."""
    return np.asarray(place.weight * place.psd * place.group.grid.samples)


def _terms(place: GroupAt) -> FloatArray:
    """Return |R|²/S + log S of the bins of a group, shape (R, K)."""
    power = power_of(place.fitted_in_all_bins.residual) / place.group.count[:, None]
    return np.asarray(power / place.psd + np.log(place.psd))
