"""Component of residuals that is locally incoherent with the motion, where that is heard."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.noise.averages import level_around, log_power
from vibrident.fit.noise.projection import BLOCK_BINS, RIDGE, without_common
from vibrident.fit.noise.residuals import Residuals
from vibrident.fit.noise.surroundings import MIN_FREEDOM
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import power_of

#: A bin holds motion where the power of the measured response is so many times the noise.
HEARD_RATIO = 10.0
#: So many bins of a block that are heard only once a misfit is removed are no chance.
MAX_NEWLY_HEARD = 6


class Incoherent(NamedTuple):
    """Component of a residual that is locally incoherent with the motion.

    Attributes:
        noise: the component, shape (R, K).
        power: of it, shape (R, K).
        freedom: degrees of freedom behind each power, 0 … 1, shape (R, K).
    """

    noise: ComplexArray
    power: FloatArray
    freedom: FloatArray


def incoherent_component(rows: Residuals, log_through: FloatArray | None) -> Incoherent:
    """Return the component of the residual that is locally incoherent with the motion.

    The level by which motion is heard is that of the noise, as of the response or as of the
    reference behind the sensor, whichever is more: beside a resonance noise of the reference falls
    steeply, and its level there is far above a mean over the bins around. That level also whitens
    the noise of each block, which is steep in the lowest. Of a residual that is mostly misfit it is
    too high at first, so records in which more is heard once the misfit is removed are estimated
    again.
    """
    if rows.reference is None:
        motions = [rows.predicted]
        measured = power_of(rows.predicted)
    else:
        motions = [rows.reference, rows.predicted if rows.passed is None else rows.passed]
        measured = power_of(rows.predicted + rows.residual)
    measured[:, 0] = 0.0
    steep: FloatArray | float = 0.0
    if log_through is not None:
        steep = np.maximum(log_through - level_around(log_through), 0.0)

    def threshold(power: FloatArray) -> FloatArray:
        level = level_around(log_power(power))
        level += steep
        level += np.euler_gamma
        return np.exp(level, out=level)

    def projected(
        records: slice | NDArray[np.int_], heard: BoolArray, level: FloatArray
    ) -> Incoherent:
        noise, freedom = without_common(
            rows.residual[records],
            [motion[records] for motion in motions],
            np.sqrt(level),
            heard,
            None if rows.free_motion is None else rows.free_motion[records],
        )
        if rows.unfitted is not None:
            freedom *= rows.unfitted[records]
        return Incoherent(noise, power_of(noise), freedom)

    level = threshold(power_of(rows.residual))
    if rows.heard is not None:
        return projected(slice(None), rows.heard, level)
    heard = measured > HEARD_RATIO * level
    incoherent = projected(slice(None), heard, level)
    # Where no freedom remains, only rounding does: less than the ridge.
    power = np.maximum(incoherent.power, RIDGE * power_of(rows.residual))
    level = threshold(power / np.maximum(incoherent.freedom, MIN_FREEDOM))
    heard_now = measured > HEARD_RATIO * level
    blocks = np.arange(1, level.shape[1], BLOCK_BINS)
    newly_heard = np.add.reduceat(heard_now & ~heard, blocks, axis=1)
    repeated = np.flatnonzero(np.any(newly_heard >= MAX_NEWLY_HEARD, axis=1))
    if repeated.size:
        second = projected(repeated, heard_now[repeated], level[repeated])
        for array, rows_again in zip(incoherent, second, strict=True):
            array[repeated] = rows_again
    return incoherent
