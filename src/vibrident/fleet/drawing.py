"""The figures of a fleet's page, as SVG text: their size does not depend on the number of sensors."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from vibrident.escaping import svg as escaped
from vibrident.fleet.statistics import Distribution, Histogram
from vibrident.naming import parameter_name, scaled
from vibrident.present.views import BLACK, BLUE, GREY, VERMILION

WIDTH, HEIGHT = 360.0, 190.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 38.0, 12.0, 15.0, 36.0
_FONT = 'font-family="system-ui, sans-serif" font-size="11"'


def distribution(found: Distribution) -> str:
    """A histogram of a parameter, with its limits."""
    scale = scaled(found.unit, max(abs(found.least), abs(found.greatest)))
    name = parameter_name(found.parameter).words
    limit = found.limit
    marks = [] if limit is None else [(limit.lower, "least"), (limit.upper, "greatest")]
    label = f"{name} in {scale.unit}" if scale.unit != "1" else name
    nominal = None if limit is None else limit.nominal
    return histogram(found.histogram, label, scale.factor, marks=marks, middle=nominal)


def histogram(
    found: Histogram,
    label: str,
    factor: float = 1.0,
    *,
    marks: Sequence[tuple[float, str]] = (),
    middle: float | None = None,
) -> str:
    """Bars over an axis.

    Args:
        found: counts.
        label: under the axis.
        factor: from the values to the numbers on the axis.
        marks: lower and upper limit, each with its label.
        middle: nominal value.
    """
    low, high = float(found.edges[0]), float(found.edges[-1])
    tallest = max(int(found.counts.max()), 1)
    bottom, right = HEIGHT - _BOTTOM, WIDTH - _RIGHT

    def x(value: float) -> float:
        return _LEFT + (right - _LEFT) * (value - low) / (high - low)

    def y(count: float) -> float:
        return bottom - (bottom - _TOP) * count / tallest

    parts = [
        f'<svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" role="img" aria-label="{escaped(label)}" {_FONT}>',
        *_beyond(marks, low, high, x, bottom),
    ]
    for tick, text in _ticks(0, tallest, 4, whole=True):
        parts.append(_line(_LEFT, y(tick), right, y(tick), "#e4e4e4"))
        parts.append(_text(_LEFT - 5, y(tick) + 4, text, "end"))
    for left, end, count in zip(found.edges, found.edges[1:], found.counts, strict=False):
        if count:
            top, said = y(int(count)), f"{left * factor:.6g} … {end * factor:.6g}: {int(count)}"
            width = max(x(end) - x(left) - 0.8, 0.6)
            parts.append(
                f'<rect x="{x(left):.2f}" y="{top:.2f}" width="{width:.2f}" height="{bottom - top:.2f}" '
                f'fill="{BLUE}"><title>{escaped(said)}</title></rect>'
            )
    if middle is not None and low <= middle <= high:
        parts.append(_line(x(middle), _TOP, x(middle), bottom, BLACK, width=1.4, dashes="5 4", title="nominal"))
    for value, what in marks:
        if low <= value <= high:
            title = f"{what} that conforms: {value * factor:.6g}"
            parts.append(_line(x(value), _TOP, x(value), bottom, VERMILION, width=1.6, title=title))
    parts.append(_line(_LEFT, bottom, right, bottom, "#444444"))
    for tick, text in _ticks(low * factor, high * factor, 4):
        parts.append(_line(x(tick / factor), bottom, x(tick / factor), bottom + 4, "#444444"))
        parts.append(_text(x(tick / factor), bottom + 16, text, "middle"))
    parts.append(_text((_LEFT + right) / 2, HEIGHT - 4, label, "middle"))
    if found.below:
        parts.append(_text(_LEFT + 2, _TOP - 2, f"◂ {found.below}", "start", GREY))
    if found.above:
        parts.append(_text(right, _TOP - 2, f"{found.above} ▸", "end", GREY))
    return "\n".join([*parts, "</svg>"])


def over_time(seconds: NDArray[np.float64], label: str) -> str:
    """Calibrations finished in each interval of time; shape (calibrations,), seconds since the beginning."""
    longest = float(seconds.max()) if seconds.size else 0.0
    unit, factor = ("h", 1 / 3600) if longest > 10_000 else ("min", 1 / 60) if longest > 300 else ("s", 1.0)
    counts, edges = np.histogram(seconds, 30, (0.0, max(longest, 1e-3)))
    return histogram(Histogram(edges, counts, 0, 0), f"{label}, in {unit} since the beginning", factor)


def share_bar(share: float, colour: str = BLUE) -> str:
    """A bar for a share of the whole, for a cell of a table."""
    width = 100 * min(max(share, 0.0), 1.0)
    return (
        f'<svg viewBox="0 0 100 8" width="110" height="9" preserveAspectRatio="none" aria-hidden="true">'
        f'<rect width="100" height="8" fill="#ececec"/><rect width="{width:.2f}" height="8" fill="{colour}"/></svg>'
    )


def _beyond(
    marks: Sequence[tuple[float, str]], low: float, high: float, x: Callable[[float], float], bottom: float
) -> list[str]:
    """Shade the values that do not conform."""
    if len(marks) != 2:
        return []
    (lower, _), (upper, _) = marks
    stretches = [(low, min(lower, high)), (max(upper, low), high)]
    return [
        f'<rect x="{x(start):.2f}" y="{_TOP:g}" width="{x(stop) - x(start):.2f}" height="{bottom - _TOP:.2f}" '
        'fill="#d55e00" fill-opacity="0.09"/>'
        for start, stop in stretches
        if stop > start
    ]


def _ticks(low: float, high: float, most: int, *, whole: bool = False) -> list[tuple[float, str]]:
    span = (high - low) / most
    power = math.floor(math.log10(span)) if span > 0 else 0
    step = next(m * 10.0**power for m in (1, 2, 2.5, 5, 10) if m * 10.0**power >= span * (1 - 1e-9))
    step = max(math.ceil(step), 1) if whole else step
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    digits = max(0, -math.floor(math.log10(step)) + (1 if f"{step:.1e}".startswith("2.5") else 0))
    shown = [n * step for n in range(first, last + 1)]
    return [(one, f"{one:.{digits}f}" if digits < 6 and abs(one) < 1e6 else f"{one:.4g}") for one in shown]


def _line(
    x1: float, y1: float, x2: float, y2: float, colour: str, *, width: float = 0.8, dashes: str = "", title: str = ""
) -> str:
    dashed = f' stroke-dasharray="{dashes}"' if dashes else ""
    inner = f"<title>{escaped(title)}</title>" if title else ""
    return (
        f'<line x1="{x1:.2f}" y1="{y1:.2f}" x2="{x2:.2f}" y2="{y2:.2f}" stroke="{colour}" '
        f'stroke-width="{width:g}"{dashed}>{inner}</line>'
    )


def _text(x: float, y: float, text: str, anchor: str, colour: str = "#333333") -> str:
    return f'<text x="{x:.2f}" y="{y:.2f}" text-anchor="{anchor}" fill="{colour}">{escaped(text)}</text>'
