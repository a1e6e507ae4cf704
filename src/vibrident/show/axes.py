"""Scale, limits and ticks of axes, the same in every medium."""

from __future__ import annotations

import datetime
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from vibrident.base.amounts import SUPERSCRIPTS
from vibrident.show.numbers import plain, printed
from vibrident.show.views import Axis, FloatArray

_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)  # steps of a linear axis
_ANGLES = (1.0, 1.5, 3.0, 4.5, 6.0, 9.0, 10.0)  # steps of an axis of angles in degrees


def usable(values: FloatArray, *, positive: bool = False) -> FloatArray:
    """Return the finite values; on request only those above zero."""
    finite = values[np.isfinite(values)]
    return finite[finite > 0] if positive else finite


def frequency(values: FloatArray, label: str = "Frequency in Hz") -> Axis:
    """Return the axis of frequencies, logarithmic where the band is wider than 2:1.

    It writes ``1 k`` for 1000.
    """
    finite = usable(values, positive=True)
    if finite.size == 0:
        return Axis(label, 0.0, 1.0)
    low = float(finite.min())
    high = float(finite.max())
    if high / low < 1.001:
        low = low / math.sqrt(10)
        high = high * math.sqrt(10)
    if high / low <= 2:
        margin = 0.04 * (high - low)
        return _even(label, low - margin, high + margin, thousands=True)
    margin = (high / low) ** 0.03
    return _logarithmic(label, low / margin, high * margin, thousands=True)


def size(
    label: str, values: FloatArray, low: FloatArray | None = None, high: FloatArray | None = None
) -> Axis:
    """Return the axis of positive sizes, logarithmic where they span more than 3:1.

    ``low``, ``high``: ends of bars and bands, in view as far as a factor of two beyond the values.
    """
    finite = usable(values, positive=True)
    if finite.size == 0:
        return Axis(label, 0.0, 1.0)
    smallest = float(finite.min())
    largest = float(finite.max())
    ends = [usable(end) if end is not None else finite for end in (low, high)]
    bottom = max(min(float(ends[0].min(initial=smallest)), smallest), smallest / 2)
    top = min(max(float(ends[1].max(initial=largest)), largest), largest * 2)
    if largest / smallest > 3:
        margin = (top / bottom) ** 0.06
        return _logarithmic(label, bottom / margin, top * margin)
    margin = 0.08 * (top - bottom) or 0.05 * top
    return _even(label, bottom - margin, top + margin)


def about_zero(
    label: str, values: FloatArray, half: FloatArray | None = None, floor: float = 1e-6
) -> Axis:
    """Return the axis of deviations: zero in the middle, bars in view unless they dwarf the values.

    ``half``: half lengths of the bars, NaN for no bar; ``floor``: least half range, so that
    rounding noise does not look like a deviation.
    """
    finite = usable(values)
    reach = float(np.abs(finite).max(initial=0.0))
    longest = usable(
        np.abs(values) + (0.0 if half is None else np.where(np.isfinite(half), half, 0.0))
    )
    if longest.size:
        reach = max(reach, min(float(longest.max()), 4 * reach + 4 * float(np.median(longest))))
    reach = 1.12 * max(reach, floor)
    return _even(label, -reach, reach)


def angle(label: str, values: FloatArray) -> Axis:
    """Return the axis of angles in degrees."""
    finite = usable(values)
    if not finite.size:
        return _even(label, -1.0, 1.0)
    low = float(finite.min())
    high = float(finite.max())
    margin = 0.07 * max(high - low, 1.0)
    steps = _ANGLES if high - low > 40 else _STEPS
    return _even(label, low - margin, high + margin, steps=steps)


def linear(
    label: str,
    values: FloatArray,
    *,
    most: int = 6,
    whole_numbers: bool = False,
    margin: float = 0.05,
    base: bool = False,
) -> Axis:
    """Return a linear axis of any numbers.

    ``most``: ticks; ``whole_numbers``: ticks at whole numbers only; ``margin``: on both sides, of
    the range; ``base``: the axis begins at zero.
    """
    finite = usable(values)
    if finite.size == 0:
        return Axis(label, 0.0, 1.0)
    low = float(finite.min())
    high = float(finite.max())
    room = margin * (high - low) or 0.05 * abs(high) or 1.0
    low = 0.0 if base else low - room
    high = high + room
    return _even(label, low, high, most, whole_numbers=whole_numbers)


def dates(label: str, dates: Sequence[datetime.date]) -> Axis:
    """Build a date axis; values are proleptic ordinals."""
    days = [date.toordinal() for date in dates]
    room = 0.06 * (max(days) - min(days)) or 30.0
    ticks = tuple(
        (float(date.toordinal()), date.isoformat()) for date in _apart(sorted(set(dates)))
    )
    return Axis(label, min(days) - room, max(days) + room, ticks, dates=True)


def named(label: str, names: Sequence[str]) -> Axis:
    """Return an axis of items counted from 1, labelled by their names."""
    return Axis(
        label, 0.4, len(names) + 0.6, tuple((float(i), name) for i, name in enumerate(names, 1))
    )


def _even(label: str, low: float, high: float, *limits: int, **ticks: Any) -> Axis:
    """Return a linear axis between two ends; the arguments behind them are of its ticks."""
    return Axis(label, low, high, linear_ticks(low, high, *limits, **ticks))


def _logarithmic(label: str, low: float, high: float, *, thousands: bool = False) -> Axis:
    return Axis(label, low, high, log_ticks(low, high, thousands=thousands), log=True)


def _apart(dates: Sequence[datetime.date], most: int = 6) -> list[datetime.date]:
    """Select dates far enough apart to be written side by side, the first among them."""
    span = (dates[-1] - dates[0]).days or 1
    separate = [dates[0]]
    for date in dates[1:]:
        if (date - separate[-1]).days >= span / most:
            separate.append(date)
    return separate


def log_ticks(low: float, high: float, *, thousands: bool = False) -> tuple[tuple[float, str], ...]:
    """Return 1, 2, 5 of each decade if few decades are shown, powers of ten alone if many."""
    decades = math.log10(high / low)
    if decades < 0.8:
        return tuple(tick for tick in linear_ticks(low, high, thousands=thousands) if tick[0] > 0)
    steps = (1, 1.5, 2, 3, 5, 7) if decades <= 1 else (1, 2, 5) if decades <= 3.4 else (1,)
    every = max(1, math.ceil(decades / 9))
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1, every)
    values = [float(f"{step}e{power}") for power in powers for step in steps]
    name = (lambda v: _plain(v, thousands)) if decades <= 4 or thousands else _power
    return tuple((value, name(value)) for value in values if low <= value <= high)


def linear_ticks(
    low: float,
    high: float,
    most: int = 6,
    *,
    steps: Sequence[float] = _STEPS,
    whole_numbers: bool = False,
    thousands: bool = False,
) -> tuple[tuple[float, str], ...]:
    """Round numbers between two limits, at most so many."""
    span = (high - low) / most
    power = 10.0 ** math.floor(math.log10(span))
    step = next((m * power for m in steps if m * power >= span), 10.0 * power)
    step = max(1.0, float(math.ceil(step))) if whole_numbers else step
    ticks = np.arange(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1) * step
    if thousands:
        return tuple(
            (float(value), _plain(float(f"{value:.10g}"), thousands=True)) for value in ticks
        )
    digits = max(0, -math.floor(math.log10(step) + 1e-9) + (f"{step:.3e}"[2:4] not in ("00",)))
    texts = [
        f"{value:.{digits}f}" if digits < 7 and abs(value) < 1e6 else plain(value)
        for value in ticks
    ]
    return tuple((float(value), printed(text)) for value, text in zip(ticks, texts, strict=True))


def _plain(value: float, thousands: bool) -> str:
    if thousands and value >= 1e6:
        return f"{value / 1e6:g} M"
    return f"{value / 1e3:g} k" if thousands and value >= 1e3 else plain(value)


def _power(value: float) -> str:
    return f"10{str(round(math.log10(value))).translate(SUPERSCRIPTS)}"
