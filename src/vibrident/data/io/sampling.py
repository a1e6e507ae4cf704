"""Turn seconds into samples, and what is stated of a rate into one clock."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from vibrident.base.errors import InputError
from vibrident.data.io.columns import Clock, StartTime

#: Sampling intervals within which two instants are the same: limit of the arithmetic.
ROUNDING_SAMPLES = 1e-6
SAME_RATE = 1e-9  # rates closer than this, relatively, are the same


def first_sample_at(time_s: float, rate_hz: float) -> int:
    """Return the first sample at or after a time, counted like the time from the begin."""
    return math.ceil(time_s * rate_hz - ROUNDING_SAMPLES)


def cut(
    samples: int, rate_hz: float, start_s: float | None, stop_s: float | None, where: str
) -> slice:
    """Return the samples with start_s ≤ t < stop_s, t from the file's first sample.

    A stop beyond the end means the end.

    Raises:
        InputError: no sample remains.
    """
    limits = {"start_s": start_s, "stop_s": stop_s}
    first = 0 if start_s is None else first_sample_at(start_s, rate_hz)
    last = samples if stop_s is None else min(samples, first_sample_at(stop_s, rate_hz))
    if first >= last:
        raise InputError(
            "The part of the record is empty.",
            expected=f"start_s and stop_s within 0 to {samples / rate_hz:.6g} s, counted from the "
            "first sample",
            found=", ".join(
                f"{key} = {value:g}" for key, value in limits.items() if value is not None
            ),
            where=where,
            remedy="correct start_s and stop_s",
        )
    return slice(first, last)


def agreed_clock(
    statements: Sequence[tuple[str, Clock | None]],
    where: str,
    problem: str = "The sampling rate contradicts the file.",
    remedy: str = "remove or correct rate_hz; of wrong time stamps, remove the column",
) -> Clock | None:
    """Return the clock that all statements agree on, each within its own rounding; None if none.

    The rate is that of the first statement unless a later one refines it. The start is that of the
    last which has one: time stamps say more than a header.

    Args:
        statements: whose, and the clock or None.
        where: entry of the calibration file and file, for messages.
        problem: of two that contradict each other, for messages.
        remedy: the same.

    Raises:
        InputError: two statements contradict each other.
    """
    agreed: Clock | None = None
    whose = ""
    for name, clock in statements:
        if clock is None:
            continue
        if agreed is None:
            agreed = clock
            whose = name
            continue
        apart = abs(clock.rate_hz / agreed.rate_hz - 1.0)
        if apart > clock.rate_rounding + agreed.rate_rounding:
            raise InputError(
                problem,
                expected=f"{_rounded_rate(clock.rate_hz)!r} samples per second, as {name} states",
                found=f"{_rounded_rate(agreed.rate_hz)!r} in {whose}",
                where=where,
                remedy=remedy,
            )
        start = clock.start or agreed.start
        if apart > clock.rate_rounding:  # the later one refutes the earlier one's last digits
            agreed = clock
            whose = name
        agreed = replace(agreed, start=start)
    return agreed


def _rounded_rate(rate_hz: float) -> float:
    """Return a rate without the last digits of a regression."""
    return float(f"{rate_hz:.12g}")


def plainest_clock(interval_s: float, half_unit_s: float, start: StartTime | None = None) -> Clock:
    """Return the clock of a file that rounds its interval: the rate of fewest digits that agrees.

    9.76562e-06 s in a file means some rate from 102399.99 to 102400.11 Hz; the plain reciprocal may
    be wrong by 5e-7. Of all numbers within the rounding, the one with the fewest digits is taken,
    as rate in Hz or interval in s, with the rounding. ``half_unit_s``: half a unit of the
    interval's last place.

    Raises:
        ValueError: the interval is not above 0.
    """
    if not (math.isfinite(interval_s) and interval_s > 0):
        raise ValueError(f"a sampling interval of {interval_s!r} s")

    def possible(candidate_s: float) -> bool:
        # 9.765625e-06 lies on the edge
        return abs(candidate_s - interval_s) <= half_unit_s * (1 + 1e-9)

    rate, digits = _plainest(1.0 / interval_s, lambda candidate_hz: possible(1.0 / candidate_hz))
    interval, digits_of_interval = _plainest(interval_s, possible)
    rounding = 2 * half_unit_s / interval_s  # full width
    return Clock(
        1.0 / interval if digits_of_interval < digits else rate, max(rounding, SAME_RATE), start
    )


def _plainest(value: float, possible: Callable[[float], bool]) -> tuple[float, int]:
    """Return the possible number with the fewest significant digits, and their count."""
    for digits in range(1, 17):
        candidate = float(f"{value:.{digits - 1}e}")
        if possible(candidate):
            return candidate, digits
    return value, 17
