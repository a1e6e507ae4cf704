"""The history of a sensor as a picture: its values over the years with what is to be expected, and control charts."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from vibrident.history.tables import quantity_name, scale_of, unit_of
from vibrident.plots import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def figure(document: Mapping[str, Any]) -> Figure:
    """Draw the picture of a history that has at least one calibration that counts."""
    control = document["control"]
    with style.styled():
        picture = style.new_figure(6.7, 6.4 if control else 3.6)
        rows = picture.add_gridspec(3 if control else 1, 1, height_ratios=(2, 1, 1) if control else (1,))
        upper = picture.add_subplot(rows[0])
        _values(upper, document)
        for i, chart in enumerate(control["charts"] if control else ()):
            below = picture.add_subplot(rows[i + 1], sharex=upper)
            _chart(below, chart, control["dates"])
            below.tick_params(labelbottom=i == 1)
        if control:
            upper.tick_params(labelbottom=False)
        style.title(picture, f"History: {quantity_name(document)}", "", document["sensor"])
        return picture


def _values(axes: Axes, document: Mapping[str, Any]) -> None:
    factor = scale_of(document).factor
    curve = document["drift"].get("curve") or ()
    if curve:
        ends = np.array([point["interval_95"] for point in curve]) * factor
        dates = _days([point["date"] for point in curve])
        axes.fill_between(dates, *ends.T, color=style.SKY, alpha=0.4, lw=0, label="sensor, 95 %")
        axes.plot(dates, np.array([point["value"] for point in curve]) * factor, color=style.BLUE, lw=1.2)
    counted = [row for row in document["calibrations"] if row["counts"]]
    for number in sorted({row["series"] for row in counted}):
        rows = [row for row in counted if row["series"] == number]
        y, half = (np.array([row[key] for row in rows]) * factor for key in ("value", "U"))
        own = np.array([row["u_own"] for row in rows]) * 2 * factor
        axes.vlines(_days([row["date"] for row in rows]), y - own, y + own, color=style.VERMILION, lw=3)
        label = "calibrations, U (k = 2)" if number == 1 else None
        look = {"color": style.VERMILION, "capsize": 2, "marker": "o", "ms": 4, "ls": ":", "lw": 1, "label": label}
        axes.errorbar(_days([row["date"] for row in rows]), y, half, **look)
    for limit in (document["due"] or {}).get("limits", ()):
        axes.axhline(limit * factor, color=style.GREEN, ls="--", lw=1)
    for event in document["events"]:
        if event["kind"] == "repaired":
            axes.axvline(_days([event["date"]])[0], color=style.GREY, ls="--", lw=1)
    axes.set_ylabel(f"{quantity_name(document)}\nin {unit_of(document)}")
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.legend(loc="best")


def _chart(axes: Axes, chart: Mapping[str, Any], dates: list[str]) -> None:
    x = _days(dates)
    for side in ("upper", "lower"):
        axes.plot(x, chart[side], color=style.BLUE, marker="o", ms=3.5, lw=1)
        alarm = list(chart["alarm"])
        axes.plot([x[i] for i in alarm], [chart[side][i] for i in alarm], "o", ms=5, color=style.VERMILION)
    for sign in (1, -1):
        axes.plot(x, sign * np.array(chart["limit"]), color=style.GREY, ls="--", lw=1)
    axes.set_ylabel(chart["name"])


def _days(dates: list[str]) -> list[Any]:
    return [datetime.date.fromisoformat(day) for day in dates]
