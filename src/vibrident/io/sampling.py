"""From times to a sampling rate, and from seconds to samples."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vibrident.errors import InputError
from vibrident.records import FloatArray

#: Largest deviation of a time from its place, in sampling intervals; beyond, the record is interrupted.
_TOLERANCE_SAMPLES = 0.5
#: A cut this close to a sample, in sampling intervals, is at that sample; decimal fractions are not exact.
_ROUNDING_SAMPLES = 1e-6


@dataclass(frozen=True)
class Sampling:
    """Sampling rate, in samples per second, and time of the first sample on the file's clock, in s.

    Attributes:
        note: for the history, about the rate's origin.
    """

    rate_hz: float
    start_time_s: float
    note: str = ""


def sampling_from_times(times_s: FloatArray, locate: Callable[[int], str]) -> Sampling:
    """Return the rate by linear regression over all times: rounding of single time stamps averages out.

    Args:
        times_s: shape (samples,), finite, s.
        locate: description of a time's place, by its index.

    Raises:
        InputError: times do not increase, a gap exceeds half an interval, or the times leave a straight line.
    """
    if times_s.size < 2:
        raise _uneven("A time column needs two rows or more.", f"{times_s.size} times", locate(0))
    elapsed = times_s - times_s[0]  # subtracted first, to keep the digits of epoch seconds
    steps = np.diff(elapsed)
    if (back := np.flatnonzero(steps <= 0)).size:
        at = int(back[0]) + 1
        found = f"{float(times_s[at])!r} s after {float(times_s[at - 1])!r} s"
        raise _uneven("The times do not increase.", found, locate(at))
    interval = float(np.partition(steps, steps.size // 2)[steps.size // 2])  # np.median loads more of NumPy
    if (gaps := np.flatnonzero(np.abs(steps - interval) > _TOLERANCE_SAMPLES * interval)).size:
        at = int(gaps[0]) + 1
        found = f"a step of {steps[at - 1]:.9g} s where the others are {interval:.9g} s"
        raise _uneven("The record has a gap.", found, locate(at))
    index = np.arange(elapsed.size, dtype=np.float64)
    centred = index - index.mean()
    interval = float(centred @ elapsed / (centred @ centred))
    residual = elapsed - elapsed.mean() - interval * centred
    worst = int(np.argmax(np.abs(residual)))
    if abs(residual[worst]) > _TOLERANCE_SAMPLES * interval:
        found = f"a time {residual[worst] / interval:.3g} intervals away from even spacing"
        raise _uneven("The sampling rate drifts.", found, locate(worst))
    return Sampling(1.0 / interval, float(times_s[0]))


def _uneven(problem: str, found: str, where: str) -> InputError:
    return InputError(
        problem,
        expected="increasing times in seconds, equally spaced within half an interval",
        found=found,
        where=where,
        remedy="cut the file there, resample it, or give rate_hz if only the time stamps are wrong",
    )


def cut(samples: int, rate_hz: float, start_s: float | None, stop_s: float | None, where: str) -> slice:
    """Return the samples with start_s ≤ t < stop_s, t counted from the file's first sample.

    A stop beyond the end means the end.

    Raises:
        InputError: nothing is left.
    """
    stated = {"start_s": start_s, "stop_s": stop_s}
    first = 0 if start_s is None else math.ceil(start_s * rate_hz - _ROUNDING_SAMPLES)
    last = samples if stop_s is None else min(samples, math.ceil(stop_s * rate_hz - _ROUNDING_SAMPLES))
    if first >= last:
        raise InputError(
            "The part of the record is empty.",
            expected=f"start_s and stop_s within 0 to {samples / rate_hz:.6g} s, counted from the first sample",
            found=", ".join(f"{key} = {value:g}" for key, value in stated.items() if value is not None),
            where=where,
            remedy="correct start_s and stop_s",
        )
    return slice(first, last)
