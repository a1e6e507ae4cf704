"""A few bins of the records, by which places of a grid are compared.

Initial states and drift are projected out of response and forced response, so nothing leaks, and a
few bins say as much as all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import FloatArray
from vibrident.fit.bins.transfer import DiscreteTransfer
from vibrident.fit.group.group import Bins, Group
from vibrident.fit.group.network import combined, products
from vibrident.fit.information import inverse_where_shown
from vibrident.fit.problem.band import Band
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import power_of
from vibrident.fit.start.look import Look

#: Bins of all records together, and of one at least and at most.
ALL_BINS = 1000
MIN_BINS = 24
MAX_BINS = 600
#: Of each part of the band those bins that say most.
BINS_A_PART = 4


@dataclass(frozen=True, eq=False)
class CoarseRows:
    """Segments of one sampling rate at bins of their own.

    Attributes:
        bins: the segments.
        weight: shape (R, K), zero where a row has fewer bins.
        frequency_hz: shape (R, K).
    """

    bins: Bins
    weight: FloatArray
    frequency_hz: FloatArray

    def freed(
        self, networks: DiscreteTransfer, factors: ComplexArray | None = None
    ) -> ComplexArray:
        """Return forced responses and response, less what nuisance columns could imitate, times the root weight.

        Args:
            networks: of G places with T trials each, in leading axes (G, T); trials of a place have one denominator.
            factors: of the inputs at each place, shape (R, G, K); None: one.

        Returns:
            The forced responses, and the response last, shape (R, G, T + 1, K).
        """
        places, trials = networks.denominator.shape[:2]
        powers = networks.denominator.shape[2]
        segments, bins = self.weight.shape
        w = self.bins.shifted[:, None] ** np.arange(powers)[:, None]
        over = 1.0 / combined(networks.denominator[:, 0], w)[:, :, None]
        inputs = (w[:, :, None] * self.bins.inputs[:, None]).reshape(segments, -1, bins)
        forced = combined(networks.numerator.reshape(places * trials, inputs.shape[1]), inputs)
        states = ((1.0 + self.bins.shifted[:, None]) * w[:, :-1])[:, None] * over
        nuisances = [states, self.bins.unmoved[:, None]]
        if self.bins.edges:
            nuisances.append(states * over)
        behind = over if factors is None else over * factors[:, :, None]
        own = [
            forced.reshape(segments, places, trials, bins) * behind,
            self.bins.response[:, None, None],
        ]
        every = [
            np.broadcast_to(each, (segments, places, *each.shape[2:]))
            for each in (*nuisances, *own)
        ]
        rows = np.concatenate(every, axis=2)
        flat = rows.reshape(segments, places * rows.shape[2], bins)
        rows = self.bins.where_used(flat).reshape(rows.shape)
        rows *= np.sqrt(self.weight)[:, None, None]
        normal = products(rows, rows)
        count = sum(each.shape[2] for each in nuisances)
        amounts = normal[:, :, count:, :count] @ inverse_where_shown(normal[:, :, :count, :count])
        return rows[:, :, count:] - (amounts @ rows.view(float)[:, :, :count]).view(complex)


class _Row(NamedTuple):
    """A segment at bins of its own.

    Attributes:
        group: of the segment.
        row: its place there.
        response: its transform, samples that are left out filled in, shape (K,).
        weight: of the bins, shape (K,).
        bins: those chosen.
    """

    group: Group
    row: int
    response: ComplexArray
    weight: FloatArray
    bins: NDArray[np.int_]


def coarse_rows(band: Band, look: Look) -> list[CoarseRows]:
    """Choose the bins that say most, of as many records as there is room for."""
    weights = [look.weights_in(group) for group in band.groups]
    rows = [
        _Row(group, row, response[: group.grid.bins], weight[row], np.arange(0))
        for group, weight in zip(band.groups, weights, strict=True)
        for row, number in enumerate(group.segments)
        if (response := group.response[row] if group.used is None else look.filled.get(number))
        is not None
    ]
    if not rows:  # no segment is whole, nor has enough bins to be filled in: all of their bins
        return [
            CoarseRows(group, weight, np.broadcast_to(group.grid.frequency_hz, weight.shape))
            for group, weight in zip(band.groups, weights, strict=True)
        ]
    if len(rows) > (most := ALL_BINS // MIN_BINS):
        rows = [rows[place] for place in np.linspace(0, len(rows) - 1, most).astype(int)]
    width = int(np.clip(ALL_BINS // len(rows), MIN_BINS, MAX_BINS))
    alike: dict[tuple[float, float], list[_Row]] = {}
    for row in rows:
        bins = _telling_bins(row.weight * power_of(row.response), width)
        alike.setdefault(row.group.step, []).append(row._replace(bins=bins))
    return [_joined(parts) for parts in alike.values()]


def _telling_bins(information: FloatArray, width: int) -> NDArray[np.int_]:
    """Return the bins with the most information in each of equal parts of a logarithmic band."""
    last = len(information)
    if last - 1 <= width:
        return np.arange(1, last)
    edges = np.unique(np.geomspace(1, last, width // BINS_A_PART + 1).astype(int))
    chosen = [
        begin + np.argsort(-information[begin:end], kind="stable")[:BINS_A_PART]
        for begin, end in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)
    ]
    bins = np.concatenate(chosen)
    if bins.size < width:  # narrow parts have fewer bins than they may
        others = np.setdiff1d(np.arange(1, last), bins)
        more = others[np.argsort(-information[others], kind="stable")[: width - bins.size]]
        bins = np.concatenate([bins, more])
    return np.sort(bins)


def _joined(rows: Sequence[_Row]) -> CoarseRows:
    """Join rows of one sampling rate; shorter ones end with bins of weight zero."""
    most = max(len(row.bins) for row in rows)
    columns = max(row.group.unmoved.shape[1] for row in rows)
    first = rows[0].group
    count = len(rows)
    inputs = np.zeros((count, first.inputs.shape[1], most), complex)
    response = np.zeros((count, most), complex)
    shifted = np.ones((count, most), complex)
    unmoved = np.zeros((count, columns, most), complex)
    weight = np.zeros((count, most))
    frequency_hz = np.ones((count, most))
    for place, row in enumerate(rows):
        size = len(row.bins)
        own = row.group.at(row.row, row.bins)
        inputs[place, :, :size] = own.inputs[0]
        response[place, :size] = row.response[row.bins]
        shifted[place, :size] = own.shifted[0]
        unmoved[place, : own.unmoved.shape[1], :size] = own.unmoved[0]
        weight[place, :size] = row.weight[row.bins]
        frequency_hz[place, :size] = row.group.grid.frequency_hz[row.bins]
    joined = Bins(first.step, inputs, response, shifted, unmoved, first.edges)
    return CoarseRows(joined, weight, frequency_hz)
