"""What of a residual is locally incoherent with the prediction: the noise, without a misfit of the model.

In each block of bins a quadratic in frequency times the predicted response is projected out of the residual (local
polynomial method: Pintelon & Schoukens 2012, ch. 7). A misfit of the model is smooth over a block and coherent, so that
it does not raise the noise that it is judged by.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.bins import BinsAt
from vibrident.fit.noise.motion import Motion, lines_around, typical
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import in_blocks, power_of

#: Bins of a block.
BLOCK = 24
#: A bin holds motion where the prediction's power is so many times the noise.
HEARD = 10.0
#: Rounds in which it is seen which do.
ROUNDS = 2
#: Blocks that are worked on at once.
AT_ONCE = 512
#: Ridge of the projection, relative: a limit of the arithmetic.
RIDGE = 1e-11
#: Polynomials of a block: 1, k and k².
DEGREES = 3


def incoherent(residual: ComplexArray, motion: Motion) -> ComplexArray:
    """Return the incoherent part of a residual, scaled to the same noise, shape (bins,).

    Args:
        residual: measured less predicted response, shape (bins,).
        motion: the prediction, and the reference where it is known: a wrong model's residual is
            coherent with that, not with the prediction, and must not count as noise.
    """
    if motion.heard is not None:
        return without_coherent(residual, _motions(motion), motion.heard)
    measured = np.empty(residual.size)
    around = lines_around(residual)
    for part in in_blocks(residual.size):  # of a long record each copy counts
        moved = motion.predicted(part)
        measured[part] = power_of(moved if motion.reference is None else moved + residual[part])
    measured[0] = 0.0
    noise = residual
    for _ in range(ROUNDS):
        level = _level(power_of(noise), motion.through, around)
        level *= HEARD
        heard = measured > level
        del noise, level
        noise = without_coherent(residual, _motions(motion), heard)
    return noise


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


def _motions(motion: Motion) -> list[BinsAt]:
    """Return what a residual must have nothing in common with: the prediction, the reference."""
    if motion.reference is None:
        return [motion.predicted]
    return [motion.reference.__getitem__]


def without_coherent(
    residual: ComplexArray, motions: Sequence[BinsAt], heard: BoolArray
) -> ComplexArray:
    """Return the residual less what is coherent with motions where heard, shape (bins,)."""
    blocks = max((residual.size - 1) // BLOCK, 1)
    width = (residual.size - 1) // blocks
    rest = residual.copy()
    degrees = DEGREES * len(motions)
    if width < 2 * degrees:
        return rest
    powers = np.linspace(-1.0, 1.0, width) ** np.arange(DEGREES)[:, None]
    for begin in range(0, blocks, AT_ONCE):
        count = min(AT_ONCE, blocks - begin)
        part = slice(1 + begin * width, 1 + (begin + count) * width)
        shares = [_unit(motion(part) * heard[part], count)[:, None] * powers for motion in motions]
        columns = np.concatenate(shares, axis=1)
        adjoint = np.conj(columns).swapaxes(1, 2)
        gram = columns @ adjoint
        ridged = gram + RIDGE * np.eye(degrees)
        rows = residual[part].reshape(count, 1, width)
        inverse = np.linalg.inv(ridged)
        taken = np.trace(gram @ inverse, axis1=1, axis2=2).real
        left = rows - (rows @ adjoint) @ inverse @ columns
        rest[part] = (left[:, 0] * np.sqrt(width / (width - taken))[:, None]).ravel()
    return rest


def _unit(moved: ComplexArray, blocks: int) -> ComplexArray:
    """Return motion in blocks, each of the power one a bin or zero, shape (blocks, width)."""
    shares = moved.reshape(blocks, -1)
    size = np.sqrt(np.sum(power_of(shares), axis=1, keepdims=True))
    return np.divide(shares, size, out=np.zeros_like(shares), where=size > 0.0)
