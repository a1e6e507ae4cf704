"""A response that the model misses: ŷ in each of eight bands, in phase and turned by a quarter."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from typing import ClassVar

import numpy as np

from vibrident.base.warning_kinds import WarningCode
from vibrident.fit.departures.departure import Candidate, Departure, Places, Scale
from vibrident.fit.departures.group import WhitenedGroup
from vibrident.fit.departures.points import Point, PointsPart
from vibrident.fit.departures.score import Score
from vibrident.fit.response.response import ComplexArray

#: Bands of the frequencies of points.
POINT_BANDS = 4
#: Fewest frequencies of points that are divided into bands.
MIN_FREQUENCIES = 6


class Bands(Departure):
    """A complex factor of its own in each band of like information."""

    name: ClassVar[str] = "bands"
    code: ClassVar[WarningCode] = "band_sensitive"
    own_columns: ClassVar[bool] = True
    joint: ClassVar[bool] = False

    def columns(self, group: WhitenedGroup, scale: Scale) -> Iterable[tuple[str, ComplexArray]]:
        """Yield the motion in each band; a sine has one frequency."""
        if group.pull is None:
            edges = np.searchsorted(group.hz, scale.bands_hz).tolist()
            columns = np.zeros((*group.likely.shape[:1], len(edges) - 1, 2, group.bins), complex)
            for number, (first, end) in enumerate(pairwise(edges)):
                motion = group.likely[:, first:end]
                columns[:, number, :, first:end] = np.stack([motion, 1j * motion], axis=1)
            yield "", columns.reshape(len(columns), -1, group.bins)

    def places(self, group: WhitenedGroup, scale: Scale) -> list[Places]:
        """Return the place by sums over the bands, as each column is in one of them alone."""
        if group.pull is not None:
            return []
        edges = pairwise(np.searchsorted(group.hz, scale.bands_hz).tolist())
        motion = group.whiten(group.likely[:, None]).view(complex)
        rows = np.concatenate([group.comparison_rows.view(complex), motion], axis=1)
        products = np.conj(motion) * rows
        sums = np.stack([np.sum(products[..., slice(*band)], axis=2) for band in edges], axis=1)
        columns = np.stack([np.real(sums), np.imag(sums)], axis=2).reshape(
            len(sums), 1, -1, rows.shape[1]
        )
        gram = np.repeat(columns[..., ::2, -1], 2, axis=-1)[..., None] * np.eye(columns.shape[2])
        tested = group.sums_of_products(columns[..., :-1], gram)
        return [Places((Candidate(""),), tested, np.ones((len(sums), 1), dtype=bool))]

    def at_points(self, points: PointsPart) -> list[Point]:
        """Return a complex factor of the points of each band."""
        order = np.argsort(points.frequency_hz, kind="stable")
        if len(np.unique(points.frequency_hz)) < MIN_FREQUENCIES:
            return []
        bands = [
            np.isin(np.arange(order.size), places) for places in np.array_split(order, POINT_BANDS)
        ]
        return [
            Point(
                "",
                np.array([factor * band for band in bands for factor in (1.0, 1j)], dtype=complex),
            )
        ]

    def sentence(self, candidate: Candidate, score: Score) -> str:
        """Return the clause that the model misses a band."""
        return "the model is not equally right over the whole band"


BANDS = Bands()
