"""What a converter's steps do to a record.

Rounding to steps q moves a sample by up to q/2. While the signal runs over many steps this is white noise of variance
q²/12 and shows in the residual. In a record that is nearly still it is no noise: sample after sample is rounded the
same way, slow tails are lost, and the residual looks quieter than the data are (Widrow & Kollár 2008). So no residual
of a rounded channel is taken to be below q²/12.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.data.records.basis import distinct
from vibrident.data.screening.steps import converter_step

#: Noise of so many steps turns rounding errors into white noise.
DITHERED = 0.6
#: Number of sizes of a motion within one step, at which its rounding errors are looked at.
TRIALS = 6
#: Fewest different values; fewer may lie on a grid by chance.
FEWEST = 3
#: A motion in step with the sampling shows so few values …
FEW = 64
#: The values of a motion in step with the sampling return at least so often.
REPEATS = 8
#: Samples of the longest period in which it returns.
LONGEST_PERIOD = 4096
#: A sine is in step if it moves no sample by this part of a step over the record.
DRIFTED = 0.5


def repeated_errors(values: FloatArray, used: BoolArray, turns: float) -> tuple[int, float]:
    """Number of different rounding errors of a sine in step with the sampling, and the step; zeros for others.

    A few samples a period, always at the same phases, are rounded in the same way from period to period: as many
    errors are left as there are distances from the mean, and no longer record has a smaller one.

    Args:
        values: a channel, shape (samples,).
        used: samples that count, shape (samples,).
        turns: of the sine from sample to sample.
    """
    period = np.arange(1, min(LONGEST_PERIOD, max(values.size // REPEATS, 1)) + 1)
    drift = np.abs(period * turns - np.rint(period * turns)) * values.size / period
    if np.min(drift) > 1.0 or np.count_nonzero(used) < REPEATS * FEWEST:
        return 0, 0.0
    seen = values[used]
    span = float(np.ptp(seen))
    if span == 0.0:
        return 0, 0.0
    step = converter_step(values, used)
    period = period[np.pi * span * drift < DRIFTED * step]
    if step == 0.0 or not period.size:
        return 0, 0.0
    whole = int(period[0])
    number = whole if whole % 2 else max(whole // 2, 1)  # the halves of a period are rounded alike
    if whole > FEW:
        return number, step
    levels = distinct(np.rint(np.abs(seen - np.mean(seen)) / (0.5 * step)))
    return min(
        1 + int(np.sum(np.diff(levels) > 1.5)), number
    ), step  # noise may reach the neighbouring code


def undithered(step: float, residual_variance: float) -> float:
    """Part of the variance of rounding errors that noise leaves coherent with the motion (Widrow & Kollár 2008).

    Args:
        step: of the converter.
        residual_variance: noise and rounding errors together.
    """
    noise = max(residual_variance - step**2 / 12.0, 0.0)
    return float(np.exp(-((2.0 * np.pi) ** 2) * noise / step**2))


def returning_error(
    values: FloatArray, used: BoolArray, turns: float, residual: FloatArray
) -> float:
    """Variance of the real part of a sine's amplitude by rounding errors that return each period.

    Args:
        values: a channel, as it was measured, shape (samples,).
        used: samples that count, shape (samples,).
        turns: of the sine from sample to sample.
        residual: of the channel where it counts; noise makes the errors of the steps noise.
    """
    number, step = repeated_errors(values, used, turns)
    return step**2 / (6.0 * number) * undithered(step, float(residual.var())) if number else 0.0


def rounding_variance(record: Record, gain_squares: Callable[[], FloatArray]) -> FloatArray | None:
    """Variance a sample that rounding makes in measured less predicted response; None if the channel has no steps.

    Args:
        record: with a reference or without.
        gain_squares: returns |H|² of the model at the spectral lines, shape (lines,).

    Returns:
        Shape (lines,), squares of the response unit.
    """
    own = converter_step(record.response, record.mask)
    other = (
        0.0 if record.reference is None else converter_step(record.reference, record.reference_mask)
    )
    return None if own == other == 0.0 else (own**2 + other**2 * gain_squares()) / 12.0


def rounding_errors(values: FloatArray, used: BoolArray, step: float, origin: float) -> FloatArray:
    """Rounded less true values, at TRIALS sizes of the motion within one step of its peak, shape (TRIALS, samples).

    Args:
        values: a channel without its rounding, shape (samples,).
        used: samples that count; the others, and the mean, are zero, shape (samples,).
        step: of the converter.
        origin: a value that the converter gives.
    """
    mean = float(np.mean(values[used]))
    motion = np.where(used, values - mean, 0.0)
    peak = max(float(np.max(np.abs(motion))), step)
    factor = 1.0 + ((np.arange(TRIALS) + 0.5) / TRIALS - 0.5) * step / peak
    sized = factor[:, None] * motion + (mean - origin)
    errors = step * np.rint(sized / step) - sized
    return np.where(used, errors - np.mean(errors[:, used], axis=1, keepdims=True), 0.0)
