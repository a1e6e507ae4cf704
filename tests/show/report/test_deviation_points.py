"""Each measured point beside the reference value: deviation, limits and decision, on page 1."""

from __future__ import annotations

import io
import math
from dataclasses import replace

import numpy as np
import pypdf
import pytest
from tests.support.printed import CERTIFICATE, assert_rounded, typed
from tests.support.sample_results import dense_points, pickup, table2

from vibrident.data.records import STANDARD_GRAVITY
from vibrident.result import Result
from vibrident.show import certificate_tables, report
from vibrident.show.deviation_points import from_reference, judged_points
from vibrident.show.points import reference_value
from vibrident.use.conformity import judge_requirements

LIMITS = [
    {"quantity": "sensitivity_deviation", "low": -5.2, "high": 8.0, "to_hz": 250.0},
    {"quantity": "sensitivity_deviation", "low": -9.0, "high": 1.0, "from_hz": 100.0, "to_hz": 500.0},
    {"quantity": "natural_frequency", "low": 1.0},
]


def stated(result: Result, covers=("noise", "gain", "phase"), **more) -> Result:
    return replace(result, certificate={**CERTIFICATE, **more}, uncertainty={"covers": [*covers]})


def cells(result: Result) -> dict[str, list[str]]:
    table = certificate_tables.measured(result)
    return {str(head): [row[j] for row in table.rows] for j, head in enumerate(table.header)}


def test_each_line_states_its_deviation_in_percent_and_decibels_and_the_value_per_g():
    result = stated(table2())
    found, points, value = cells(result), result.measured, reference_value(result)
    for i, (percent, decibel, per_g) in enumerate(
        zip(found["deviation / %"], found["deviation / dB"], found["magnitude / (V/g)"], strict=True)
    ):
        ratio = points.magnitude[i] / value.magnitude
        assert_rounded(percent, 100.0 * (ratio - 1.0))
        assert_rounded(decibel, 20.0 * math.log10(ratio))
        assert_rounded(per_g, points.magnitude[i] * STANDARD_GRAVITY)


def test_the_narrowest_limits_hold_and_each_line_says_whether_it_meets_them():
    result = stated(table2(), requirements=LIMITS)
    found = cells(result)
    for f, limits, decision, percent in zip(
        found["f / Hz"],
        found["limits / %"],
        found["decision"],
        found["deviation / %"],
        strict=True,
    ):
        here = [one for one in LIMITS[:2] if one.get("from_hz", 0.0) <= float(f) <= one["to_hz"]]
        if not here:
            assert (limits, decision) == ("", "")
            continue
        low = max(one["low"] for one in here)
        high = min(one["high"] for one in here)
        assert [float(typed(end)) for end in limits.split("…")] == [low, high]
        assert decision == ("met" if low <= float(typed(percent)) <= high else "not met")
    assert {"met", "not met", ""} == set(found["decision"])


@pytest.mark.parametrize("rule", ["simple", "guarded"])
def test_a_requirement_is_met_where_each_line_meets_it(rule):
    """The table and the statement of conformity are of one mind."""
    for reach in np.linspace(0.5, 12.0, 24):
        limit = {"quantity": "sensitivity_deviation", "low": -reach, "high": reach, "to_hz": 230.0}
        result = stated(table2(), requirements=[limit], decision_rule=rule)
        value = reference_value(result)
        (whole,) = judge_requirements(result, value.frequency_hz, (value.magnitude, value.magnitude_uncertainty))
        lines = [row.met for row in judged_points(result).values() if math.isfinite(row.low)]
        assert whole.met is all(lines)


def test_a_report_that_certifies_nothing_has_no_limits():
    result = stated(table2(), covers=("noise",), requirements=LIMITS)
    found = cells(result)
    assert "deviation / %" in found
    assert "decision" not in found
    assert "limits / %" not in found


def test_a_velocity_pickup_has_no_value_per_g():
    found = cells(stated(pickup()))
    assert not [head for head in found if head.endswith("/g)")]
    assert "deviation / %" in found


def test_every_point_of_a_thinned_table_is_its_own():
    result = stated(dense_points(450))
    found, value = cells(result), reference_value(result)
    for f, percent in zip(found["f / Hz"], found["deviation / %"], strict=True):
        i = int(np.argmin(np.abs(result.measured.frequency_hz - float(f))))
        assert_rounded(percent, 100.0 * (result.measured.magnitude[i] / value.magnitude - 1.0))


def test_the_picture_shows_points_and_limits():
    (panel,) = from_reference(stated(table2(), requirements=LIMITS)).stacks[0].panels
    points, low, high = panel.series
    assert np.nanmin(low.y) == -9.0
    assert np.nanmax(high.y) == 8.0
    assert points.y.size == 21
    (panel,) = from_reference(stated(table2())).stacks[0].panels
    assert len(panel.series) == 1


@pytest.mark.needs("report")
def test_the_points_are_on_page_1_and_in_the_report():
    result = stated(table2(), requirements=LIMITS)
    first = pypdf.PdfReader(io.BytesIO(report.content(result, "pdf"))).pages[0].extract_text()
    found = cells(result)
    for percent in found["deviation / %"]:
        assert percent in first
    assert "Deviation from the value at the reference frequency" in report.render(result)
