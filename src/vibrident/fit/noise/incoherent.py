"""Component of residuals that is locally incoherent with the motion, where that is heard."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.noise.averages import level_around, log_power
from vibrident.fit.noise.projection import RIDGE, without_common
from vibrident.fit.noise.residuals import Residuals
from vibrident.fit.noise.surroundings import MIN_FREEDOM
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import power_of

#: A bin holds motion where the power of the measured response is so many times the noise.
HEARD_RATIO = 10.0
#: Most estimates again: each lowers the level by what a misfit added to it.
MAX_REPEATS = 4


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
    too high at first, so records in which a bin that is heard only once the misfit is removed holds
    more than noise are estimated again.
    """
    if rows.reference is None:
        motions = [rows.predicted]
        measured = power_of(rows.predicted)
    else:
        motions = [rows.reference, rows.predicted if rows.passed is None else rows.passed]
        measured = power_of(rows.predicted + rows.residual)
    measured[:, 0] = 0.0
    steep = np.zeros((1, 1))
    if log_through is not None:
        steep = np.maximum(log_through - level_around(log_through), 0.0)
    steep = np.broadcast_to(steep, measured.shape)

    def threshold(power: FloatArray, records: slice | NDArray[np.int_]) -> FloatArray:
        level = level_around(log_power(power))
        level += steep[records]
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

    residual_power = power_of(rows.residual)
    level = threshold(residual_power, slice(None))
    if rows.heard is not None:
        return projected(slice(None), rows.heard, level)
    heard = measured > HEARD_RATIO * level
    incoherent = projected(slice(None), heard, level)
    repeated = np.arange(len(heard))
    for _ in range(MAX_REPEATS):
        # Where no freedom remains, only rounding does: less than the ridge.
        power = np.maximum(incoherent.power[repeated], RIDGE * residual_power[repeated])
        level = threshold(power / np.maximum(incoherent.freedom[repeated], MIN_FREEDOM), repeated)
        heard_now = measured[repeated] > HEARD_RATIO * level
        holds_misfit = heard_now & ~heard[repeated] & (power > HEARD_RATIO * level)
        again = np.any(holds_misfit, axis=1)
        if not again.any():
            break
        repeated = repeated[again]
        heard[repeated] = heard_now[again]
        next_component = projected(repeated, heard[repeated], level[again])
        for array, rows_again in zip(incoherent, next_component, strict=True):
            array[repeated] = rows_again
    return incoherent
