"""Errors that the steps of a converter make in a record.

Rounding to steps q moves a sample by up to q/2. While the signal runs over many steps this is white
noise of variance q²/12 and shows in the residual. In a record that is nearly still it is no noise:
sample after sample is rounded the same way, slow tails are lost, and the residual looks quieter
than the data are (Widrow & Kollár 2008). So no residual of a rounded channel is taken to be below
q²/12.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.data.records.basis import distinct
from vibrident.data.screening.steps import converter_step

#: Noise of this many steps turns rounding errors into white noise.
DITHERED = 0.6
#: Number of sizes of a motion within one step at which its rounding errors are computed.
TRIALS = 6
#: Fewest different values: fewer may lie on a grid by chance.
MIN_VALUES = 3
#: A motion in step with the sampling shows at most so many values, …
MAX_VALUES = 64
#: … which return at least so often …
MIN_REPEATS = 8
#: … after at most so many samples.
MAX_PERIOD_SAMPLES = 4096
#: A sine is in step if it moves no sample by this fraction of a step over the record.
MAX_DRIFT_STEPS = 0.5


def repeated_errors(values: FloatArray, used: BoolArray, turns: float) -> tuple[int, float]:
    """Return how many different rounding errors a sine in step with the sampling has, and the step.

    A few samples a period, always at the same phases, are rounded in the same way from period to
    period: as many errors remain as there are distances from the mean, however long the record is.

    Args:
        values: a channel, shape (samples,).
        used: samples that count, shape (samples,).
        turns: periods of the sine from sample to sample.

    Returns:
        Zeros for a sine that is not in step.
    """
    period = np.arange(1, min(MAX_PERIOD_SAMPLES, max(values.size // MIN_REPEATS, 1)) + 1)
    drift = np.abs(period * turns - np.rint(period * turns)) * values.size / period
    if np.min(drift) > 1.0 or np.count_nonzero(used) < MIN_REPEATS * MIN_VALUES:
        return 0, 0.0
    used_values = values[used]
    span = float(np.ptp(used_values))
    if span == 0.0:
        return 0, 0.0
    step = converter_step(values, used)
    period = period[np.pi * span * drift < MAX_DRIFT_STEPS * step]
    if step == 0.0 or not period.size:
        return 0, 0.0
    samples_of_period = int(period[0])
    errors = (
        samples_of_period if samples_of_period % 2 else max(samples_of_period // 2, 1)
    )  # the halves of a period are rounded alike
    if samples_of_period > MAX_VALUES:
        return errors, step
    levels = distinct(np.rint(np.abs(used_values - np.mean(used_values)) / (0.5 * step)))
    separate = 1 + int(np.sum(np.diff(levels) > 1.5))  # noise may reach the neighbouring code
    return min(separate, errors), step


def undithered(step: float, residual_variance: float) -> float:
    """Return the fraction of the variance of rounding errors that stays coherent with the motion.

    Noise takes the rest (Widrow & Kollár 2008).

    Args:
        step: of the converter.
        residual_variance: of noise and rounding errors together.
    """
    noise = max(residual_variance - step**2 / 12.0, 0.0)
    return float(np.exp(-((2.0 * np.pi) ** 2) * noise / step**2))


def returning_error(
    values: FloatArray, used: BoolArray, turns: float, residual: FloatArray
) -> float:
    """Return the variance of the real part of a sine's amplitude by errors that return each period.

    Args:
        values: a channel as it was measured, shape (samples,).
        used: samples that count, shape (samples,).
        turns: periods of the sine from sample to sample.
        residual: of the used samples of the channel; noise makes the errors of the steps noise.
    """
    errors, step = repeated_errors(values, used, turns)
    return step**2 / (6.0 * errors) * undithered(step, float(residual.var())) if errors else 0.0


def rounding_variance(record: Record, gain_squares: Callable[[], FloatArray]) -> FloatArray | None:
    """Return the variance that rounding makes in response less prediction, or None without steps.

    Args:
        record: with a reference or without.
        gain_squares: returns |H|² of the model at the spectral lines, shape (lines,).

    Returns:
        Variance of a sample, by line, in squares of the response unit, shape (lines,).
    """
    response_step = converter_step(record.response, record.mask)
    reference_step = (
        0.0 if record.reference is None else converter_step(record.reference, record.reference_mask)
    )
    return (
        None
        if response_step == reference_step == 0.0
        else (response_step**2 + reference_step**2 * gain_squares()) / 12.0
    )


def rounding_errors(values: FloatArray, used: BoolArray, step: float, origin: float) -> FloatArray:
    """Return rounded less true values at TRIALS sizes of the motion, shape (TRIALS, samples).

    The sizes lie within one step of the peak of the motion.

    Args:
        values: a channel without its rounding, shape (samples,).
        used: samples that count, shape (samples,); the errors of the others, and the mean error,
            are zero.
        step: of the converter.
        origin: a value that the converter can give.
    """
    mean = float(np.mean(values[used]))
    motion = np.where(used, values - mean, 0.0)
    peak = max(float(np.max(np.abs(motion))), step)
    factors = 1.0 + ((np.arange(TRIALS) + 0.5) / TRIALS - 0.5) * step / peak
    scaled = factors[:, None] * motion + (mean - origin)
    errors = step * np.rint(scaled / step) - scaled
    return np.where(used, errors - np.mean(errors[:, used], axis=1, keepdims=True), 0.0)
