"""The charts of a history as plotly figures: values over the years with what is to be expected, and control charts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from vibrident.escaping import plotly
from vibrident.history.tables import quantity_name, scale_of, unit_of
from vibrident.plots.style import BLUE, GREEN, GREY, VERMILION
from vibrident.report.figures import Figure, axis, bars, figure, listed

_BAND = "rgba(86, 180, 233, 0.40)"


def values(document: Mapping[str, Any]) -> Figure | None:
    """Each calibration with U, its series, the band to be expected, tolerance and events."""
    counted = [row for row in document["calibrations"] if row["counts"]]
    if not counted:
        return None
    factor = scale_of(document).factor
    data: list[Any] = _expected(document, factor)
    data += _own(counted, factor)
    for number in sorted({row["series"] for row in counted}):
        rows = [row for row in counted if row["series"] == number]
        data.append(
            {
                "x": [row["date"] for row in rows],
                "y": listed(np.array([row["value"] for row in rows]) * factor),
                "error_y": bars(np.array([row["U"] for row in rows]) * factor),
                "text": [plotly(f"calibration {row['id']}, {row['date']}") for row in rows],
                "hovertemplate": "%{text}: %{y:.6g}<extra></extra>",
                "mode": "lines+markers",
                "line": {"color": GREY, "width": 1, "dash": "dot"},
                "marker": {"color": VERMILION, "size": 8},
                "name": f"series {number}, U (k = 2)" if len(document["series"]) > 1 else "calibrations, U (k = 2)",
            }
        )
    shapes = [*_tolerance(document, factor), *_repairs(document)]
    layout = {
        "xaxis": axis("date", type="date"),
        "yaxis": axis(f"{plotly(quantity_name(document))}<br>in {plotly(unit_of(document))}"),
        "shapes": shapes,
    }
    return figure(data, 420, **layout)


def _expected(document: Mapping[str, Any], factor: float) -> list[Any]:
    curve = document["drift"].get("curve")
    if not curve:
        return []
    dates = [point["date"] for point in curve]
    low, middle, high = (
        listed(np.array(column) * factor)
        for column in zip(*((p["interval_95"][0], p["value"], p["interval_95"][1]) for p in curve), strict=True)
    )
    hidden = {"x": dates, "mode": "lines", "line": {"width": 0}, "hoverinfo": "skip"}
    return [
        {**hidden, "y": high, "showlegend": False},
        {**hidden, "y": low, "fill": "tonexty", "fillcolor": _BAND, "name": "sensor, 95 %"},
        {"x": dates, "y": middle, "mode": "lines", "line": {"color": BLUE, "width": 1.5}, "name": "to be expected"},
    ]


def _own(rows: list[Mapping[str, Any]], factor: float) -> list[Any]:
    """Thick bars: the part of U that a calibration does not share with others."""
    y, half = (np.array([row[key] for row in rows]) * factor for key in ("value", "u_own"))
    bar = {**bars(2 * half), "thickness": 4, "width": 0, "color": VERMILION}
    hidden = {"mode": "markers", "marker": {"size": 1}, "showlegend": False, "hoverinfo": "skip"}
    return [{"x": [row["date"] for row in rows], "y": listed(y), "error_y": bar, **hidden}]


def _tolerance(document: Mapping[str, Any], factor: float) -> list[Any]:
    limits = (document["due"] or {}).get("limits", ())
    look = {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "line": {"color": GREEN, "width": 1.5, "dash": "dash"}}
    return [{**look, "y0": limit * factor, "y1": limit * factor} for limit in limits]


def _repairs(document: Mapping[str, Any]) -> list[Any]:
    days = [event["date"] for event in document["events"] if event["kind"] == "repaired"]
    look = {"type": "line", "yref": "paper", "y0": 0, "y1": 1, "line": {"color": GREY, "width": 1, "dash": "dash"}}
    return [{**look, "x0": day, "x1": day} for day in days]


def control(document: Mapping[str, Any]) -> Figure | None:
    """EWMA and CUSUM with their limits, in standard deviations."""
    found = document["control"]
    if found is None:
        return None
    dates = found["dates"]
    data: list[Any] = []
    layout: dict[str, Any] = {"xaxis": axis("date", type="date", anchor="y2", mirror="all")}
    for i, chart in enumerate(found["charts"]):
        place = "y2" if i else "y"
        top = 1.0 - 0.53 * i
        layout[f"yaxis{'2' if i else ''}"] = axis(
            f"{chart['name']}<br>in standard deviations", domain=[top - 0.47, top], zeroline=True
        )
        sides = [chart["upper"]] if chart["upper"] == chart["lower"] else [chart["upper"], chart["lower"]]
        for side in sides:
            marks = [VERMILION if n in chart["alarm"] else BLUE for n in range(len(side))]
            line = {
                "mode": "lines+markers",
                "line": {"color": BLUE, "width": 1.2},
                "marker": {"color": marks, "size": 8},
            }
            hover = f"%{{x}}: %{{y:.3g}}<extra>{chart['name']}</extra>"
            data.append({"x": dates, "y": listed(np.array(side)), "yaxis": place, "hovertemplate": hover, **line})
        for sign in (1, -1):
            limit = listed(sign * np.array(chart["limit"]))
            look = {"mode": "lines", "line": {"color": GREY, "width": 1.2, "dash": "dash"}, "hoverinfo": "skip"}
            data.append({"x": dates, "y": limit, "yaxis": place, **look})
    return figure(data, 460, showlegend=False, **layout)
