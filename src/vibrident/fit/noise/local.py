"""Noise of a signal that is locally incoherent with a motion, without any model.

In each block of bins, columns that are smooth in frequency are projected out of the signal: a
quadratic times the motion, which any sensor's response to it nearly is, and a quadratic alone, as
leakage from other frequencies is (local polynomial method: Pintelon & Schoukens 2012, ch. 7).
Without the latter a displacement, whose low frequencies leak over all bins, would count as noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy import fft
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.noise.projection import (
    BLOCK_BINS,
    DEGREES,
    RIDGE,
    LocalColumns,
    polynomials_of,
)
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import power_of

#: Chance that any block without motion counts as one with motion.
MAX_CHANCE_OF_MOTION = 1e-3
#: A sensor rings where its motion decays by at least e^{-2πγ} over a record; a tone does not decay.
MIN_DECAY_BINS = 0.5
#: A resonance is narrower than this fraction of a block.
MAX_RESONANCE_WIDTH = 0.5
#: Blocks on either side that a level is averaged over.
NEIGHBOURS = 2
#: Omitted samples are filled in once the unexplained gradient is this fraction of the residual.
TOLERANCE = 1e-6
#: Most steps of conjugate gradients.
MAX_STEPS = 100


@dataclass(frozen=True, eq=False)
class SmoothColumns:
    """Columns that are smooth in frequency in each of B blocks of w bins, from bin 1 on.

    Attributes:
        columns: polynomials alone and times motions, in R times B blocks.
        records: R.
        share: fraction of the samples of the rows that are used.
    """

    columns: LocalColumns
    records: int
    share: float

    @classmethod
    def from_motions(
        cls, motions: Sequence[ComplexArray], shape: tuple[int, int], share: float
    ) -> SmoothColumns | None:
        """Return the columns for motions, or None where so few bins carry no information.

        Args:
            motions: each of shape (R, K).
            shape: R and K.
            share: fraction of the samples that are used. The fewer, the wider a block: each has as
                many independent numbers.
        """
        records, bins = shape
        blocks = max(int((bins - 1) * share) // BLOCK_BINS, 1)
        width = (bins - 1) // blocks
        if width * share < 2 * DEGREES * (len(motions) + 1) + 2:
            return None
        inner = slice(1, 1 + blocks * width)
        quadratic_alone = np.ones((records * blocks, width), complex)
        rows = [motion[:, inner].reshape(-1, width).copy() for motion in motions]
        return cls(LocalColumns.from_motions([quadratic_alone, *rows]), records, share)

    @property
    def width(self) -> int:
        """Return the bins of a block."""
        return int(self.columns.motions[0].shape[1])

    def in_blocks(self, rows: NDArray[Any]) -> NDArray[Any]:
        """Return rows (R, K) in blocks, shape (R B, w)."""
        blocks = len(self.columns.motions[0]) // self.records
        return rows[:, 1 : 1 + blocks * self.width].reshape(-1, self.width)

    def mean_of_blocks(self, bins: FloatArray) -> FloatArray:
        """Return the mean of values at the bins (K,) in each block, shape (B,)."""
        return np.mean(self.in_blocks(bins[None]), axis=1)

    def by_record(self, of_blocks: FloatArray) -> FloatArray:
        """Return numbers of blocks (R B,) by record, shape (R, B)."""
        return of_blocks.reshape(self.records, -1)

    def explained(self, rows: ComplexArray) -> ComplexArray:
        """Return the projection of rows onto all columns and an offset, shape (R, K)."""
        explained = np.zeros_like(rows)
        explained[:, 0] = rows[:, 0]
        blocks = self.columns.explained(self.in_blocks(rows)).reshape(len(rows), -1)
        explained[:, 1 : 1 + blocks.shape[1]] = blocks
        return explained

    def filled(self, rows: ComplexArray, used: BoolArray) -> ComplexArray:
        """Return rows with omitted samples filled in by the columns that fit the others best.

        Least squares over the used samples, by conjugate gradients (Hestenes & Stiefel 1952): a
        signal that is not known everywhere has no transform.

        Args:
            rows: bins below half the sampling rate of signals that are zero where not used, (R, K).
            used: shape (R, N).
        """
        samples = used.shape[1]

        def masked(signal: ComplexArray) -> ComplexArray:
            values = fft.irfft(signal, samples, axis=-1) * used
            return np.asarray(fft.rfft(values, axis=-1))[:, : rows.shape[1]]

        residual = rows.copy()
        estimate = np.zeros_like(rows)
        gradient = self.explained(residual)
        direction = gradient
        square = _inner(gradient, gradient)
        for _ in range(MAX_STEPS):
            if square <= TOLERANCE * _inner(residual, residual):
                break
            response = masked(direction)
            step = square / _inner(direction, response)
            estimate += step * direction
            residual -= step * response
            gradient = self.explained(residual)
            previous = square
            square = _inner(gradient, gradient)
            direction = gradient + (square / previous) * direction
        return estimate + residual

    def power_without_leaks(self, rows: ComplexArray) -> FloatArray:
        """Return the power of each block of rows (R, K) beyond leakage, shape (R, B)."""
        signal = self.in_blocks(rows)
        return self.by_record(np.sum(power_of(signal - leaks_in(signal)), axis=1))

    def level_at_bins(self, level: FloatArray, moving: BoolArray, bins: int) -> FloatArray:
        """Return powers of blocks at each of so many bins, smooth over five blocks, shape (R, K).

        Args:
            level: positive, shape (R, B).
            moving: blocks whose levels are averaged with each other, as are the others, (R, B).
            bins: K.
        """
        width = self.width
        middles = 1.0 + width * (np.arange(level.shape[1]) + 0.5)
        logarithms = np.log(np.maximum(_among(level, moving), 1e-300))
        return np.stack([np.exp(np.interp(np.arange(bins), middles, row)) for row in logarithms])

    def each_bin(self, blocks: BoolArray, bins: int) -> BoolArray:
        """Return what is true of blocks (R, B) for each of so many bins, shape (R, K)."""
        width = self.width
        rows = np.zeros((len(blocks), bins), dtype=bool)
        rows[:, 1 : 1 + blocks.shape[1] * width] = np.repeat(blocks, width, axis=1)
        return rows

    def incoherent_level(
        self, rows: ComplexArray, *, may_ring: bool = False
    ) -> tuple[FloatArray, BoolArray]:
        """Return the noise of rows, and where they move with the motions or ring.

        Args:
            rows: shape (R, K), with samples that are not used filled in.
            may_ring: whether a resonance may be narrower than a block.

        Returns:
            Power of the incoherent component of each block, shape (R, B); where samples are left
                out, that of the others. And whether it is more coherent with the motions than noise
                alone would be, shape (R, B).
        """
        signal = self.in_blocks(rows)
        residual = signal - self.columns.explained(signal)
        squares = self.by_record(np.sum(power_of(residual), axis=1))
        freedom = self._freedom(0.0)
        level = self.share * squares / freedom
        coherent = self.share * (self.power_without_leaks(rows) - squares)
        share = np.clip(squares / np.maximum(squares + coherent, 1e-300), 0.0, 1.0)
        # Of n − m complex numbers, m of them fitted: 1 − γ² is Beta(n − m, m) by chance, m = 3.
        coherence = 1.0 - share
        chance = share**freedom * (
            1.0 + freedom * coherence * (1.0 + 0.5 * (freedom + 1.0) * coherence)
        )
        # Where there is no motion the response lacks the noise of the reference: another level.
        moving = chance * chance.size < MAX_CHANCE_OF_MOTION
        if may_ring:
            ringing_level, ringing = self._ringing(signal, residual)
            level = np.where(ringing, ringing_level, level)
            moving |= ringing
        return level, moving

    def _freedom(self, more: float) -> FloatArray:
        """Return the degrees of freedom of the noise of blocks, shape (R, B).

        ``more``: numbers fitted beside the columns.
        """
        fitted = self.by_record(self.columns.count) + more
        return np.maximum(self.share * self.width - fitted, 1.0)

    def _ringing(
        self, signal: ComplexArray, residual: ComplexArray
    ) -> tuple[FloatArray, BoolArray]:
        """Return the noise of blocks beside a free motion in them, and where there is one.

        Beside a pole Y is no polynomial, but A Y is one for a line A that is zero at the pole
        (local rational method: Pintelon & Schoukens 2012, ch. 7). Of all A of one size, that of
        least residual is an eigenvector, so noise alone is as large for any (Pisarenko 1973).

        Args:
            signal: of each block, shape (R B, w).
            residual: what the columns leave of it, likewise.

        Returns:
            Power of the noise, and whether the block rings, shape (R, B) each.
        """
        width = signal.shape[1]
        place = np.linspace(-1.0, 1.0, width)
        slope_size = np.sqrt(np.mean(place**2))
        sloping = signal * (place / slope_size)
        residuals = np.stack([residual, sloping - self.columns.explained(sloping)], axis=1)
        squares, vectors = np.linalg.eigh(residuals @ np.conj(residuals).swapaxes(1, 2))
        squares = squares.reshape(self.records, -1, 2)
        freedom = self._freedom(1.0)
        least = np.maximum(squares[..., 0], 0.0)
        mean = np.mean(squares, axis=-1)
        share = np.divide(least, mean, out=np.ones_like(mean), where=mean > 0.0)
        # Chance of a share of noise: complex Wishart, to leading order, n! by Stirling (Edelman
        # 1988).
        log_factorial = (freedom + 0.5) * np.log(freedom) - freedom + 0.5 * np.log(2.0 * np.pi)
        count = freedom + 1.0
        log_chance = freedom * np.log(np.maximum(share, 1e-300) * count) + np.log(count)
        ringing = log_chance - log_factorial < np.log(MAX_CHANCE_OF_MOTION / share.size)
        constant, slope = np.conj(vectors[..., 0]).T.reshape(2, self.records, -1)
        slope = np.where(np.abs(slope) < RIDGE, RIDGE, slope / slope_size)
        pole = -constant / slope
        decay_bins = pole.imag * 0.5 * (width - 1)
        # A response that comes late turns with frequency as beside a pole far from the bins.
        ringing &= (np.abs(pole.real) < 1.0) & (pole.imag < MAX_RESONANCE_WIDTH)
        ringing &= decay_bins > MIN_DECAY_BINS
        ringing[:, 0] = False  # an offset between the ends of a record is a pole at zero frequency
        return self.share * least / freedom, ringing


def _inner(first: ComplexArray, second: ComplexArray) -> float:
    """Return the sum of products of two signals over their samples, up to a factor."""
    product = first.real * second.real + first.imag * second.imag
    return float(np.sum(product) - 0.5 * np.sum(product[:, 0]))


def _among(level: FloatArray, moving: BoolArray) -> FloatArray:
    """Return the mean of each block and its neighbours with equal ``moving``, shape (R, B)."""
    smooth = np.zeros_like(level)
    for same in (moving, ~moving):
        padded = np.zeros((2, len(level), level.shape[1] + 2 * NEIGHBOURS))
        padded[:, :, NEIGHBOURS:-NEIGHBOURS] = level * same, same
        total, number = np.sum(sliding_window_view(padded, level.shape[1], axis=2), axis=2)
        smooth += np.where(same, total / np.maximum(number, 1.0), 0.0)
    return smooth


def leaks_in(signal: ComplexArray) -> ComplexArray:
    """Return the projection of blocks (N, w) onto polynomials, as leakage into them is."""
    polynomials = polynomials_of(signal.shape[1])
    return (signal @ polynomials.T) @ polynomials
