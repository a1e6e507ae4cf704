"""Figures of a fleet's page: histograms of parameters, and calibrations over time."""

from __future__ import annotations

import numpy as np

from vibrident.base.amounts import scaled
from vibrident.data.records import FloatArray
from vibrident.lab.fleet.limits import Limit
from vibrident.lab.fleet.statistics import Distribution, Histogram
from vibrident.physics.naming import parameter_name
from vibrident.show import axes
from vibrident.show.views import BLACK, SKY, VERMILION, Axis, Figure, Look, Panel, Series, Stack

_BARS = Look(SKY)
_OUTSIDE = Look("#fbeee6", width=0.0)
_SIDE_MARGIN = 0.03  # in units of the bars' range: half of a tick's label
_LIMIT = Look(VERMILION, width=1.6)
_NOMINAL = Look(BLACK, "dashed", 1.4)


def distribution(spread: Distribution) -> Figure:
    """Return a histogram of a parameter, with its limits and its nominal value."""
    scale = scaled(spread.unit, max(abs(spread.least), abs(spread.greatest)))
    name = parameter_name(spread.parameter).words
    label = f"{name} in {scale.printed}" if scale.printed else name
    return histogram(spread.histogram, label, scale.factor, spread.limit)


def over_time(seconds: FloatArray, label: str) -> Figure:
    """Return a histogram of the calibrations finished over time.

    ``seconds``: since the beginning, shape (calibrations,).
    """
    longest = float(seconds.max(initial=0.0))
    unit, factor = (
        ("h", 1 / 3600) if longest > 10_000 else ("min", 1 / 60) if longest > 300 else ("s", 1.0)
    )
    counts, edges = np.histogram(seconds, 30, (0.0, max(longest, 1e-3)))
    return histogram(
        Histogram(edges, counts, 0, 0), f"{label}, in {unit} since the beginning", factor
    )


def histogram(
    bins: Histogram, label: str, factor: float = 1.0, limit: Limit | None = None
) -> Figure:
    """Return bars over an axis.

    Args:
        bins: counts.
        label: under the axis.
        factor: from the values to the numbers on the axis.
        limit: for the values.
    """
    edges = bins.edges * factor
    tallest = float(max(bins.counts.max(), 1))
    low = float(edges[0])
    high = float(edges[-1])
    bars = Series(
        (edges[1:] + edges[:-1]) / 2,
        bins.counts.astype(float),
        "",
        _BARS,
        "columns",
        np.diff(edges) / 2,
    )
    series = [bars] if limit is None else [*_outside(limit, factor, low, high, tallest), bars]
    if limit is not None:
        for value, look in (
            (limit.nominal, _NOMINAL),
            (limit.lower, _LIMIT),
            (limit.upper, _LIMIT),
        ):
            if low <= value * factor <= high:
                series.append(
                    Series(np.full(2, value * factor), np.array([0.0, tallest]), "", look)
                )
    room = _SIDE_MARGIN * (high - low)
    x = Axis(label, low - room, high + room, axes.linear_ticks(low, high, 4))
    y = Axis("", 0.0, tallest, axes.linear_ticks(0.0, tallest, 4, whole_numbers=True))
    beyond = (f"◂ {bins.below}" if bins.below else "", f"{bins.above} ▸" if bins.above else "")
    panel = Panel(x, y, tuple(series), 1.2, " · ".join(filter(None, beyond)))
    return Figure("histogram", label, (Stack((panel,)),), width_in=3.4)


def _outside(limit: Limit, factor: float, low: float, high: float, top: float) -> list[Series]:
    """Shade the values that do not conform."""
    stretches = ((low, min(limit.lower * factor, high)), (max(limit.upper * factor, low), high))
    return [
        Series(
            np.array([(stop + start) / 2]),
            np.array([top]),
            "",
            _OUTSIDE,
            "columns",
            np.array([(stop - start) / 2]),
        )
        for start, stop in stretches
        if stop > start
    ]
