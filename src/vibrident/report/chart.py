"""Line charts as SVG text, for the PDF: quick, small, and without matplotlib, whose loading would outlast the rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vibrident.escaping import svg as escaped
from vibrident.plots.style import BLUE, SKY, VERMILION
from vibrident.records import FloatArray

WIDTH, LEFT, RIGHT, TOP, GAP, BOTTOM = 520.0, 62.0, 8.0, 20.0, 12.0, 34.0
_FONT = 'font-family="Libertinus Serif, serif" font-size="10"'


@dataclass(frozen=True, eq=False)
class Series:
    """One thing drawn in a panel.

    Attributes:
        x: shape (points,).
        y: shape (points,).
        half: half length of the bars, or half width of the band; None for neither.
        label: for the key above the chart; empty for none.
        line: a line with a band, instead of marks with bars.
    """

    x: FloatArray
    y: FloatArray
    half: FloatArray | None = None
    label: str = ""
    line: bool = False


@dataclass(frozen=True)
class Panel:
    """One of several charts above each other that share x."""

    label: str
    series: tuple[Series, ...]
    height: float = 150.0
    log: bool = False
    zero: bool = False


@dataclass(frozen=True)
class Axis:
    """Where values fall on the paper, and which of them are marked."""

    low: float
    high: float
    first: float
    last: float
    log: bool = False
    ticks: tuple[tuple[float, str], ...] = ()

    def place(self, value: FloatArray) -> FloatArray:
        """Position on the paper."""
        low, high = (math.log(self.low), math.log(self.high)) if self.log else (self.low, self.high)
        with np.errstate(divide="ignore", invalid="ignore"):
            at = np.log(value) if self.log else value
        return self.first + (self.last - self.first) * (np.maximum(at, low - 9 * (high - low)) - low) / (high - low)


def svg(panels: Sequence[Panel], x_label: str, x_ticks: Sequence[tuple[float, str]] = (), *, log_x: bool = True) -> str:
    """Draw panels above each other over one x axis.

    Args:
        panels: at least one, each with at least one finite point.
        x_label: under the last panel.
        x_ticks: where to mark a linear x axis, and with what; chosen here for a logarithmic one.
        log_x: logarithmic x axis.
    """
    height = TOP + sum(panel.height for panel in panels) + GAP * (len(panels) - 1) + BOTTOM
    xs = np.concatenate([series.x for panel in panels for series in panel.series])
    x_axis = _x_axis(xs, x_ticks, log_x)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:g} {height:g}" width="{WIDTH:g}" '
        f'height="{height:g}" {_FONT}>'
    ]
    top = TOP
    for number, panel in enumerate(panels):
        parts += _panel(panel, x_axis, top, number, last=number == len(panels) - 1)
        top += panel.height + GAP
    parts.append(_text((LEFT + WIDTH - RIGHT) / 2, height - 4, x_label, "middle"))
    parts += _key(panels)
    return "\n".join([*parts, "</svg>"])


def _x_axis(xs: FloatArray, ticks: Sequence[tuple[float, str]], log: bool) -> Axis:
    low, high = float(xs.min()), float(xs.max())
    if log:
        low, high = (low / 1.25, high * 1.25) if low == high else (low / 1.04, high * 1.04)
        return Axis(low, high, LEFT, WIDTH - RIGHT, True, tuple(log_ticks(low, high)))
    margin = 0.06 * (high - low) or 1.0
    return Axis(low - margin, high + margin, LEFT, WIDTH - RIGHT, False, tuple(ticks))


def _y_axis(panel: Panel, top: float) -> Axis:
    ends = []
    for series in panel.series:
        # The band of a model that is hardly known must not squeeze all else flat.
        reach = 0.0 if series.half is None else np.nan_to_num(np.minimum(series.half, 3 * np.ptp(series.y) + 1e-300))
        reach = reach if np.ptp(series.y) > 0 or series.half is None else np.nan_to_num(series.half)
        ends += [series.y - reach, series.y + reach]
    values = np.concatenate(ends)
    values = values[np.isfinite(values) & ((values > 0) if panel.log else True)]
    low, high = float(values.min()), float(values.max())
    bottom = top + panel.height
    if panel.log and high > 3 * low:
        low, high = low / 1.12, high * 1.12
        return Axis(low, high, bottom, top, True, tuple(log_ticks(low, high)))
    if panel.zero:
        low, high = min(low, 0.0), max(high, 0.0)
    margin = 0.07 * (high - low) or 0.05 * abs(high) or 1.0
    low, high = low - margin, high + margin
    return Axis(low, high, bottom, top, False, tuple(_linear_ticks(low, high)))


def log_ticks(low: float, high: float) -> list[tuple[float, str]]:
    """1, 2, 5 of each decade where few decades are shown, powers of ten alone where many."""
    decades = math.log10(high / low)
    steps = (1, 2, 5) if decades < 4 else (1,)
    if decades < 0.8:
        return [tick for tick in _linear_ticks(low, high) if tick[0] > 0]
    every = max(1, math.ceil(decades / 9))
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1, every)
    values = (float(f"{step}e{power}") for power in powers for step in steps)
    return [(value, f"{value:g}") for value in values if low <= value <= high]


def _linear_ticks(low: float, high: float, most: int = 6) -> list[tuple[float, str]]:
    span = (high - low) / most
    power = math.floor(math.log10(span))
    step = next(m * 10.0**power for m in (1, 2, 2.5, 5, 10) if m * 10.0**power >= span)
    first, last = math.ceil(low / step), math.floor(high / step)
    digits = max(0, -math.floor(math.log10(step)) + (1 if f"{step:.1e}".startswith("2.5") else 0))
    return [(n * step, f"{n * step:.{digits}f}" if digits < 7 else f"{n * step:g}") for n in range(first, last + 1)]


def _panel(panel: Panel, x_axis: Axis, top: float, number: int, *, last: bool) -> list[str]:
    axis, bottom = _y_axis(panel, top), top + panel.height
    box = f'x="{LEFT:g}" y="{top:g}" width="{WIDTH - RIGHT - LEFT:g}" height="{panel.height:g}"'
    parts = [f'<clipPath id="panel{number}"><rect {box}/></clipPath>']
    for value, text in x_axis.ticks:
        x = float(x_axis.place(np.array(value)))
        parts.append(_line(x, top, x, bottom, "#dddddd", 0.6))
        parts += [_text(x, bottom + 12, text, "middle")] if last else []
    for value, text in axis.ticks:
        y = float(axis.place(np.array(value)))
        parts += [_line(LEFT, y, WIDTH - RIGHT, y, "#dddddd", 0.6), _text(LEFT - 4, y + 3.4, text, "end")]
    if panel.zero:
        y = float(axis.place(np.array(0.0)))
        parts.append(_line(LEFT, y, WIDTH - RIGHT, y, "#444444", 0.8))
    parts.append(f'<g clip-path="url(#panel{number})">')
    for series in panel.series:
        parts += _drawn_line(series, x_axis, axis) if series.line else _drawn_marks(series, x_axis, axis)
    middle = (top + bottom) / 2
    parts += [
        "</g>",
        f'<rect {box} fill="none" stroke="#444444" stroke-width="0.8"/>',
        f'<text x="12" y="{middle:g}" text-anchor="middle" transform="rotate(-90 12 {middle:g})">'
        f"{escaped(panel.label)}</text>",
    ]
    return parts


def _drawn_line(series: Series, x_axis: Axis, y_axis: Axis) -> list[str]:
    x, y = x_axis.place(series.x), y_axis.place(series.y)
    parts = []
    if series.half is not None and np.isfinite(series.half).all():
        upper, lower = y_axis.place(series.y + series.half), y_axis.place(series.y - series.half)
        outline = _points(np.concatenate([x, x[::-1]]), np.concatenate([upper, lower[::-1]]))
        parts.append(f'<polygon points="{outline}" fill="{SKY}" fill-opacity="0.45"/>')
    return [*parts, f'<polyline points="{_points(x, y)}" fill="none" stroke="{BLUE}" stroke-width="1.3"/>']


def _drawn_marks(series: Series, x_axis: Axis, y_axis: Axis) -> list[str]:
    x, y = x_axis.place(series.x), y_axis.place(series.y)
    size = 2.1 if len(x) <= 60 else 1.1
    parts = []
    if series.half is not None and len(x) <= 200:
        ends = y_axis.place(series.y - series.half), y_axis.place(series.y + series.half)
        bars = zip(x, *ends, strict=True)
        parts += [_line(a, low, a, high, VERMILION, 1.0) for a, low, high in bars if np.isfinite(low + high)]
    dots = [(a, b) for a, b in zip(x, y, strict=True) if np.isfinite(b)]
    return parts + [f'<circle cx="{a:.2f}" cy="{b:.2f}" r="{size}" fill="{VERMILION}"/>' for a, b in dots]


def _key(panels: Sequence[Panel]) -> list[str]:
    """Names of what is drawn, once each, above the first panel."""
    seen: dict[str, Series] = {}
    for panel in panels:
        for series in panel.series:
            if series.label:
                seen.setdefault(series.label, series)
    parts, x = [], LEFT
    for label, series in seen.items():
        if series.line:
            parts += [_line(x, 8, x + 16, 8, SKY, 6) if series.half is not None else ""]
            parts += [_line(x, 8, x + 16, 8, BLUE, 1.3)]
        else:
            parts.append(f'<circle cx="{x + 8:g}" cy="8" r="2.1" fill="{VERMILION}"/>')
        parts.append(_text(x + 21, 11.4, label, "start"))
        x += 36 + 5.0 * len(label)
    return parts


def _points(x: FloatArray, y: FloatArray) -> str:
    return " ".join(f"{a:.2f},{b:.2f}" for a, b in zip(x, y, strict=True) if np.isfinite(b))


def _line(x1: float, y1: float, x2: float, y2: float, colour: str, width: float) -> str:
    return f'<path d="M{x1:.2f} {y1:.2f}L{x2:.2f} {y2:.2f}" stroke="{colour}" stroke-width="{width:g}" fill="none"/>'


def _text(x: float, y: float, text: str, anchor: str) -> str:
    return f'<text x="{x:.2f}" y="{y:.2f}" text-anchor="{anchor}">{escaped(text)}</text>'
