"""A few bins of the records, at which places of a grid are compared.

Initial states and drift are projected out of response and forced response, so nothing leaks, and a
few bins carry as much information as all.
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
from vibrident.fit.start.motion_and_noise import MotionAndNoise

#: Number of bins of all records together …
ALL_BINS = 1000
#: … and fewest and most of one record.
MIN_BINS = 24
MAX_BINS = 600
#: Noise of the reference counts where it is at least this fraction of that of the response.
MIN_REFERENCE_SHARE = 0.01
#: Number of bins, those with most information, in each interval of the band.
BINS_PER_INTERVAL = 4


@dataclass(frozen=True, eq=False)
class CoarseRows:
    """Segments of one sampling rate, each at its chosen bins.

    Attributes:
        bins: the segments.
        weight: in the noise of the response, shape (R, K), zero where a row has fewer bins.
        reference: noise of the reference over that of the response, per |H|², shape (R, K).
        counts: how often each bin counts where there is noise of the reference, shape (R, K).
        frequency_hz: shape (R, K).
    """

    bins: Bins
    weight: FloatArray
    reference: FloatArray
    counts: FloatArray
    frequency_hz: FloatArray

    def weight_at(self, through: FloatArray) -> FloatArray:
        """Return the weights in the noise of both channels, given |H|², shape (…, R, K)."""
        return np.asarray(self.weight / (1.0 + self.reference * through))

    def log_noise_at(self, through: FloatArray) -> FloatArray:
        """Return by how much noise of the reference raises −2 log likelihood, given |H|², (…,).

        A place that passes more of it has smaller weights, and would seem to fit better.
        """
        return np.sum(self.counts * np.log1p(self.reference * through), axis=(-2, -1))

    def freed(
        self,
        networks: DiscreteTransfer,
        factors: ComplexArray | None,
        weight: FloatArray,
    ) -> ComplexArray:
        """Return weighted forced responses and response, with the nuisance columns projected out.

        Args:
            networks: of G places with T trials each, in leading axes (G, T); trials of a place have
                one denominator.
            factors: of the inputs at each place, shape (R, G, K); None: one.
            weight: at each place, shape (R, G or 1, K).

        Returns:
            The forced responses, and the response last, times the root of the weights, shape (R, G,
                T + 1, K).
        """
        places, trials = networks.denominator.shape[:2]
        powers = networks.denominator.shape[2]
        segments, bins = self.weight.shape
        w = self.bins.shifted[:, None] ** np.arange(powers)[:, None]
        inverse = 1.0 / combined(networks.denominator[:, 0], w)[:, :, None]
        inputs = (w[:, :, None] * self.bins.inputs[:, None]).reshape(segments, -1, bins)
        forced = combined(networks.numerator.reshape(places * trials, inputs.shape[1]), inputs)
        states = ((1.0 + self.bins.shifted[:, None]) * w[:, :-1])[:, None] * inverse
        nuisances = [states, self.bins.fixed_nuisances[:, None]]
        if self.bins.edges:
            nuisances.append(states * inverse)
        scale = inverse if factors is None else inverse * factors[:, :, None]
        signals = [
            forced.reshape(segments, places, trials, bins) * scale,
            self.bins.response[:, None, None],
        ]
        columns = [
            np.broadcast_to(column, (segments, places, *column.shape[2:]))
            for column in (*nuisances, *signals)
        ]
        rows = np.concatenate(columns, axis=2)
        flat = rows.reshape(segments, places * rows.shape[2], bins)
        rows = self.bins.where_used(flat).reshape(rows.shape)
        rows *= np.sqrt(weight)[:, :, None]
        normal = products(rows, rows)
        count = sum(column.shape[2] for column in nuisances)
        amounts = normal[:, :, count:, :count] @ inverse_where_shown(normal[:, :, :count, :count])
        return rows[:, :, count:] - (amounts @ rows.view(float)[:, :, :count]).view(complex)


def with_likeliest_noise(rows: Sequence[CoarseRows], costs: FloatArray) -> FloatArray:
    """Return −2 log of the likelihood with the likeliest scale of all noise, at most one.

    Noise that is known without a model is at least the true one, and may be many times as much:
    then every place seems to explain the rows. With a scale c, −2 log L = V / c + N log c for N
    numbers, which is least at c = V / N.

    Args:
        rows: the rows.
        costs: weighted sums of squares V, shape (G,).
    """
    numbers = sum(float(np.sum(of_rate.counts)) for of_rate in rows)
    scale = np.clip(costs / max(numbers, 1.0), np.finfo(float).tiny, 1.0)
    return np.maximum(costs, numbers) + numbers * np.log(scale)


class _Row(NamedTuple):
    """Segment at its chosen bins.

    Attributes:
        group: of the segment.
        row: its index there.
        response: its transform, with omitted samples filled in, shape (K,).
        weight: of the bins in the noise of the response, shape (K,).
        reference: noise of the reference over that of the response, per |H|², shape (K,).
        counts: how often each bin counts where there is noise of the reference, shape (K,).
        information: power of the response over its noise, shape (K,).
        bins: those chosen.
    """

    group: Group
    row: int
    response: ComplexArray
    weight: FloatArray
    reference: FloatArray
    counts: FloatArray
    information: FloatArray
    bins: NDArray[np.int_]


class _Noise(NamedTuple):
    """Noise of the bins of a group.

    Attributes:
        weight: in the noise of the response, shape (R, K).
        reference: noise of the reference over that of the response, per |H|², shape (R, K).
        counts: how often each bin counts where there is noise of the reference, shape (R, K).
        share: the same, passed by the |H|² that the records show, shape (R, K).
    """

    weight: FloatArray
    reference: FloatArray
    counts: FloatArray
    share: FloatArray


def _noise_in(group: Group, observed: MotionAndNoise) -> _Noise:
    """Return the noise of a group; a weight that was given is that in all noise."""
    weight = observed.weights_in(group)
    if observed.weights:
        zeros = np.zeros_like(weight)
        return _Noise(weight, zeros, zeros, zeros)
    levels = observed.levels_in(group)
    reference = levels.reference / np.maximum(levels.response, np.finfo(float).tiny)
    return _Noise(weight, reference, weight * levels.response, reference * levels.passed)


def coarse_rows(band: Band, observed: MotionAndNoise) -> list[CoarseRows]:
    """Return the bins with most information, of as many records as there is room for."""
    noises = [_noise_in(group, observed) for group in band.groups]
    # Where noise of the reference counts nowhere, every place of a grid has the same weights.
    if all(np.all(noise.share < MIN_REFERENCE_SHARE) for noise in noises):
        noises = [noise._replace(reference=np.zeros_like(noise.reference)) for noise in noises]
    rows = [
        _Row(
            group,
            row,
            response[: group.grid.bins],
            noise.weight[row],
            noise.reference[row],
            noise.counts[row],
            power_of(response[: group.grid.bins]) * noise.weight[row] / (1.0 + noise.share[row]),
            np.arange(0),
        )
        for group, noise in zip(band.groups, noises, strict=True)
        for row, number in enumerate(group.segments)
        if (response := group.response[row] if group.used is None else observed.filled.get(number))
        is not None
    ]
    if not rows:  # no segment is complete or can be filled in: all of their bins
        return [
            CoarseRows(
                group,
                noise.weight,
                noise.reference,
                noise.counts,
                np.broadcast_to(group.grid.frequency_hz, noise.weight.shape),
            )
            for group, noise in zip(band.groups, noises, strict=True)
        ]
    if len(rows) > (limit := ALL_BINS // MIN_BINS):
        rows = [rows[place] for place in np.linspace(0, len(rows) - 1, limit).astype(int)]
    width = int(np.clip(ALL_BINS // len(rows), MIN_BINS, MAX_BINS))
    by_step: dict[tuple[float, float], list[_Row]] = {}
    for row in rows:
        bins = _informative_bins(row.information, width)
        by_step.setdefault(row.group.step, []).append(row._replace(bins=bins))
    return [_joined(step_rows) for step_rows in by_step.values()]


def _informative_bins(information: FloatArray, width: int) -> NDArray[np.int_]:
    """Return the bins with the most information in equal intervals of a logarithmic band."""
    last = len(information)
    if last - 1 <= width:
        return np.arange(1, last)
    edges = np.unique(np.geomspace(1, last, width // BINS_PER_INTERVAL + 1).astype(int))
    chosen = [
        begin + np.argsort(-information[begin:end], kind="stable")[:BINS_PER_INTERVAL]
        for begin, end in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)
    ]
    bins = np.concatenate(chosen)
    if bins.size < width:  # narrow intervals have fewer bins than they may
        not_chosen = np.setdiff1d(np.arange(1, last), bins)
        additional = not_chosen[
            np.argsort(-information[not_chosen], kind="stable")[: width - bins.size]
        ]
        bins = np.concatenate([bins, additional])
    return np.sort(bins)


def _joined(rows: Sequence[_Row]) -> CoarseRows:
    """Return rows of one sampling rate joined; shorter ones end with bins of weight zero."""
    width = max(len(row.bins) for row in rows)
    columns = max(row.group.fixed_nuisances.shape[1] for row in rows)
    first = rows[0].group
    count = len(rows)
    inputs = np.zeros((count, first.inputs.shape[1], width), complex)
    response = np.zeros((count, width), complex)
    shifted = np.ones((count, width), complex)
    fixed_nuisances = np.zeros((count, columns, width), complex)
    weight = np.zeros((count, width))
    reference = np.zeros((count, width))
    counts = np.zeros((count, width))
    frequency_hz = np.ones((count, width))
    for place, row in enumerate(rows):
        size = len(row.bins)
        at_bins = row.group.at(row.row, row.bins)
        inputs[place, :, :size] = at_bins.inputs[0]
        response[place, :size] = row.response[row.bins]
        shifted[place, :size] = at_bins.shifted[0]
        fixed_nuisances[place, : at_bins.fixed_nuisances.shape[1], :size] = at_bins.fixed_nuisances[
            0
        ]
        weight[place, :size] = row.weight[row.bins]
        reference[place, :size] = row.reference[row.bins]
        counts[place, :size] = row.counts[row.bins]
        frequency_hz[place, :size] = row.group.grid.frequency_hz[row.bins]
    joined = Bins(
        first.step, inputs, response, shifted, fixed_nuisances, first.edges, first.aliased
    )
    return CoarseRows(joined, weight, reference, counts, frequency_hz)
