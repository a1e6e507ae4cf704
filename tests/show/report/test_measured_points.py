"""Points with noise and systematic effects apart, uncertainties not stated, the k that covers, cubic springs."""

from __future__ import annotations

import io
from dataclasses import replace

import pytest
from rich.console import Console
from tests.support.sample_results import table2

from vibrident.show import certificate, certificate_tables, tables, terminal
from vibrident.show.report import content
from vibrident.show.residual_tests import residual_tests


def apart(gain=3e-3):
    """U of a declared gain on top of the noise of every point; the deviations keep the noise's."""
    result = table2()
    measured = result.measured
    size = measured.magnitude
    noise = tuple(1e-5 * m for m in size)
    return replace(
        result,
        measured=replace(
            measured,
            magnitude_uncertainty=tuple((n**2 + (gain * m) ** 2) ** 0.5 for n, m in zip(noise, size, strict=True)),
            magnitude_noise=noise,
            phase_deg_noise=measured.phase_deg_uncertainty,
            deviation_percent=tuple(2e-3 for _ in size),
            deviation_uncertainty_percent=tuple(1e-3 for _ in size),
            deviation_phase_uncertainty_deg=measured.phase_deg_uncertainty,
        ),
    )


def column(table, name):
    return [row[table.header.index(name)] for row in table.rows]


def test_the_table_of_points_states_both_and_compares_with_the_deviations_own():
    table = tables.measured(apart())
    magnitude, whole, noise = ([float(cell) for cell in column(table, table.header[k])] for k in (2, 3, 4))
    assert table.header[4].startswith("noise")
    assert [u / m for u, m in zip(whole, magnitude, strict=True)] == pytest.approx([6e-3] * 21, rel=0.05)
    assert [u / m for u, m in zip(noise, magnitude, strict=True)] == pytest.approx([2e-5] * 21, rel=0.05)
    assert set(column(table, "E_n")) == {"+1.00"}
    assert "noise / (mV/(m/s²))" in content(apart(), "md").decode().replace("\\", "")


def test_a_result_without_the_newer_columns_shows_what_it_has():
    assert not [name for name in tables.measured(table2()).header if name.startswith(("noise", "E_n"))]


def test_patterns_are_not_tested_where_stated_effects_make_them():
    result = apart()
    assert any("runs" in row[0] for row in residual_tests(result).rows)
    measured = replace(result.measured, deviation_uncertainty_percent=tuple(1.0 for _ in result.measured.magnitude))
    named = [row[0] for row in residual_tests(replace(result, measured=measured)).rows]
    assert "magnitude: points within U" in named
    assert "magnitude: runs of one sign" not in named


def unstated():
    result = table2()
    delay = replace(result.parameters["delay"], standard_uncertainty=None, interval_95=(None, None), identifiable=False)
    return replace(result, parameters={**result.parameters, "delay": delay})


def shown(result, width=120):
    stream = io.StringIO()
    Console(file=stream, width=width).print(terminal.summary(result))
    return stream.getvalue()


def test_an_uncertainty_that_is_not_stated_is_said_in_words():
    result = unstated()
    assert "not identifiable, u not stated" in content(result, "md").decode()
    assert "not identifiable, u not stated" in content(result, "html").decode()
    assert "u not stated" in shown(result)
    assert any("u not stated" in row[-1] for row in certificate_tables.parameters(result).rows)
    assert "not stated" in " ".join(certificate.statements(result))
    assert "u not stated" not in content(table2(), "md").decode()


def test_the_k_that_covers_is_stated_where_it_is_not_two():
    few = {"coverage_factor": 3.182, "effective_degrees_of_freedom": 3.0}
    result = replace(table2(), settings={**table2().settings, **few})
    text = "k = 3.18 (Student's t with ν_eff = 3)"
    for said in (" ".join(tables.parameters(result).notes), " ".join(certificate.statements(result)), shown(result)):
        assert text in " ".join(said.split())
    assert "Student" not in shown(table2())


def test_the_sensitivity_of_a_cubic_sensor_is_that_of_small_signals():
    result = replace(table2(), model="accelerometer+cubic")
    assert "small signals" in content(result, "md").decode()
    assert "small signals" in content(result, "html").decode()
    assert any("small signals" in text for text in certificate.statements(result))
    assert not any("small signals" in text for text in certificate.statements(table2()))
