"""What of a residual is locally incoherent with the prediction: the noise, without a misfit of the model.

In each block of bins a quadratic in frequency times the predicted response is projected out of the residual (local
polynomial method: Pintelon & Schoukens 2012, ch. 7). A misfit of the model is smooth over a block and coherent, so that
it does not raise the noise that it is judged by.
"""

from __future__ import annotations

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.bins import BinsAt
from vibrident.fit.noise.motion import Motion, lines_around, typical
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import in_blocks, power_of

#: Bins of a block, of which three complex functions are projected out.
BLOCK = 24
#: A bin holds motion where the prediction's power is so many times the noise.
HEARD = 10.0
#: Rounds in which it is seen which do.
ROUNDS = 2
#: Blocks that are worked on at once.
AT_ONCE = 512
#: Ridge of the projection, relative: a limit of the arithmetic.
RIDGE = 1e-12
#: Powers of the products of 1, k and k² with each other.
HANKEL = np.add.outer(np.arange(3), np.arange(3))


def incoherent(residual: ComplexArray, motion: Motion) -> ComplexArray:
    """The incoherent part of a residual, scaled to the same noise, shape (bins,).

    Args:
        residual: measured less predicted response, shape (bins,).
        motion: the prediction.
    """
    moved, around = np.empty(residual.size), lines_around(residual)
    for part in in_blocks(residual.size):  # of a long record each copy counts
        moved[part] = power_of(motion.predicted(part))
    moved[0], found = 0.0, residual
    for _ in range(ROUNDS):
        level = _level(power_of(found), motion.through, around)
        level *= HEARD
        heard = moved > level
        del found, level
        found = without_coherent(residual, motion.predicted, heard)
    return found


def _level(power: FloatArray, through: FloatArray | None, around: int) -> FloatArray:
    """Level of noise, as of the response or as of the reference behind the sensor, whichever is more, shape (bins,).

    Beside a resonance noise of the reference falls steeply: what it is there stands far above a mean over the bins
    around, and would count as motion.
    """
    level = typical(power, around)
    if through is None:
        return level
    np.divide(power, through, out=power, where=through > 0.0)  # in place: of a long record each copy counts
    power[0] = power[1]
    by_reference = typical(power, around)
    by_reference *= through
    return np.maximum(level, by_reference, out=level)


def without_coherent(residual: ComplexArray, predicted: BinsAt, heard: BoolArray) -> ComplexArray:
    """The residual less what is coherent in each block with the prediction where it is heard; shape (bins,)."""
    blocks = max((residual.size - 1) // BLOCK, 1)
    width = (residual.size - 1) // blocks
    found = residual.copy()
    if width < 2 * 3:
        return found
    k = np.linspace(-1.0, 1.0, width)
    powers = k ** np.arange(5)[:, None]
    for begin in range(0, blocks, AT_ONCE):
        count = min(AT_ONCE, blocks - begin)
        part = slice(1 + begin * width, 1 + (begin + count) * width)
        motion = (predicted(part) * heard[part]).reshape(count, width)
        rest = residual[part].reshape(count, width)
        power = power_of(motion)
        size = np.sqrt(np.sum(power, axis=1, keepdims=True))
        if not np.any(size):
            continue
        unit = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0.0)
        gram = ((power * unit**2) @ powers.T)[:, HANKEL]  # real: the phase of the prediction drops out
        common = np.conj(motion) * (rest * unit)
        right = np.stack([common.real @ powers[:3].T, common.imag @ powers[:3].T], axis=2)
        ridged = gram + (RIDGE * np.trace(gram, axis1=1, axis2=2) + 1e-300)[:, None, None] * np.eye(3)
        solved = np.linalg.solve(ridged, np.concatenate([right, gram], axis=2))
        taken = np.trace(solved[:, :, 2:], axis1=1, axis2=2)
        share = (solved[:, :, 0] + 1j * solved[:, :, 1]) @ powers[:3]
        left = rest - share * (motion * unit)
        found[part] = (left * np.sqrt(width / (width - taken))[:, None]).ravel()
    return found
