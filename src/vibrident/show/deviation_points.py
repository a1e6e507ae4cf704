"""Compare measured points with the reference value: deviation, limits, decision, picture."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from vibrident.base.amounts import UnitScale, scaled
from vibrident.data.records import STANDARD_GRAVITY
from vibrident.result import Result
from vibrident.show import axes
from vibrident.show.coverage import unstated
from vibrident.show.curves import column
from vibrident.show.language import ENGLISH, Translator
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
#: Decision on a requirement, None without one → key of its word in certificates.
VERDICT_KEYS = {None: "not_judged", True: "pass", False: "fail"}
_PER_ACCELERATION = ("/(m/s^2)", "/(m/s²)")


@dataclass(frozen=True)
class PointColumn:
    """A column of the table of measured points."""

    head: Column
    cell: Callable[[int], str]  # number of a point → its text


def deviation_columns(result: Result, translate: Translator = ENGLISH) -> list[PointColumn]:
    """Return the columns that compare each measured point with the reference value and its limits.

    Deviations need a reference value, limits and decisions need requirements.
    """
    columns = _per_gravity_columns(result, translate)
    points = judged_points(result)
    if not points:
        return columns
    for unit, text_of in (("%", _percent_text), ("dB", _decibel_text)):
        columns.append(_judged_column(translate("head", "deviation"), unit, points, text_of))
    if any(map(_has_limits, points.values())):
        verdicts = {met: translate("text", key) for met, key in VERDICT_KEYS.items()}
        columns += [
            _judged_column(translate("head", "limits"), "%", points, limits_text),
            PointColumn(
                Column(translate("head", "decision")),
                lambda i: verdicts[points[i].met] if _has_limits(points[i]) else "",
            ),
        ]
    return columns


def _judged_column(
    title: str,
    unit: str,
    points: Mapping[int, JudgedRequirement],
    text_of: Callable[[JudgedRequirement], str],
) -> PointColumn:
    return PointColumn(Column(title, "number", unit), lambda i: text_of(points[i]))


def judged_points(result: Result) -> dict[int, JudgedRequirement]:
    """Return the deviation of each measured point, by its index, and the decision on it.

    Empty without a reference value. A document that certifies nothing has no decisions.
    """
    reference = reference_value(result)
    if reference is None or not reference.magnitude:
        return {}
    measured_pair = reference.magnitude, reference.magnitude_uncertainty
    is_certified = "gain" not in unstated(result)
    indices = np.flatnonzero(np.isfinite(result.measured.magnitude)).tolist()
    rows = judge_points(result, reference.frequency_hz, measured_pair, limited=is_certified)
    return dict(zip(indices, rows, strict=True))


def _per_gravity_columns(result: Result, translate: Translator) -> list[PointColumn]:
    """Return the magnitude per standard gravity; nothing but for a sensitivity to acceleration."""
    unit = unit_of_sensitivity(result)
    suffix = next((suffix for suffix in _PER_ACCELERATION if unit.endswith(suffix)), None)
    magnitudes = result.measured.magnitude * STANDARD_GRAVITY
    if suffix is None or not np.isfinite(magnitudes).any():
        return []
    typical = float(np.nanmedian(np.abs(magnitudes)))
    scale: UnitScale = scaled(unit.removesuffix(suffix) + "/g", typical)
    uncertainties = column(result.measured, "magnitude_uncertainty") * STANDARD_GRAVITY

    def magnitude_text(i: int) -> str:
        u = float(uncertainties[i]) if np.isfinite(uncertainties[i]) else None
        return with_u(float(magnitudes[i]), u, scale.factor)[0]

    head = Column(translate("head", "magnitude"), "number", scale.unit)
    return [PointColumn(head, magnitude_text)]


def _has_limits(judged: JudgedRequirement) -> bool:
    return math.isfinite(judged.low) or math.isfinite(judged.high)


def _percent_text(judged: JudgedRequirement) -> str:
    return with_sign(rounded(judged.value, None if judged.u is None else K * judged.u)[0])


def _decibel_text(judged: JudgedRequirement) -> str:
    ratio = 1.0 + judged.value / 100.0
    if ratio <= 0.0:
        return NONE
    u = None if judged.u is None else K * _DECIBEL * judged.u / 100.0 / ratio
    return with_sign(rounded(_DECIBEL * math.log(ratio), u)[0])


def limits_text(judged: JudgedRequirement, factor: float = 1.0) -> str:
    """Return the limits of a requirement times ``factor``; empty without any."""
    if not _has_limits(judged):
        return ""
    low = plain(judged.low * factor)
    high = plain(judged.high * factor)
    if math.isinf(judged.low):
        return f"≤ {high}"
    if math.isinf(judged.high):
        return f"≥ {low}"
    return f"{low}\N{NO-BREAK SPACE}…\N{NO-BREAK SPACE}{high}"


def from_reference(result: Result, translate: Translator = ENGLISH) -> Figure | None:
    """Return the picture of the deviation from the reference value; None for a single point."""
    points = judged_points(result)
    if len(points) < 2:
        return None
    order = sorted(points, key=lambda i: float(result.measured.frequency_hz[i]))
    rows = [points[i] for i in order]
    x = result.measured.frequency_hz[order]
    y = np.array([row.value for row in rows])
    half = np.array([math.nan if row.u is None else K * row.u for row in rows])
    is_crowded = len(rows) > MAX_POINTS_WITH_BARS or not np.isfinite(half).any()
    series = [Series(x, y, "", MEASURED, "points", None if is_crowded else half)]
    for name in ("low", "high"):
        limits = np.array([getattr(row, name) for row in rows])
        limits[~np.isfinite(limits)] = np.nan
        if np.isfinite(limits).any():
            series.append(Series(x, limits, "", Look(GREY, "dashed", 1.1)))
    values_shown = [line.y for line in series]
    if not is_crowded:
        values_shown += [y - half, y + half]
    label = f"Δ|S| / |S({plain(reference_hz(result), 5)} Hz)| / %"
    y_axis = axes.linear(label, np.concatenate(values_shown))
    panel = Panel(axes.frequency(x, "f / Hz"), y_axis, tuple(series), 1.9, rules=(0.0,))
    caption = translate("text", "caption_deviation")
    return Figure("from-reference", TITLE, (Stack((panel,)),), "", caption)


def reference_hz(result: Result) -> float:
    """Return the reference frequency that a document prints, Hz."""
    value = reference_value(result)
    return math.nan if value is None else float(value.nominal)
