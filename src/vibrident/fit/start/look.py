"""What records say before any model: the noise of their bins, and the band of their motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.group.band import Band
from vibrident.fit.group.group import Group
from vibrident.fit.noise.local import BLOCK_BINS, incoherent_level
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import power_of

#: A bin shows motion where the response's power is so many times the noise.
HEARD = 10.0
#: Part of its weight that a bin without motion keeps, so that the equations stay regular.
MIN_WEIGHT = 1e-9


@dataclass(frozen=True, eq=False)
class Look:
    """Noise of the response given the motion, without a model.

    Attributes:
        levels: PSD of the noise of each group's bins, shape (R, K) each.
        weights: of the bins, next to zero where no motion shows, shape (R, K) each.
        heard: samples, and bins at which motion shows in the response, by number of the segment.
        band_hz: lowest and highest frequency at which response and reference have something in
            common.
    """

    levels: tuple[FloatArray, ...]
    weights: tuple[FloatArray, ...]
    heard: Mapping[int, tuple[int, BoolArray]]
    band_hz: tuple[float, float]

    def heard_in(self, group: Group) -> BoolArray:
        """Return where motion shows in a group of the same lengths, shape (R, K)."""
        return np.stack([self.heard[number][1] for number in group.segments])

    def weighed(self, weights: Sequence[FloatArray]) -> Look:
        """Return the same with other weights of each group's bins, shape (R, K) each."""
        return replace(self, weights=tuple(weights))


def look_at(band: Band) -> Look:
    """Measure the noise of each group, and the band of the motion."""
    levels: list[FloatArray] = []
    weights: list[FloatArray] = []
    shown: list[FloatArray] = []
    audible: dict[int, tuple[int, BoolArray]] = {}
    everywhere: list[FloatArray] = []
    for group in band.groups:
        level, sure = _level_of(group)
        heard = power_of(group.response) > HEARD * level
        blocks = sure.shape[1]
        if blocks and group.grid.driven:  # what leaks over from elsewhere is no motion
            place = (np.arange(group.grid.bins) - 1) // ((group.grid.bins - 1) // blocks)
            heard &= sure[:, np.clip(place, 0, blocks - 1)]
        samples = group.grid.samples
        audible |= {n: (samples, row) for n, row in zip(group.segments, heard, strict=True)}
        floor = np.maximum(level, np.finfo(float).tiny)
        weight = group.grid.counts * (heard + MIN_WEIGHT) * group.grid.samples / floor
        levels.append(level / group.count[:, None])
        weights.append(weight)
        frequency = group.grid.frequency_hz
        everywhere.append(frequency[[1, group.grid.last - 1]])
        if not group.grid.driven:  # free motion is where it is heard
            loud = np.flatnonzero(np.any(heard[:, 1:], axis=0))
            shown.append(frequency[1 + loud[[0, -1]]] if loud.size else frequency[:0])
        elif blocks:
            width = (group.grid.bins - 1) // blocks
            first = 1 + width * np.flatnonzero(np.any(sure, axis=0))
            shown.append(frequency[first])
            shown.append(frequency[np.minimum(first + width - 1, group.grid.last - 1)])
    span = np.concatenate(shown) if shown else np.zeros(0)
    span = span if span.size else np.concatenate(everywhere)
    band_hz = float(np.min(span)), float(np.max(span))
    return Look(tuple(levels), tuple(weights), audible, band_hz)


def _level_of(group: Group) -> tuple[FloatArray, BoolArray]:
    """Return the power of each bin's noise, shape (R, K), and where blocks show motion."""
    if not group.grid.driven:
        return incoherent_level(group.response, [])
    motion = group.inputs[:, 0]
    level, sure = incoherent_level(group.response, [motion])
    # Noise of the reference is not in the response; at a lone tone it shows in nothing else.
    felt, _ = incoherent_level(motion, [group.response])
    return level + felt * _gain_squared(group.response, motion), sure


def _gain_squared(response: ComplexArray, motion: ComplexArray) -> FloatArray:
    """Return the power of the response over that of the motion around each bin, shape (R, K)."""
    sums = []
    for rows in (response, motion):
        power = power_of(rows)
        power[:, 0] = power[:, 1]
        sums.append(_sum_around(power, min(BLOCK_BINS, power.shape[1])))
    return np.divide(sums[0], sums[1], out=np.zeros_like(sums[0]), where=sums[1] > 0.0)


def _sum_around(rows: FloatArray, width: int) -> FloatArray:
    """Return the sum of ``width`` bins around each, mirrored at the ends; shape (R, K)."""
    before = width // 2
    sums = np.pad(rows, ((0, 0), (before, width - 1 - before)), mode="symmetric")
    np.cumsum(sums, axis=1, out=sums)
    within = sums[:, width - 1 :].copy()
    within[:, 1:] -= sums[:, :-width]
    return within
