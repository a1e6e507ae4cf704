"""Normal equations of the network at the bins of its transform, initial states taken out.

The residual of a run is R = Y − (Σ_k b_k w^k · U + z Σ_{k<n} d_k w^k) / a(w): what initial state and leakage add is
spanned by z w^k / a, so their n numbers d are solved for exactly, and the slopes are freed of what they could imitate
(variable projection; Kaufman 1975), as in :mod:`vibrident.physics.network.sensitivity`. Hum is taken out in the same
way.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import FloatArray
from vibrident.fit.bins.segments import TONE_COLUMNS, Segment, shifted_lines, tone_bins
from vibrident.fit.bins.transfer import DiscreteTransfer
from vibrident.fit.information import inverse_where_shown
from vibrident.fit.response.response import ComplexArray

#: Lines that are worked on at once: they stay in the processor's cache.
AT_ONCE = 1 << 14


@dataclass(frozen=True, eq=False)
class BinNormal:
    """Least-squares problem of P parameters, summed over runs.

    Attributes:
        matrix: JᵀJ, shape (P, P), J = ∂(weighted response)/∂parameters.
        gradient: Jᵀr, shape (P,), r the weighted residual measured − network.
        cost: rᵀr.
        squares: rᵀr of every run, shape (runs,).
    """

    matrix: FloatArray
    gradient: FloatArray
    cost: float
    squares: FloatArray


@dataclass(frozen=True, eq=False)
class SegmentNormals:
    """The least-squares problems of R runs, each by itself, of residuals that are not weighted by noise.

    Attributes:
        matrix: JᵀJ, shape (R, P, P).
        gradient: Jᵀr, shape (R, P).
        squares: rᵀr, shape (R,).
    """

    matrix: FloatArray
    gradient: FloatArray
    squares: FloatArray

    @classmethod
    def of(cls, segments: int, p: int, value: float = 0.0) -> SegmentNormals:
        """Nothing yet of so many runs."""
        return cls(np.zeros((segments, p, p)), np.zeros((segments, p)), np.full(segments, value))

    def weighed(self, noise: FloatArray, turn: FloatArray) -> BinNormal:
        """The sum, each run weighed by one over its noise's variance.

        Args:
            noise: standard deviation of each run's noise, shape (R,).
            turn: derivative of each parameter with its coordinate, shape (P,).
        """
        weight = 1.0 / noise**2
        matrix, gradient = np.tensordot(weight, self.matrix, 1), weight @ self.gradient
        squares = weight * self.squares
        return BinNormal(matrix * np.outer(turn, turn), gradient * turn, float(np.sum(squares)), squares)


@dataclass(frozen=True, eq=False)
class Batch:
    """Runs of one sampling interval and length, side by side.

    Attributes:
        samples: N of each.
        inputs: shape (R, q, L).
        response: shape (R, L).
        runs: number of each run in the whole list, shape (R,).
        hum: places of the tones of hum, in bins.
    """

    samples: int
    inputs: ComplexArray
    response: ComplexArray
    segments: NDArray[np.int_]
    hum: tuple[float, ...]

    @classmethod
    def of(cls, segments: Sequence[Segment], numbers: Sequence[int]) -> Batch:
        """Runs of the same number of samples and tones of hum; ``numbers``: of each in the whole list."""
        inputs, response = (segment.inputs for segment in segments), (segment.response for segment in segments)
        joined = np.stack if len(segments) > 1 else _alone  # of a long run a copy counts
        joint = joined(list(inputs)), joined(list(response))
        return cls(segments[0].samples, *joint, np.asarray(numbers), segments[0].hum)

    def shifted(self, lines: slice = slice(None)) -> ComplexArray:
        """W = z − 1 at the lines, shape (1, lines)."""
        return shifted_lines(self.samples, lines)[None]


def _alone(arrays: Sequence[ComplexArray]) -> ComplexArray:
    return arrays[0][None]


@dataclass(frozen=True, eq=False)
class Step:
    """What runs of one sampling interval, length and hum have in common: one step of the network at their lines.

    Attributes:
        samples: N.
        transfer: transfer function of a step.
        slope: its derivatives with each parameter, in a leading axis of P.
        hum: places of tones, as of a batch.
        counts: how each line counts, shape (L,).
    """

    samples: int
    transfer: DiscreteTransfer
    slope: DiscreteTransfer
    hum: tuple[float, ...]
    counts: FloatArray

    @property
    def unknown(self) -> int:
        """Number of initial states, and of what the tones of hum add."""
        return len(self.transfer.denominator) - 1 + TONE_COLUMNS * len(self.hum)

    def blocks(self, first: int, last: int) -> Iterator[_Block]:
        """The lines from ``first`` up to ``last``; of many each block is made again when it is asked for.

        Together the blocks of a long run would need much memory.
        """
        for begin in range(first, last, AT_ONCE):
            lines = slice(begin, min(begin + AT_ONCE, last))
            yield self._kept(lines) if last - first <= AT_ONCE else self._block(lines)

    @functools.cached_property
    def counted(self) -> tuple[int, int]:
        """First of the lines that count, and the line behind the last."""
        those = np.flatnonzero(self.counts)
        return (int(those[0]), int(those[-1]) + 1) if those.size else (0, 0)

    @functools.cached_property
    def inverse(self) -> FloatArray:
        """Inverse of the products of the free responses with each other, over the lines that count, shape (n, n)."""
        gram = np.zeros((self.unknown, self.unknown))
        for block in self.blocks(*self.counted):
            gram += _products(block.weighted, block.free)
        return inverse_where_shown(gram)

    @functools.cached_property
    def _only(self) -> dict[tuple[int, int], _Block]:
        return {}

    def _kept(self, lines: slice) -> _Block:
        key = lines.start, lines.stop
        if key not in self._only:
            self._only[key] = self._block(lines)
        return self._only[key]

    def _block(self, lines: slice) -> _Block:
        w, order = shifted_lines(self.samples, lines), len(self.transfer.denominator) - 1
        over = 1.0 / horner(self.transfer.denominator, w)
        free = np.empty((self.unknown, len(w)), dtype=complex)
        np.multiply(1.0 + w, over, out=free[0])
        for k in range(1, order):
            np.multiply(free[k - 1], w, out=free[k])
        if self.hum:
            free[order:] = tone_bins(self.hum, self.samples, lines)
        weight = self.counts[lines]
        same = bool(np.all(weight == weight[0]))
        weighted = np.multiply(free, weight, dtype=complex)
        return _Block(lines, w, over, free, weighted, float(weight[0]) if same else weight)


class _Block(NamedTuple):
    """Some lines of a step.

    Attributes:
        lines: which.
        w: z − 1, shape (l,).
        over: 1/a, shape (l,).
        free: free responses T, then those of hum, shape (n, l).
        weighted: these as they count, shape (n, l).
        weight: how the lines count, one number or shape (l,).
    """

    lines: slice
    w: ComplexArray
    over: ComplexArray
    free: ComplexArray
    weighted: ComplexArray
    weight: FloatArray | float


def add_batch(normals: SegmentNormals, batch: Batch, step: Step) -> None:
    """Write the normal equations of a batch's runs into those of all."""
    p, segments = len(step.slope.denominator), len(batch.response)
    residuals, states = _residuals(batch, step, *step.counted)
    sums, shared = np.zeros((segments, p + 1, p + 1)), np.zeros((segments, step.unknown, p + 1))
    for block, residual in residuals:
        residual -= _of_states(states, block.free)
        columns = np.empty((segments, p + 1, residual.shape[-1]), dtype=complex)
        columns[:, p] = residual
        columns[:, :p] = _slopes(batch, step, block, residual, _hum_in(block, states, step))
        shared += _products(block.weighted, columns)
        if isinstance(block.weight, float):
            sums += _products(columns, columns) * block.weight
        else:
            sums += _products(np.multiply(columns, block.weight, dtype=complex), columns)
    # The part that initial states could imitate is removed from the slopes; the residual holds only rounding of it.
    freed = sums - np.swapaxes(shared, -1, -2) @ step.inverse @ shared
    normals.matrix[batch.segments], normals.gradient[batch.segments] = freed[:, :p, :p], freed[:, :p, p]
    normals.squares[batch.segments] = freed[:, p, p]


class Columns(NamedTuple):
    """Lines of runs.

    Attributes:
        residual: shape (R, L).
        slopes: without what other states and hum could imitate, shape (R, P, L).
        hum: what of the response is hum, shape (R, L).
    """

    residual: ComplexArray
    jacobian: ComplexArray
    hum: ComplexArray


def residual_and_jacobian(batch: Batch, step: Step) -> Columns:
    """Residual, slopes and hum of runs at all their lines, with the best states by those that count."""
    segments, lines = batch.response.shape
    p = len(step.slope.denominator)
    residuals, states = _residuals(batch, step, 0, lines)
    residual, jacobian = np.empty((segments, lines), complex), np.empty((segments, p, lines), complex)
    hum, shared = np.zeros((segments, lines if len(batch.hum) else 0), complex), np.zeros((segments, step.unknown, p))
    for block, left in residuals:
        part = block.lines
        left -= _of_states(states, block.free)
        residual[:, part], own = left, _hum_in(block, states, step)
        if len(batch.hum):
            hum[:, part] = own
        if p:
            jacobian[:, :, part] = _slopes(batch, step, block, left, own)
            shared += _products(block.weighted, jacobian[:, :, part])
    share = np.swapaxes(step.inverse @ shared, -1, -2)
    for block in step.blocks(0, lines) if p else ():
        jacobian[:, :, block.lines] -= _of_states(share, block.free)
    return Columns(residual, jacobian, hum)


def _residuals(
    batch: Batch, step: Step, first: int, last: int
) -> tuple[Iterator[tuple[_Block, ComplexArray]], FloatArray]:
    """Lines with the residual of the forced response, shape (R, l), and the states that fit it best, shape (R, n)."""
    right, kept = np.zeros((len(batch.response), step.unknown)), []
    for block in step.blocks(first, last):
        residual = _forced(batch, step, block)
        right += _products(block.weighted, residual[:, None])[..., 0]
        if last - first <= AT_ONCE:
            kept.append((block, residual))
    again = ((block, _forced(batch, step, block)) for block in step.blocks(first, last))
    return iter(kept) if kept else again, right @ step.inverse


def _forced(batch: Batch, step: Step, block: _Block) -> ComplexArray:
    """Residual of the forced response, shape (R, l)."""
    residual = _horner_of_inputs(step.transfer.numerator[None], batch.inputs[..., block.lines], block.w)[:, 0]
    residual *= -block.over
    residual += batch.response[:, block.lines]
    return residual


def _of_states(states: FloatArray, free: ComplexArray) -> ComplexArray:
    """Σ_n states[…, n] free[n], shape (…, l)."""
    return (states @ free.view(float)).view(complex)


def _hum_in(block: _Block, states: FloatArray, step: Step) -> ComplexArray | float:
    """What of a block's response is hum, by the coefficients ``states`` of its free responses; zero without hum."""
    count = TONE_COLUMNS * len(step.hum)
    return _of_states(states[:, -count:], block.free[-count:]) if count else 0.0


def _slopes(batch: Batch, step: Step, block: _Block, residual: ComplexArray, hum: ComplexArray | float) -> ComplexArray:
    """Slopes (Σ_k ∂b_k w^k · U − ŷ ∂a) / a of the response ŷ; shape (R, P, l)."""
    modelled = batch.response[:, block.lines] - residual
    modelled -= hum
    driven = _horner_of_inputs(step.slope.numerator, batch.inputs[..., block.lines], block.w)
    for number, denominator in enumerate(step.slope.denominator):
        if np.any(denominator):
            driven[:, number] -= modelled * horner(denominator, block.w)
    driven *= block.over
    return driven


def modelled_slopes(
    slope: DiscreteTransfer, inputs: ComplexArray, modelled: ComplexArray, w: ComplexArray, over: ComplexArray
) -> ComplexArray:
    """Slopes (Σ_k ∂b_k w^k · U − ŷ ∂a) / a of the response ŷ of one run, initial state held; shape (P, L)."""
    driven = _horner_of_inputs(slope.numerator, inputs[None], w)[0]
    aside = [modelled * horner(denominator, w) for denominator in slope.denominator]
    return np.asarray((driven - np.reshape(aside, driven.shape)) * over)


def horner(coefficients: FloatArray, w: ComplexArray) -> ComplexArray:
    """Value of a polynomial with ascending coefficients, in the shape of ``w``."""
    value = np.full(w.shape, coefficients[-1], dtype=complex)
    for coefficient in coefficients[-2::-1]:
        value *= w
        value += coefficient
    return value


def _horner_of_inputs(numerators: FloatArray, inputs: ComplexArray, w: ComplexArray) -> ComplexArray:
    """Σ_k w^k Σ_j b[p, k, j] U_j; (P, n + 1, q) and (R, q, l) → (R, P, l)."""
    p, powers, terms = numerators.shape
    while powers > 1 and not np.any(numerators[:, powers - 1]):  # without the input itself in the response
        powers -= 1
    flat = np.swapaxes(numerators[:, :powers], 0, 1).reshape(powers * p, terms)
    parts = (flat @ np.ascontiguousarray(inputs).view(float)).view(complex)  # real times complex, by real BLAS
    value = parts[:, -p:]
    for k in range(powers - 2, -1, -1):
        value *= w
        value += parts[:, k * p : (k + 1) * p]
    return value


def _products(one: ComplexArray, other: ComplexArray) -> FloatArray:
    """Re Σ one* other over lines: (…, i, L) and (…, j, L) → (…, i, j)."""
    return one.view(float) @ np.swapaxes(np.ascontiguousarray(other).view(float), -1, -2)
