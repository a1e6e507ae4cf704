"""Sampling: from times, of a file's own statement, of the calibration file; do they agree; from seconds to samples."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.io.columns import Clock, ColumnFile, Start
from vibrident.data.io.header_units import header, is_time, seconds_per_unit, states_a_time_unit
from vibrident.data.records import FloatArray

# In sampling intervals: a time further from its place interrupts the record; a cut this close to a sample is at it.
_TOLERANCE_SAMPLES, _ROUNDING_SAMPLES = 0.5, 1e-6
SAME_RATE = 1e-9  # rates closer than this, relatively, are the same
CLOCK_TOLERANCE = (
    2e-4  # largest relative difference of two clocks of a record: a computer's is right to 0.01 %
)
_FEWEST_TIMES = 8
_RATIOS_OF_UNITS = (1.0, 1e-3, 1e-6, 1e-9, 1e3, 1 / 60, 1 / 3600, 60.0, 3600.0)
#: Channels may begin this far apart, in sampling intervals; 1 % is a phase error of 0.7° at a fifth of the rate.
_SAME_START = 0.01


@dataclass(frozen=True)
class Sampling:
    """Sampling rate, in samples per second, and time of the first sample on the file's clock, in s."""

    rate_hz: float
    start_time_s: float
    note: str = ""  # for the history, about the rate's origin


def sampling_from_times(times_s: FloatArray, locate: Callable[[int], str]) -> Sampling:
    """Return the rate by linear regression over all times: rounding of single time stamps averages out.

    ``times_s``: shape (samples,), finite; ``locate``: description of a time's place, by its index. InputError where
    times do not increase, a gap exceeds half an interval, or they leave a straight line.
    """
    if times_s.size < 2:
        raise _uneven("A time column needs two rows or more.", f"{times_s.size} times", locate(0))
    elapsed = times_s - times_s[0]  # subtracted first, to keep the digits of epoch seconds
    steps = np.diff(elapsed)
    if (back := np.flatnonzero(steps <= 0)).size:
        at = int(back[0]) + 1
        found = f"{float(times_s[at])!r} s after {float(times_s[at - 1])!r} s"
        raise _uneven("The times do not increase.", found, locate(at))
    interval = float(
        np.partition(steps, steps.size // 2)[steps.size // 2]
    )  # np.median loads more of NumPy
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


def cut(
    samples: int, rate_hz: float, start_s: float | None, stop_s: float | None, where: str
) -> slice:
    """Return the samples with start_s ≤ t < stop_s, t from the file's first sample; InputError where none are left.

    A stop beyond the end means the end.
    """
    stated = {"start_s": start_s, "stop_s": stop_s}
    first = 0 if start_s is None else math.ceil(start_s * rate_hz - _ROUNDING_SAMPLES)
    last = (
        samples if stop_s is None else min(samples, math.ceil(stop_s * rate_hz - _ROUNDING_SAMPLES))
    )
    if first >= last:
        raise InputError(
            "The part of the record is empty.",
            expected=f"start_s and stop_s within 0 to {samples / rate_hz:.6g} s, counted from the first sample",
            found=", ".join(
                f"{key} = {value:g}" for key, value in stated.items() if value is not None
            ),
            where=where,
            remedy="correct start_s and stop_s",
        )
    return slice(first, last)


def plainest_clock(interval_s: float, half_unit_s: float, start: Start | None = None) -> Clock:
    """Return the clock of a file with a rounded sampling interval: the rate with the fewest digits that agrees.

    9.76562e-06 s in a file means some rate from 102399.99 to 102400.11 Hz; the plain reciprocal may be wrong by 5e-7.
    Of all numbers within the rounding, the one with the fewest digits is taken, as rate in Hz or interval in s, with
    the rounding. ``half_unit_s``: half a unit of the interval's last place. ValueError for one that is not above 0.
    """
    if not (math.isfinite(interval_s) and interval_s > 0):
        raise ValueError(f"a sampling interval of {interval_s!r} s")

    def possible(candidate_s: float) -> bool:
        return abs(candidate_s - interval_s) <= half_unit_s * (
            1 + 1e-9
        )  # 9.765625e-06 lies on the edge

    rate, digits = _plainest(1.0 / interval_s, lambda candidate_hz: possible(1.0 / candidate_hz))
    interval, digits_of_interval = _plainest(interval_s, possible)
    rounding = 2 * half_unit_s / interval_s  # full width
    return Clock(
        1.0 / interval if digits_of_interval < digits else rate, max(rounding, SAME_RATE), start
    )


def clock_from_times(times_s: FloatArray, locate: Callable[[int], str]) -> Clock | None:
    """Return the clock of samples with times: the rate by regression; None for fewer than two samples.

    Its rounding is a bound: rounded times change the slope by at most three largest deviations over the length.
    Arguments and errors as :func:`sampling_from_times`.
    """
    if times_s.size < 2:
        return None
    rate_hz = sampling_from_times(times_s, locate).rate_hz
    deviation = times_s - times_s[0] - np.arange(times_s.size) / rate_hz
    worst_s = float(np.max(np.abs(deviation - deviation.mean())))
    return Clock(
        rate_hz,
        max(3 * worst_s * rate_hz / times_s.size, SAME_RATE),
        Start.on_own_clock(float(times_s[0])),
    )


def contradicting_rate(source: ColumnFile, used: Sequence[int], rate_hz: float) -> float | None:
    """Return the rate of the file's time column if it contradicts the rate in use; else None.

    It needs one evenly spaced time column, not ``used``, that is not a counter. If its name states no unit, a ratio
    between units of time is not a contradiction.
    """
    names = [header(source, position) for position in range(len(source.names))]
    found = [
        position for position, name in enumerate(names) if is_time(name) and position not in used
    ]
    if len(found) != 1:
        return None
    try:
        (times,) = source.load(found)
        if not np.all(np.isfinite(times)) or times.size < _FEWEST_TIMES:
            return None
        clock = clock_from_times(times - times[0], lambda row: source.locate(found[0], row))
        seconds = seconds_per_unit(source, found[0])
    except InputError:  # text, or uneven
        return None
    stated = states_a_time_unit(names[found[0]]) or source.in_seconds(found[0])
    if clock is None or (not stated and np.all(np.diff(times) == 1.0)):
        return None
    own_hz = clock.rate_hz / seconds
    same = [1.0] if stated else _RATIOS_OF_UNITS
    allowed = CLOCK_TOLERANCE + 2 * clock.rate_rounding
    return None if any(abs(own_hz / rate_hz * ratio - 1.0) < allowed for ratio in same) else own_hz


def _plainest(value: float, possible: Callable[[float], bool]) -> tuple[float, int]:
    """Return the possible number with the fewest significant digits, and their count."""
    for digits in range(1, 17):
        candidate = float(f"{value:.{digits - 1}e}")
        if possible(candidate):
            return candidate, digits
    return value, 17


def agreed_rate(
    stated_hz: float | None, channels: Sequence[tuple[ColumnFile, int]], where: str, file: str
) -> Clock | None:
    """Return the rate that the calibration file and the channels' files agree on; None if none is stated.

    Each may differ by its own rounding; the least rounded one is taken; InputError where two contradict each other.
    ``channels``: file and position of each; ``where``, ``file``: the entry and the record's file, for messages.
    """
    agreed = None if stated_hz is None else Clock(stated_hz, SAME_RATE)
    whose = "the calibration file"
    for source, position in channels:
        clock = source.clock(position)
        if clock is None:
            continue
        finer, coarser = sorted((agreed or clock, clock), key=lambda one: one.rate_rounding)
        if agreed is not None and not math.isclose(
            finer.rate_hz, coarser.rate_hz, rel_tol=coarser.rate_rounding
        ):
            raise InputError(
                "The sampling rate contradicts the file.",
                expected=f"{clock.rate_hz!r} samples per second, as {source.file} states",
                found=f"{agreed.rate_hz!r} in {whose}",
                where=f"{where}, for {file}",
                remedy="remove or correct rate_hz"
                if stated_hz is not None
                else "give both channels over the same samples",
            )
        if finer is clock:
            whose = source.file
        agreed = finer
    return agreed


def require_same_start(first: tuple[ColumnFile, int], second: tuple[ColumnFile, int]) -> None:
    """Refuse two channels that begin more than a hundredth of a sampling interval apart: their phase would be wrong."""
    (one, at_one), (other, at_other) = first, second
    clock, other_clock = one.clock(at_one), other.clock(at_other)
    if type(one) is not type(other) or clock is None or other_clock is None:
        return
    if (
        clock.start is None
        or other_clock.start is None
        or clock.start.epoch != other_clock.start.epoch
    ):
        return
    apart_s = (other_clock.start.ns - clock.start.ns) * 1e-9
    if abs(apart_s) * clock.rate_hz > _SAME_START:
        raise InputError(
            "The channels do not begin at the same time.",
            expected=f"{other.names[at_other]!r} to begin with {one.names[at_one]!r}",
            found=f"{apart_s:+.9g} s, or {apart_s * clock.rate_hz:+.3g} samples",
            where=other.file,
            remedy="export both channels over the same samples",
        )
