"""What the tests of single tables leave: every number of every form is the result's, rounded or times k."""

import re
from dataclasses import replace

import numpy as np
import pytest
from tests.support.printed import NUMBER, assert_rounded, factor_to
from tests.support.report_page import read
from tests.support.sample_results import accelerometer, pickup, table2

from vibrident.base.nominal import Nominal
from vibrident.physics.naming import parameter_name
from vibrident.result import Curve
from vibrident.show import certificate_tables, report, words
from vibrident.show.certified import raised_to_measured
from vibrident.show.points import sensitivity_at
from vibrident.show.tables import parameters


def cards(result):
    """Label, value, unit, U of each card at the head of the page."""
    page = report.content(result, "html").decode()
    pattern = r'<div class="card"><span>(.*?)</span><b>(.*?)</b><span>(.*?)</span></div>'
    for label, value, below in re.findall(pattern, page):
        number, unit = re.fullmatch(rf"({NUMBER})[  ]?(.*)", value).groups()
        yield label, number, unit, re.match(rf"U = ({NUMBER})", below).group(1)


@pytest.mark.parametrize("make", [table2, pickup])
def test_the_cards_state_the_estimated_parameters_and_the_reference_frequency(make):
    result = raised_to_measured(make())
    found = {label.lower(): rest for label, *rest in cards(result)}
    for name, parameter in result.parameters.items():
        if not parameter.derived:
            number, unit, expanded = found.pop(parameter_name(name).words)
            assert_rounded(number, parameter.value, factor_to(unit, parameter.unit))
            assert_rounded(expanded, 2 * parameter.standard_uncertainty, factor_to(unit, parameter.unit))
    stated = {label.lower(): text for label, text in certificate_tables.reference(result).rows[1:]}
    for label, (number, unit, expanded) in found.items():  # the rest is what the certificate says
        text = next(text for name, text in stated.items() if label.startswith(name))
        assert text.startswith(f"{number}{'' if unit == '' else ' '}{unit}, U = {expanded}") or unit == "°"
        assert re.match(NUMBER, text).group() == number
        assert re.search(rf"U = ({NUMBER})", text).group(1) == expanded
    assert found


def test_the_metrics_are_the_results():
    result = table2()
    rows = {row[0]: row for row in read(result).table("metric", "value", "unit")}
    for field, metric in words.METRICS.items():
        _, value, unit, _ = rows[metric.label]
        if not np.isfinite(getattr(result.fit, field)):  # of a table no power is known
            assert value == "–"
            continue
        power = metric.in_response_unit
        factor = factor_to(unit, result.response_unit) if power == 1 else 1.0
        assert_rounded(value, getattr(result.fit, field), factor)
        assert (unit == "1") == (power == 0)


def test_the_correlation_is_the_results():
    result = table2()
    rows = next(t[1:] for t in read(result).tables if t[0][0] == "" and t[0][1] == "S0")
    for row, numbers in zip(rows, result.correlation.matrix, strict=True):
        for text, number in zip(row[1:], numbers, strict=True):
            assert_rounded(text, number)


def test_the_nominal_frequencies_of_the_page_are_those_of_the_certificate():
    result = raised_to_measured(table2())
    table = certificate_tables.sensitivity(result)
    assert [tuple(row) for row in read(result).table(*table.header)] == list(table.rows)


def test_markdown_holds_every_cell_of_the_table():
    result = raised_to_measured(table2())
    table = parameters(result)
    markdown = report.content(result, "md").decode()
    for row in table.rows:
        line = next(line for line in markdown.splitlines() if line.startswith(f"| {row[0]}"))
        assert set(re.findall(NUMBER, " ".join(row[2:6]))) <= set(re.findall(NUMBER, line))


@pytest.mark.parametrize("frequency", [11.3, 444.0, 631.7])
def test_between_the_curves_points_the_uncertainty_is_that_of_the_neighbours(frequency):
    """A relative u that is the same everywhere is the same in between; so is a u of the phase."""
    f = np.geomspace(10, 1000, 40)
    s = accelerometer(f)
    curve = Curve(*(tuple(v) for v in (f, abs(s), np.rad2deg(np.angle(s)), 0.003 * abs(s), np.full(f.size, 0.02))))
    point = sensitivity_at(replace(table2(), response=curve), Nominal(frequency, frequency))
    assert point.magnitude_uncertainty == pytest.approx(0.003 * point.magnitude, rel=1e-9)
    assert point.phase_deg_uncertainty == pytest.approx(0.02, rel=1e-9)
