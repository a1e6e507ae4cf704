"""What a converter's steps do to a record.

Rounding to steps q moves a sample by up to q/2. While the signal runs over many steps this is white noise of variance
q²/12 and shows in the residual. In a record that is nearly still it is no noise: sample after sample is rounded the
same way, slow tails are lost, and the residual looks quieter than the data are (Widrow & Kollár 2008). So no residual
of a rounded channel is taken to be below q²/12.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vibrident.records import BoolArray, FloatArray, Record

#: Noise of so many steps turns rounding errors into white noise.
DITHERED = 0.6
#: Number of sizes of a motion within one step, at which its rounding errors are looked at.
TRIALS = 6
#: Samples looked at.
SOME = 20_000
#: Values closer than this part of the range are equal.
SAME = 1e-12
#: All values lie on the grid to this part of a step.
ON_GRID = 0.05
#: Fewest different values; fewer may lie on a grid by chance.
FEWEST = 3
#: So many values tell mostly that there is no grid.
FIRST = 32
#: Largest number of steps in the smallest difference of two values.
STEPS_APART = 4


def converter_step(values: FloatArray, valid: BoolArray | None = None) -> float:
    """The converter's step, where values lie on a grid; else zero.

    Args:
        values: one channel, shape (samples,).
        valid: samples to look at, shape (samples,); None: all.
    """
    every = slice(None, None, max(1, values.size // SOME))
    seen = values[every] if valid is None else values[every][valid[every]]
    some = np.unique(seen)
    if some.size < FEWEST:
        return 0.0
    gaps = np.diff(some)
    least = float(np.min(gaps[gaps > SAME * (some[-1] - some[0])]))
    few = some[:: max(1, some.size // FIRST)]
    for parts in range(1, STEPS_APART + 1):
        if all(_on_grid(values, some[0], parts / least) for values in (few, some)):
            return least / parts
    return 0.0


def _on_grid(values: FloatArray, origin: float, rate: float) -> bool:
    place = (values - origin) * rate
    return float(np.max(np.abs(place - np.rint(place)))) < ON_GRID


def rounding_variance(record: Record, gain_squares: Callable[[], FloatArray]) -> FloatArray | None:
    """Variance a sample that rounding makes in measured less predicted response; None if the channel has no steps.

    Args:
        record: with a reference or without.
        gain_squares: returns |H|² of the model at the spectral lines, shape (lines,).

    Returns:
        Shape (lines,), squares of the response unit.
    """
    own = converter_step(record.response, record.mask)
    other = 0.0 if record.reference is None else converter_step(record.reference, record.reference_mask)
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
