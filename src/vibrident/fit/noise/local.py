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
from numpy.lib.stride_tricks import sliding_window_view

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.information import regular_inverse
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import power_of

#: Bins of a block.
BLOCK_BINS = 24
#: Degrees of a polynomial in a block, and one: a quadratic.
DEGREES = 3
#: Directions of which columns hold less than this part of the best explain nothing.
SHOWN = 1e-10
#: Chance that any block without motion counts as one with motion.
FALSE_BLOCK = 1e-3
#: Blocks on either side that a level is averaged over.
NEIGHBOURS = 2


def incoherent_level(signal: ComplexArray, motions: Sequence[ComplexArray]) -> tuple[FloatArray, BoolArray]:
    """Return the power of what has locally nothing in common with motions, and of the signal.

    Args:
        signal: shape (R, K); bin 0 is left out.
        motions: each of shape (R, K).

    Returns:
        Level of each bin, shape (R, K), smooth over five blocks; and whether each of B blocks has
        more in common with the motions than noise alone would, shape (R, B).
    """
    records, bins = signal.shape
    blocks = max((bins - 1) // BLOCK_BINS, 1)
    width = (bins - 1) // blocks
    if width < 2 * DEGREES * (len(motions) + 1) + 2:
        mean = np.mean(power_of(signal[:, 1:]), axis=1, keepdims=True)
        return np.broadcast_to(mean, signal.shape), np.zeros((records, 0), dtype=bool)
    place = np.linspace(-1.0, 1.0, width)
    powers = np.stack([np.ones(width), place, 1.5 * place**2 - 0.5])
    inner = slice(1, 1 + blocks * width)
    rows = signal[:, inner].reshape(records, blocks, 1, width)
    leaks = np.broadcast_to(powers.astype(complex), (records, blocks, DEGREES, width))
    own, _ = np.linalg.qr(powers.T)
    rest = rows - (rows @ own) @ own.T
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
    # Of n − m complex numbers, m of them taken: 1 − γ² is Beta(n − m, m) by chance, m = 3.
    less = 1.0 - share
    chance = share**freedom * (1.0 + freedom * less * (1.0 + 0.5 * (freedom + 1.0) * less))
    # Where there is no motion the response lacks the noise of the reference: a level of its own.
    moving = chance * chance.size < FALSE_BLOCK
    log = np.log(np.maximum(_among(level, moving), 1e-300))
    middles = 1.0 + width * (np.arange(blocks) + 0.5)
    every = np.arange(bins)
    levels = np.stack([np.exp(np.interp(every, middles, own)) for own in log])
    return levels, moving


def _among(level: FloatArray, moving: BoolArray) -> FloatArray:
    """Return the mean of each block and those around that are alike in ``moving``, shape (R, B)."""
    smooth = np.zeros_like(level)
    for alike in (moving, ~moving):
        padded = np.zeros((2, len(level), level.shape[1] + 2 * NEIGHBOURS))
        padded[:, :, NEIGHBOURS:-NEIGHBOURS] = level * alike, alike
        total, number = np.sum(sliding_window_view(padded, level.shape[1], axis=2), axis=2)
        smooth += np.where(alike, total / np.maximum(number, 1.0), 0.0)
    return smooth


def _without(rows: ComplexArray, columns: ComplexArray) -> tuple[ComplexArray, FloatArray]:
    """Return rows (R, B, 1, w) less what columns (R, B, m, w) explain, and the number of these."""
    adjoint = np.conj(columns).swapaxes(-1, -2)
    gram = columns @ adjoint
    size = np.trace(gram, axis1=-2, axis2=-1).real
    inverse, regular = regular_inverse(gram / np.where(size > 0.0, size, 1.0)[..., None, None], SHOWN)
    inverse /= np.where(size > 0.0, size, 1.0)[..., None, None]
    taken = np.full(size.shape, float(columns.shape[-2]))
    if not np.all(regular):
        values, vectors = np.linalg.eigh(gram[~regular])
        shown = values > SHOWN * np.max(values, axis=-1, keepdims=True)
        kept = np.where(shown, 1.0 / np.where(shown, values, 1.0), 0.0)
        inverse[~regular] = (vectors * kept[..., None, :]) @ vectors.conj().swapaxes(-1, -2)
        taken[~regular] = np.sum(shown, axis=-1)
    return rows - ((rows @ adjoint) @ inverse) @ columns, taken
