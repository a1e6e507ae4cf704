"""Normal equations of the network at the lines of its transform, initial states taken out.

The residual of a run is R = Y − (Σ_k b_k w^k · U + z Σ_{k<n} d_k w^k) / a(w): what initial state and leakage add is
spanned by z w^k / a, so their n numbers d are solved for exactly, and the slopes are freed of what they could imitate
(variable projection; Kaufman 1975), as in :mod:`vibrident.network.sensitivity`. Hum is the free motion of an undamped
oscillator, and taken out in the same way.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrident.information import inverse_where_shown
from vibrident.lines.runs import Run, shifted_lines
from vibrident.lines.transfer import StepTransfer
from vibrident.measure.response import ComplexArray
from vibrident.records import FloatArray

#: Lines that are worked on at once: they stay in the processor's cache.
AT_ONCE = 1 << 14
#: A tone is kept this part of a line off the lines, where its transform has poles; its slopes make up for that.
OFF_LINES = 0.01
#: Columns of a tone: cosine, sine, and both growing with time.
TONE_COLUMNS = 4


@dataclass(frozen=True, eq=False)
class LineNormal:
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
class RunNormals:
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
    def of(cls, runs: int, p: int, value: float = 0.0) -> RunNormals:
        """Nothing yet of so many runs."""
        return cls(np.zeros((runs, p, p)), np.zeros((runs, p)), np.full(runs, value))

    def weighed(self, noise: FloatArray, turn: FloatArray) -> LineNormal:
        """The sum, each run weighed by one over its noise's variance.

        Args:
            noise: standard deviation of each run's noise, shape (R,).
            turn: derivative of each parameter with its coordinate, shape (P,).
        """
        weight = 1.0 / noise**2
        matrix, gradient = np.tensordot(weight, self.matrix, 1), weight @ self.gradient
        squares = weight * self.squares
        return LineNormal(matrix * np.outer(turn, turn), gradient * turn, float(np.sum(squares)), squares)


@dataclass(frozen=True, eq=False)
class Batch:
    """Runs of one sampling interval and length, side by side.

    Attributes:
        samples: N of each.
        inputs: shape (R, q, L).
        response: shape (R, L).
        runs: number of each run in the whole list, shape (R,).
        hum: c of the denominator w² + c w + c of each tone of hum, shape (tones,).
    """

    samples: int
    inputs: ComplexArray
    response: ComplexArray
    runs: NDArray[np.int_]
    hum: FloatArray

    @classmethod
    def of(cls, runs: Sequence[Run], numbers: Sequence[int]) -> Batch:
        """Runs of the same number of samples and tones of hum; ``numbers``: of each in the whole list."""
        inputs, response = (run.inputs for run in runs), (run.response for run in runs)
        joined = np.stack if len(runs) > 1 else _alone  # of a long run a copy counts
        return cls(runs[0].samples, joined(list(inputs)), joined(list(response)), np.asarray(numbers), _hum(runs[0]))

    def shifted(self, lines: slice = slice(None)) -> ComplexArray:
        """W = z − 1 at the lines, shape (1, lines)."""
        return shifted_lines(self.samples, lines)[None]


def _hum(run: Run) -> FloatArray:
    places = np.array(run.hum)
    beside = np.round(places)
    near = np.abs(places - beside) < OFF_LINES
    places = np.where(near, beside + np.copysign(OFF_LINES, places - beside), places)
    return 4.0 * np.sin(np.pi * places / run.samples) ** 2


def _alone(arrays: Sequence[ComplexArray]) -> ComplexArray:
    return arrays[0][None]


def add_batch(
    normals: RunNormals, batch: Batch, transfer: StepTransfer, slope: StepTransfer, counts: FloatArray
) -> None:
    """Write the normal equations of a batch's runs into those of all.

    Args:
        normals: of all runs.
        batch: the runs.
        transfer: transfer function of a step.
        slope: its derivatives with each parameter, in a leading axis of P.
        counts: how each line counts, shape (1, L).
    """
    runs = batch.runs
    normals.matrix[runs], normals.gradient[runs], normals.squares[runs] = _of_batch(
        batch, transfer, slope, np.broadcast_to(np.sqrt(counts), batch.response.shape)
    )


class _Block(NamedTuple):
    """Some lines of a batch, weighted.

    Attributes:
        lines: which.
        over: 1/a, shape (1 or R, l).
        free: free responses T, then those of hum, shape (R, n, l).
        residual: shape (R, l).
    """

    lines: slice
    over: ComplexArray
    free: ComplexArray
    residual: ComplexArray


@dataclass(frozen=True, eq=False)
class _Blocks:
    """The lines of a batch, block by block; of more than one block each is made again when it is asked for.

    Together the blocks of a long run would need much memory.
    """

    batch: Batch
    transfer: StepTransfer
    root: FloatArray

    def __iter__(self) -> Iterator[_Block]:
        lines = self.batch.response.shape[1]
        if lines <= AT_ONCE:
            yield self._only
            return
        for begin in range(0, lines, AT_ONCE):
            yield _forced(self.batch, self.transfer, self.root, slice(begin, begin + AT_ONCE))

    @functools.cached_property
    def _only(self) -> _Block:
        return _forced(self.batch, self.transfer, self.root, slice(0, AT_ONCE))


def _columns_beside(batch: Batch, transfer: StepTransfer) -> int:
    """Number of initial states, and of what the tones of hum add."""
    return len(transfer.denominator) - 1 + TONE_COLUMNS * len(batch.hum)


def _of_batch(
    batch: Batch, transfer: StepTransfer, slope: StepTransfer, root: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """JᵀJ, Jᵀr and rᵀr of every run; ``root``: of how the lines count, shape (R, L)."""
    n, p, runs = _columns_beside(batch, transfer), len(slope.denominator), len(batch.response)
    blocks = _Blocks(batch, transfer, root)
    gram, right = np.zeros((runs, n, n)), np.zeros((runs, n, 1))
    for block in blocks:
        gram += _products(block.free, block.free)
        right += _products(block.free, block.residual[:, None])
    inverse = inverse_where_shown(gram)
    states = inverse @ right
    sums = np.zeros((runs, p + n + 1, p + 1))
    for block in blocks:
        block.residual[:] -= np.einsum("rn,rnl->rl", states[..., 0], block.free)
        columns = _slopes(batch, slope, block, root, _hum_in(block, states[..., 0], batch))
        sums += _products(np.concatenate([columns, block.free], axis=1), columns[:, : p + 1])
    # The part that initial states could imitate is removed from the slopes; the residual holds only rounding of it.
    shared = sums[:, p + 1 :]
    freed = sums[:, : p + 1] - np.swapaxes(shared, -1, -2) @ inverse @ shared
    return freed[:, :p, :p], freed[:, :p, p], freed[:, p, p]


class Columns(NamedTuple):
    """Lines of runs, not weighted.

    Attributes:
        residual: shape (R, L).
        slopes: without what other states and hum could imitate, shape (R, P, L).
        hum: what of the response is hum, shape (R, L).
    """

    residual: ComplexArray
    slopes: ComplexArray
    hum: ComplexArray


def columns_of(batch: Batch, transfer: StepTransfer, slope: StepTransfer, root: FloatArray) -> Columns:
    """Residual, slopes and hum of runs, with the best states by ``root``."""
    runs, lines = batch.response.shape
    p, one = len(slope.denominator), np.broadcast_to(1.0, root.shape)
    n = _columns_beside(batch, transfer)
    blocks = _Blocks(batch, transfer, one)
    gram, right, shared = np.zeros((runs, n, n)), np.zeros((runs, n, 1)), np.zeros((runs, n, p))
    for block in blocks:
        free = block.free * root[:, None, block.lines] ** 2
        gram += _products(free, block.free)
        right += _products(free, block.residual[:, None])
    inverse = inverse_where_shown(gram)
    states = (inverse @ right)[..., 0]
    residual, slopes = np.empty((runs, lines), complex), np.empty((runs, p, lines), complex)
    hum = np.zeros((runs, lines if len(batch.hum) else 0), complex)
    for block in blocks:
        part = block.lines
        block.residual[:] -= np.einsum("rn,rnl->rl", states, block.free)
        residual[:, part], own = block.residual, _hum_in(block, states, batch)
        if len(batch.hum):
            hum[:, part] = own
        if p:
            slopes[:, :, part] = _slopes(batch, slope, block, one, own)[:, :-1]
            shared += _products(block.free * root[:, None, part] ** 2, slopes[:, :, part])
    share = inverse @ shared
    for block in blocks if p else ():
        slopes[:, :, block.lines] -= np.einsum("rnp,rnl->rpl", share, block.free)
    return Columns(residual, slopes, hum)


def _forced(batch: Batch, transfer: StepTransfer, root: FloatArray, lines: slice) -> _Block:
    """Residual of the forced response, and the free responses."""
    w, root = batch.shifted(lines), root[:, lines]
    over = 1.0 / horner(transfer.denominator, w)
    residual = _horner_of_inputs(transfer.numerator[None], batch.inputs[..., lines], w)[:, 0]
    residual *= -over
    residual += batch.response[:, lines]
    residual *= root
    order = len(transfer.denominator) - 1
    free = np.empty((len(root), order + TONE_COLUMNS * len(batch.hum), w.shape[-1]), dtype=complex)
    np.multiply((1.0 + w) * over, root, out=free[:, 0])
    for k in range(1, order):
        np.multiply(free[:, k - 1], w, out=free[:, k])
    for tone, c in enumerate(batch.hum):  # z w^k / q and z w^k / q², k = 0, 1
        own = free[:, order + TONE_COLUMNS * tone :]
        tone_over = c / (w * w + c * w + c)
        np.multiply((1.0 + w) * tone_over, root, out=own[:, 0])
        np.multiply(own[:, 0], tone_over, out=own[:, 2])
        np.multiply(own[:, 0:4:2], w[:, None], out=own[:, 1:4:2])
    return _Block(lines, over, free, residual)


def _hum_in(block: _Block, states: FloatArray, batch: Batch) -> ComplexArray | float:
    """What of a block's response is hum, by the coefficients ``states`` of its free responses; zero without hum."""
    if not len(batch.hum):
        return 0.0
    count = TONE_COLUMNS * len(batch.hum)
    return np.einsum("rn,rnl->rl", states[:, -count:], block.free[:, -count:])


def _slopes(
    batch: Batch, slope: StepTransfer, block: _Block, root: FloatArray, hum: ComplexArray | float
) -> ComplexArray:
    """Weighted slopes (Σ_k ∂b_k w^k · U − ŷ ∂a) / a of the response ŷ, then the residual; shape (R, P + 1, l)."""
    w, root = batch.shifted(block.lines), root[:, block.lines]
    columns = np.empty((len(root), len(slope.denominator) + 1, w.shape[-1]), dtype=complex)
    columns[:, -1] = block.residual
    modelled = (root * batch.response[:, block.lines] - block.residual - hum) * block.over
    driven = _horner_of_inputs(slope.numerator, batch.inputs[..., block.lines], w)
    driven *= (root * block.over)[:, None]
    columns[:, :-1] = driven
    for number, denominator in enumerate(slope.denominator):
        if np.any(denominator):
            columns[:, number] -= modelled * horner(denominator, w)
    return columns


def modelled_slopes(
    slope: StepTransfer, inputs: ComplexArray, modelled: ComplexArray, w: ComplexArray, over: ComplexArray
) -> ComplexArray:
    """Slopes (Σ_k ∂b_k w^k · U − ŷ ∂a) / a of the response ŷ of one run, initial state held; shape (P, L)."""
    driven = _horner_of_inputs(slope.numerator, inputs[None], w[None])[0]
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
    flat = np.swapaxes(numerators, 0, 1).reshape(powers * p, terms)
    parts = (flat @ np.ascontiguousarray(inputs).view(float)).view(complex)  # real times complex, by real BLAS
    value = parts[:, -p:]
    for k in range(powers - 2, -1, -1):
        value *= w[:, None]
        value += parts[:, k * p : (k + 1) * p]
    return value


def _products(one: ComplexArray, other: ComplexArray) -> FloatArray:
    """Re Σ one* other over lines: (R, i, L) and (R, j, L) → (R, i, j)."""
    return one.view(float) @ np.swapaxes(np.ascontiguousarray(other).view(float), -1, -2)
