"""What of a signal has locally nothing in common with a motion: noise, without any model.

In each block of bins, columns that are smooth in frequency are projected out of the signal: a
quadratic times the motion, which any sensor's response to it is nearly, and a quadratic of its own,
as what leaks over from other frequencies is (local polynomial method: Pintelon & Schoukens 2012,
ch. 7). Without the latter a displacement, whose low frequencies leak over all bins, would count as
noise.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import power_of

#: Bins of a block.
BLOCK_BINS = 24
#: Degrees of a polynomial in a block, and one: a quadratic.
DEGREES = 3
#: Blocks on either side that a level is averaged over.
NEIGHBOURS = 2


def incoherent_level(
    signal: ComplexArray, motions: Sequence[ComplexArray]
) -> tuple[FloatArray, FloatArray]:
    """Return the power of what has locally nothing in common with motions, and of the signal.

    Args:
        signal: shape (R, K); bin 0 is left out.
        motions: each of shape (R, K).

    Returns:
        Level of each bin, shape (R, K), smooth over five blocks; and the chance that noise alone
        has as much in common with the motions in each of B blocks, shape (R, B).
    """
    records, bins = signal.shape
    blocks = max((bins - 1) // BLOCK_BINS, 1)
    width = (bins - 1) // blocks
    if width < 2 * DEGREES * (len(motions) + 1) + 2:
        mean = np.mean(power_of(signal[:, 1:]), axis=1, keepdims=True)
        return np.broadcast_to(mean, signal.shape), np.zeros((records, 0))
    place = np.linspace(-1.0, 1.0, width)
    powers = np.stack([np.ones(width), place, 1.5 * place**2 - 0.5])
    inner = slice(1, 1 + blocks * width)
    rows = signal[:, inner].reshape(records, blocks, 1, width)
    leaks = np.broadcast_to(powers.astype(complex), (records, blocks, DEGREES, width))
    rest, _ = _without(rows, leaks)
    columns = [leaks]
    for motion in motions:
        shares = motion[:, inner].reshape(records, blocks, 1, width)
        size = np.sqrt(np.mean(power_of(shares), axis=-1, keepdims=True))
        columns.append(np.divide(shares, size, out=np.zeros_like(shares), where=size > 0) * powers)
    left, taken = _without(rows, np.concatenate(columns, axis=2))
    squares = np.sum(power_of(left), axis=-1)[..., 0]
    freedom = np.maximum(width - taken, 1.0)
    level = squares / freedom
    shared = np.sum(power_of(rest), axis=-1)[..., 0] - squares
    share = np.clip(squares / np.maximum(squares + shared, 1e-300), 0.0, 1.0)
    padded = np.pad(level, ((0, 0), (NEIGHBOURS, NEIGHBOURS)), mode="edge")
    smooth = sum(padded[:, i : i + blocks] for i in range(2 * NEIGHBOURS + 1))
    middles = 1.0 + width * (np.arange(blocks) + 0.5)
    every = np.arange(bins)
    log = np.log(np.maximum(np.asarray(smooth) / (2 * NEIGHBOURS + 1), 1e-300))
    levels = np.stack([np.exp(np.interp(every, middles, own)) for own in log])
    # Of n − m complex numbers, m of them taken: 1 − γ² is Beta(n − m, m) by chance, m = 3.
    less = 1.0 - share
    chance = share**freedom * (1.0 + freedom * less * (1.0 + 0.5 * (freedom + 1.0) * less))
    return levels, np.minimum(chance, 1.0)


def _without(rows: ComplexArray, columns: ComplexArray) -> tuple[ComplexArray, FloatArray]:
    """Return rows (R, B, 1, w) less what columns (R, B, m, w) explain, and the number of these."""
    adjoint = np.conj(columns).swapaxes(-1, -2)
    gram = columns @ adjoint
    values, vectors = np.linalg.eigh(gram)
    shown = values > 1e-10 * np.max(values, axis=-1, keepdims=True)
    inverse = np.where(shown, 1.0 / np.where(shown, values, 1.0), 0.0)
    share = (rows @ adjoint) @ vectors
    share = (share * inverse[..., None, :]) @ vectors.conj().swapaxes(-1, -2)
    return rows - share @ columns, np.sum(shown, axis=-1).astype(float)
