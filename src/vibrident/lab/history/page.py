"""Page of a sensor's history, for pages and a terminal, from its document alone."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vibrident.base.amounts import pretty
from vibrident.base.fields import GivenFields
from vibrident.lab.history import tables
from vibrident.lab.history.tables import quantity_name, scale_of
from vibrident.show import axes
from vibrident.show.numbers import sensor_name
from vibrident.show.views import (
    BLUE,
    GREEN,
    GREY,
    VERMILION,
    Axis,
    Block,
    Document,
    Figure,
    FloatArray,
    Look,
    Panel,
    Section,
    Series,
    Stack,
    document,
    section,
)


def report(life: GivenFields) -> Document:
    """Return the page of a sensor's history."""
    return document(f"History of {sensor_name(life['sensor'])}", (), sections(life))


def sections(life: GivenFields) -> list[Section]:
    """Return the sections of the page, for other pages too."""
    name = tables.quantity_name(life)
    return [
        section(
            "values", f"History of the {name}", chart_of_values(life), tables.calibrations(life)
        ),
        section("drift", "Drift", tables.drift(life), *tables.series(life)),
        section("due", "Next calibration", tables.due(life)),
        section("control", "Control charts", control_charts(life), tables.control(life)),
        section("events", "Events", tables.events(life)),
    ]


def printed(life: GivenFields) -> tuple[Block | None, ...]:
    """Return the history for a terminal, with a chart of letters in place of pictures."""
    title = f"{sensor_name(life['sensor'])}: {tables.quantity_name(life)}"
    calibrations = replace(tables.calibrations(life), title=title)
    events = tables.events(life)
    return (
        calibrations,
        tables.chart(life),
        *tables.series(life),
        tables.drift(life),
        tables.control(life),
        tables.due(life),
        None if events is None else replace(events, title="Events"),
    )


CAPTION = (
    "Each calibration with U (k = 2), thick the part that it does not share with others; and in "
    "the band, with 95 % probability, the sensor itself from the last calibration on. Green: "
    "tolerance; grey upright: repaired."
)
_LIMIT = Look(GREY, "dashed", 1.2)
_TOLERANCE = Look(GREEN, "dashed", 1.2)


def picture(document: GivenFields) -> Figure:
    """Draw values and control charts in one figure.

    The history needs at least one valid calibration.
    """
    charts = document["control"]["charts"] if document["control"] else ()
    panels = (_values(document), *(_control(chart, document) for chart in charts))
    title = f"History: {quantity_name(document)}"
    return Figure("history", title, (Stack(panels),), sensor_name(document["sensor"]), CAPTION)


def chart_of_values(document: GivenFields) -> Figure | None:
    """Draw each calibration with U, its series, the predicted band, tolerance and events."""
    if not any(row["counts"] for row in document["calibrations"]):
        return None
    return Figure(
        "values", f"History: {quantity_name(document)}", (Stack((_values(document),)),), "", CAPTION
    )


def control_charts(document: GivenFields) -> Figure | None:
    """Draw EWMA and CUSUM with their limits, in standard deviations."""
    if document["control"] is None:
        return None
    panels = tuple(_control(chart, document) for chart in document["control"]["charts"])
    caption = "A stable sensor stays within the dashed limits; red: alarm."
    return Figure("control", "Control charts", (Stack(panels),), "", caption)


def _values(document: GivenFields) -> Panel:
    factor = scale_of(document).factor
    x = _dates(document)
    series = _expected(document, factor)
    counted = [row for row in document["calibrations"] if row["counts"]]
    unshared = 2 * factor * _column(counted, "u_own")
    series.append(
        Series(
            _days(counted),
            factor * _column(counted, "value"),
            "",
            Look(VERMILION, width=4.0),
            "points",
            unshared,
        )
    )
    for number in sorted({row["series"] for row in counted}):
        rows = [row for row in counted if row["series"] == number]
        y = factor * _column(rows, "value")
        name = (
            f"series {number}, U (k = 2)"
            if len(document["series"]) > 1
            else "calibrations, U (k = 2)"
        )
        texts = tuple(
            f"calibration {row['id']}, {row['date']}: {v:.6g}"
            for row, v in zip(rows, y, strict=True)
        )
        series.append(Series(_days(rows), y, "", Look(GREY, "dotted", 1.0)))
        look = Look(VERMILION, marker="o")
        series.append(
            Series(_days(rows), y, name, look, "points", factor * _column(rows, "U"), texts=texts)
        )
    for limit in (document["due"] or {}).get("limits", ()):
        series.append(Series(np.array([x.low, x.high]), np.full(2, limit * factor), "", _TOLERANCE))
    ends = [
        curve.y + sign * (0.0 if curve.half is None else curve.half)
        for curve in series
        for sign in (-1, 1)
    ]
    y_axis = axes.linear(
        f"{quantity_name(document)}\nin {pretty(scale_of(document).unit)}", np.concatenate(ends)
    )
    repaired = [event for event in document["events"] if event["kind"] == "repaired"]
    marks = tuple((float(day), "repaired") for day in _days(repaired))
    return Panel(x, y_axis, tuple(series), 2.4, marks=marks)


def _expected(document: GivenFields, factor: float) -> list[Series]:
    curve = document["drift"].get("curve")
    if not curve:
        return []
    low, high = (
        factor * np.array([point["interval_95"][side] for point in curve]) for side in (0, 1)
    )
    days = _days(curve)
    band = Series(
        days,
        (low + high) / 2,
        "",
        Look(BLUE, width=0.0),
        half=(high - low) / 2,
        band="sensor, 95 %",
    )
    return [
        band,
        Series(days, factor * _column(curve, "value"), "to be expected", Look(BLUE, width=1.2)),
    ]


def _control(chart: GivenFields, document: GivenFields) -> Panel:
    days = np.array([_day(date) for date in document["control"]["dates"]])
    alarm = list(chart["alarm"])
    series = []
    limit = np.array(chart["limit"], dtype=float)
    for side in dict.fromkeys((tuple(chart["upper"]), tuple(chart["lower"]))):
        y = np.array(side, dtype=float)
        series.append(Series(days, y, "", Look(BLUE, width=1.0, marker="o")))
        series.append(Series(days[alarm], y[alarm], "", Look(VERMILION, marker="D"), "points"))
    series += [Series(days, sign * limit, "", _LIMIT) for sign in (1, -1)]
    y_axis = axes.linear(
        "in standard\ndeviations",
        np.concatenate([np.zeros(1), *(curve.y for curve in series)]),
        most=4,
    )
    return Panel(_dates(document), y_axis, tuple(series), 1.2, chart["name"], rules=(0.0,))


def _dates(document: GivenFields) -> Axis:
    rows = [*document["calibrations"], *(document["drift"].get("curve") or ())]
    return axes.dates("Date", [datetime.date.fromisoformat(row["date"][:10]) for row in rows])


def _day(date: str) -> float:
    return float(datetime.date.fromisoformat(date[:10]).toordinal())


def _days(rows: Sequence[GivenFields]) -> FloatArray:
    return np.array([_day(row["date"]) for row in rows], dtype=float)


def _column(rows: Sequence[GivenFields], name: str) -> FloatArray:
    return np.array([row[name] for row in rows], dtype=float)
