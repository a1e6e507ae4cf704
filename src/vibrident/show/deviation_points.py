"""Compare measured points with the reference value: deviation, limits, decision, picture."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vibrident.base.amounts import UnitScale, scaled
from vibrident.data.records import STANDARD_GRAVITY
from vibrident.result import Result
from vibrident.show import axes
from vibrident.show.coverage import unstated
from vibrident.show.curves import column
from vibrident.show.language import ENGLISH, Say
from vibrident.show.numbers import NONE, plain, rounded, unit_of_sensitivity, with_sign, with_u
from vibrident.show.points import reference_value
from vibrident.show.views import (
    GREY,
    MAX_POINTS_WITH_BARS,
    MEASURED,
    Column,
    Figure,
    K,
    Look,
    Panel,
    Series,
    Stack,
)
from vibrident.use.conformity import JudgedRequirement, judge_points

TITLE = "Deviation from the value at the reference frequency"
_DECIBEL = 20.0 / math.log(10.0)  # dB for a relative change of one, to first order
_PER_ACCELERATION = ("/(m/s^2)", "/(m/s²)")


@dataclass(frozen=True)
class PointColumn:
    """A column of the table of measured points."""

    head: Column
    cell: Callable[[int], str]  # number of a point → its text


def columns_of_points(result: Result, say: Say = ENGLISH) -> list[PointColumn]:
    """Return the columns that set each measured point beside the reference value and its limits.

    Without a reference value there is no deviation, without requirements no limits.
    """
    columns = _per_g(result, say)
    points = by_point(result)
    if not points:
        return columns
    columns += [
        PointColumn(Column(say("head", "deviation"), "number", "%"), lambda i: _percent(points[i])),
        PointColumn(
            Column(say("head", "deviation"), "number", "dB"), lambda i: _decibel(points[i])
        ),
    ]
    if any(map(_limited, points.values())):
        words = {None: "not_judged", True: "pass", False: "fail"}

        def decision(i: int) -> str:
            return say("text", words[points[i].met]) if _limited(points[i]) else ""

        columns += [
            PointColumn(Column(say("head", "limits"), "number", "%"), lambda i: _limits(points[i])),
            PointColumn(Column(say("head", "decision")), decision),
        ]
    return columns


def by_point(result: Result) -> dict[int, JudgedRequirement]:
    """Return what is said of each measured point by its number; nothing without a reference value.

    A document that certifies nothing judges nothing.
    """
    value = reference_value(result)
    if value is None or not value.magnitude:
        return {}
    measured_pair = value.magnitude, value.magnitude_uncertainty
    judging = "gain" not in unstated(result)
    measured_indices = np.flatnonzero(np.isfinite(result.measured.magnitude)).tolist()
    rows = judge_points(result, value.frequency_hz, measured_pair, limited=judging)
    return dict(zip(measured_indices, rows, strict=True))


def _per_g(result: Result, say: Say) -> list[PointColumn]:
    """Return the magnitude per standard gravity, of a sensitivity to acceleration."""
    unit = unit_of_sensitivity(result)
    end = next((end for end in _PER_ACCELERATION if unit.endswith(end)), None)
    sizes = result.measured.magnitude * STANDARD_GRAVITY
    if end is None or not np.isfinite(sizes).any():
        return []
    scale: UnitScale = scaled(unit.removesuffix(end) + "/g", float(np.nanmedian(np.abs(sizes))))
    u = column(result.measured, "magnitude_uncertainty") * STANDARD_GRAVITY

    def cell(i: int) -> str:
        u_here = float(u[i]) if np.isfinite(u[i]) else None
        return with_u(float(sizes[i]), u_here, scale.factor)[0]

    return [PointColumn(Column(say("head", "magnitude"), "number", scale.unit), cell)]


def _limited(row: JudgedRequirement) -> bool:
    return math.isfinite(row.low) or math.isfinite(row.high)


def _percent(row: JudgedRequirement) -> str:
    return with_sign(rounded(row.value, None if row.u is None else K * row.u)[0])


def _decibel(row: JudgedRequirement) -> str:
    ratio = 1.0 + row.value / 100.0
    if ratio <= 0.0:
        return NONE
    u = None if row.u is None else K * _DECIBEL * row.u / 100.0 / ratio
    return with_sign(rounded(_DECIBEL * math.log(ratio), u)[0])


def _limits(row: JudgedRequirement) -> str:
    if not _limited(row):
        return ""
    low = plain(row.low)
    high = plain(row.high)
    if math.isinf(row.low):
        return f"≤ {high}"
    return (
        f"≥ {low}" if math.isinf(row.high) else f"{low}\N{NO-BREAK SPACE}…\N{NO-BREAK SPACE}{high}"
    )


def from_reference(result: Result, say: Say = ENGLISH) -> Figure | None:
    """Return the picture of the deviation from the reference value; None for a single point."""
    points = by_point(result)
    if len(points) < 2:
        return None
    order = sorted(points, key=lambda i: float(result.measured.frequency_hz[i]))
    rows = [points[i] for i in order]
    x = result.measured.frequency_hz[order]
    y = np.array([row.value for row in rows])
    half = np.array([math.nan if row.u is None else K * row.u for row in rows])
    crowd = len(rows) > MAX_POINTS_WITH_BARS or not np.isfinite(half).any()
    series = [Series(x, y, "", MEASURED, "points", None if crowd else half)]
    ends = [np.array([getattr(row, end) for row in rows]) for end in ("low", "high")]
    for end in ends:
        limit = np.where(np.isfinite(end), end, np.nan)
        if np.isfinite(limit).any():
            series.append(Series(x, limit, "", Look(GREY, "dashed", 1.1)))
    values_shown = [y, *(line.y for line in series[1:])]
    if not crowd:
        values_shown += [y - half, y + half]
    label = f"Δ|S| / |S({plain(reference_hz(result), 5)} Hz)| / %"
    y_axis = axes.linear(label, np.concatenate(values_shown))
    panel = Panel(axes.frequency(x, "f / Hz"), y_axis, tuple(series), 1.9, rules=(0.0,))
    caption = say("text", "caption_deviation")
    return Figure("from-reference", TITLE, (Stack((panel,)),), "", caption)


def reference_hz(result: Result) -> float:
    """Return the reference frequency that a document prints, Hz."""
    value = reference_value(result)
    return math.nan if value is None else float(value.nominal)
