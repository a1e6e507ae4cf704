"""Draw the panels of a figure with matplotlib: axes, lines, points, stems and columns."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from vibrident.show.curves import envelope
from vibrident.show.media.fonts import printable, split_lines
from vibrident.show.views import (
    BLACK,
    BLUE,
    GREY,
    MAX_POINTS_WITH_BARS,
    Axis,
    Panel,
    Series,
    band_colour,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_DASHES = {"solid": "-", "dashed": "--", "dotted": ":", "dashdot": "-."}


def draw_panel(axes: Axes, panel: Panel, *, last: bool) -> None:
    """Draw a panel into its axes; ``last``: with the labels of x."""
    _set_axis(axes.xaxis, axes.set_xscale, axes.set_xlim, panel.x)
    _set_axis(axes.yaxis, axes.set_yscale, axes.set_ylim, panel.y)
    axes.set_ylabel("\n".join(split_lines(panel.y.label)))
    axes.set_xlabel("\n".join(split_lines(panel.x.label)) if last else "", labelpad=2.0)
    axes.tick_params(labelbottom=last)
    if panel.empty:
        axes.text(
            0.5,
            0.5,
            printable(panel.empty),
            transform=axes.transAxes,
            ha="center",
            va="center",
            color="#404040",
        )
        axes.grid(False)
        axes.tick_params(which="both", left=False, bottom=False, labelleft=False, labelbottom=False)
        return
    for value in panel.rules:
        axes.axhline(value, color=BLACK, lw=0.8, zorder=2)
    for value, words in panel.marks:
        axes.axvline(value, color=GREY, lw=1.0, ls="--")
        across = axes.get_xaxis_transform()
        look = {"fontsize": 7.5, "color": "#404040", "clip_on": True, "va": "center", "ha": "right"}
        axes.text(value, 0.5, f"{printable(words)} ", transform=across, **look)
    for series in panel.series:
        _DRAWN[series.kind](axes, series)
    if panel.square:
        axes.set_aspect("equal", "box")


def _set_axis(of: Any, scale: Any, limits: Any, axis: Axis) -> None:
    from matplotlib.ticker import FixedFormatter, FixedLocator, NullFormatter

    if axis.log:
        scale("log")
        of.set_minor_formatter(NullFormatter())
    limits(axis.low, axis.high)
    of.set_major_locator(FixedLocator([value for value, _ in axis.ticks]))
    of.set_major_formatter(FixedFormatter([printable(name) for _, name in axis.ticks]))


def _line(axes: Axes, series: Series) -> None:
    look = series.look
    if series.half is not None:
        low = series.y - series.half
        high = series.y + series.half
        if axes.get_yscale() == "log":
            low = np.maximum(low, 1e-3 * series.y)
        axes.fill_between(
            series.x,
            low,
            high,
            color=band_colour(look),
            alpha=0.45,
            lw=0,
            label=series.band or None,
        )
    if look.width:
        how: dict[str, Any] = {
            "color": look.colour,
            "lw": look.width,
            "label": series.label or None,
        }
        how |= {"marker": look.marker, "markersize": 3.2} if look.marker else {}
        axes.plot(*envelope(series.x, series.y), _DASHES[look.dash], **how)


def _points(axes: Axes, series: Series) -> None:
    look = series.look
    x = series.x
    y = series.y
    many = len(x)
    if not look.marker and series.half is not None:  # bars alone
        axes.vlines(x, y - series.half, y + series.half, color=look.colour, lw=look.width)
        return
    common: dict[str, Any] = {
        "color": look.colour,
        "linestyle": "none",
        "zorder": 3,
        "marker": look.marker or "o",
    }
    if look.marker in ("x", "."):
        common["markersize"] = 2.6
        # a cloud lies below the lines through it
        common["zorder"] = 3 if look.marker == "x" else 1.5
    else:
        common |= {"markerfacecolor": "white", "markersize": 4.2 if many <= 80 else 2.4}
    if many > MAX_POINTS_WITH_BARS:
        common["rasterized"] = True
    half = series.half
    has_bar = np.zeros(many, dtype=bool)
    if half is not None:
        has_bar = np.isfinite(half) & np.isfinite(y)
        below = np.minimum(half, 0.999 * y) if axes.get_yscale() == "log" else half
        caps: dict[str, Any] = (
            {"elinewidth": 1.0, "capsize": 2.2} if many <= 80 else {"elinewidth": 0.6, "capsize": 0}
        )
        bars = np.stack([below, half])[:, has_bar]
        axes.errorbar(x[has_bar], y[has_bar], bars, label=series.label or None, **common, **caps)
    if (unknown := ~has_bar & np.isfinite(y)).any():
        label = (
            f"{series.label.partition(',')[0]}, without uncertainty"
            if has_bar.any()
            else series.label
        )
        axes.plot(x[unknown], y[unknown], label=label if series.label else None, **common)


def _stems(axes: Axes, series: Series) -> None:
    axes.vlines(series.x, axes.get_ylim()[0], series.y, color=GREY, lw=0.8)
    _points(axes, series)


def _columns(axes: Axes, series: Series) -> None:
    assert series.half is not None
    edges = np.append(series.x - series.half, series.x[-1] + series.half[-1])
    outline: dict[str, Any] = {"edgecolor": BLUE, "lw": 0.5} if series.look.width else {"lw": 0.0}
    axes.stairs(
        series.y, edges, fill=True, color=series.look.colour, label=series.label or None, **outline
    )


_DRAWN = {"line": _line, "points": _points, "stems": _stems, "columns": _columns}
