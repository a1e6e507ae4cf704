"""The HTML report: one file of at most 6 MB that asks for nothing, whose every number is the result's."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import plotly.graph_objects as go
import pytest
from plotly.offline import get_plotlyjs
from tests.support.printed import NUMBER, assert_rounded, factor_to, later
from tests.support.report_page import Reader, read
from tests.support.sample_results import SAMPLES, dense_points, excerpt, table2, troubled

from vibrident.base.errors import InputError
from vibrident.physics.naming import parameter_name
from vibrident.result import Fit
from vibrident.show import report, words
from vibrident.show.certified import raised_to_measured
from vibrident.show.media.charts import MAX_POINTS
from vibrident.show.numbers import frequency_text
from vibrident.show.residual_tests import residual_tests

LIMIT = 6_000_000
BASE = table2()


@cache
def sample_page(name: str) -> bytes:
    return report.content(SAMPLES[name](), "html")


@pytest.mark.parametrize("sample", SAMPLES)
def test_one_file_that_needs_nothing_from_outside(sample):
    page = sample_page(sample)
    assert len(page) <= LIMIT
    found = Reader(page.decode())
    assert found.open == []  # every tag is closed
    assert set(found.outside) <= {"data:,"}
    head = page[: page.index(b"</head>")].decode()
    assert "default-src 'none'" in head
    assert "connect-src 'none'" in head
    css = head[head.index("<style>") :]
    assert "url(" not in css
    assert "@import" not in css


def test_the_script_is_plotlys_own():
    page = report.content(table2(), "html").decode()
    assert get_plotlyjs()[:5000] in page
    assert get_plotlyjs()[-5000:].replace("</script", "<\\/script") in page


@pytest.mark.parametrize("sample", SAMPLES)
def test_every_figure_is_one_that_plotly_knows(sample):
    for figure in Reader(sample_page(sample).decode()).figures.values():
        for one in figure if isinstance(figure, list) else [figure]:
            go.Figure(one)  # refuses what is no property of a figure


def test_every_parameter_in_the_table_is_the_results():
    result = raised_to_measured(table2())
    rows = {row[0]: row for row in read(result).table("parameter", "symbol", "value")}
    for name, parameter in result.parameters.items():
        _, _, value, u, k, expanded, unit, interval, _ = rows[parameter_name(name).words]
        factor = factor_to("" if unit == "1" else unit, parameter.unit)
        assert_rounded(value, parameter.value, factor)
        assert_rounded(u, parameter.standard_uncertainty, factor)
        assert_rounded(expanded, 2 * parameter.standard_uncertainty, factor)
        assert k == "2"
        for text, limit in zip(interval.split(" … "), parameter.interval_95, strict=True):
            assert_rounded(text, limit, factor)


def test_every_measured_point_in_the_table_is_the_results():
    result = table2()
    measured = result.measured
    rows = read(result).table("frequency / Hz", "nominal / Hz")
    for i, row in enumerate(rows):
        frequency, _, magnitude, expanded, deviation, phase, phase_u, shift, record = row
        assert_rounded(frequency, measured.frequency_hz[i])
        assert_rounded(magnitude, measured.magnitude[i], 1e3)
        assert_rounded(expanded, 2 * measured.magnitude_uncertainty[i], 1e3)
        assert_rounded(deviation.removesuffix(" %"), measured.deviation_percent[i])
        assert_rounded(phase, measured.phase_deg[i])
        assert_rounded(phase_u, 2 * measured.phase_deg_uncertainty[i])
        assert_rounded(shift, measured.deviation_phase_deg[i])
        assert record == measured.record[i]
    assert len(rows) == len(measured.frequency_hz)


def test_what_is_drawn_is_the_results():
    result = raised_to_measured(table2())
    drawn = {(t.get("name"), t.get("yaxis")): t for t in read(result).figures["sensitivity"]["data"]}
    model, points = drawn["model", "y"], drawn["measured, U (k = 2)", "y"]
    np.testing.assert_allclose(model["x"], result.response.frequency_hz, rtol=1e-8)
    np.testing.assert_allclose(model["y"], np.multiply(result.response.magnitude, 1e3), rtol=1e-8)
    np.testing.assert_allclose(points["y"], np.multiply(result.measured.magnitude, 1e3), rtol=1e-8)
    bars = np.multiply(result.measured.magnitude_uncertainty, 2e3)
    np.testing.assert_allclose(points["error_y"]["array"], bars, rtol=1e-8)
    upper, lower = (t for t in read(result).figures["sensitivity"]["data"][:2])
    width = np.subtract(upper["y"], lower["y"]) / 2
    np.testing.assert_allclose(width, np.multiply(result.response.magnitude_uncertainty, 2e3), rtol=1e-4)
    phase = np.array(drawn["model", "y2"]["y"])
    np.testing.assert_allclose((phase - result.response.phase_deg + 180) % 360, 180, atol=1e-6)
    assert np.all(np.abs(np.diff(phase)) < 180)


def test_the_labels_of_the_points_state_value_and_uncertainty():
    result = table2()
    points = next(t for t in read(result).figures["sensitivity"]["data"] if str(t.get("name")).startswith("measured"))
    for i, label in enumerate(points["text"]):
        frequency, value, u = re.fullmatch(rf"({NUMBER}) Hz: ({NUMBER}) ± ({NUMBER}) mV/\(m/s²\)", label).groups()
        assert_rounded(frequency, result.measured.frequency_hz[i])
        assert_rounded(value, result.measured.magnitude[i], 1e3)
        assert_rounded(u, 2 * result.measured.magnitude_uncertainty[i], 1e3)


def test_a_choice_of_records_only_where_there_is_one():
    """The page's script looks for a choice wherever a list of figures stands."""
    for sample in SAMPLES:
        page = sample_page(sample).decode()
        chosen = page.count("<option>")
        lists = [f for f in Reader(page).figures.values() if isinstance(f, list)]
        assert chosen == sum(len(figures) for figures in lists)
        assert page.count("<select") == len(lists)


def test_crowds_are_thinned_and_it_is_said():
    page = read(dense_points())
    points = next(t for t in page.figures["deviation"]["data"] if str(t.get("name")).startswith("model −"))
    assert len(points["x"]) == MAX_POINTS
    assert f"{MAX_POINTS} of 4000 measured points are drawn" in "".join(page.words)


def test_the_largest_result_stays_below_the_limit():
    result = dense_points(6000)
    record = "a_rather_long_name_of_a_record_" * 3
    measured = replace(result.measured, record=tuple(f"{record}{i}" for i in range(6000)))
    first = excerpt("", np.arange(4000) / 51200, *np.random.default_rng(0).standard_normal((2, 4000)))
    signals = tuple(replace(first, record=f"{record}{i}") for i in range(300))
    files = [{"file": f"{record}{i}.csv", "sha256": f"{i:064x}", "history": ["x" * 200]} for i in range(1000)]
    result = replace(result, measured=measured, signals=signals, provenance={"files": files})
    assert len(report.content(result, "html")) <= LIMIT


def test_warnings_settings_and_budget_are_said():
    budget = [
        {"contribution": "reference", "u_percent": 0.1, "share": 0.4},
        {"contribution": "noise", "u_percent": 0.2, "share": 0.6},
    ]
    page = read(replace(troubled(), settings={"uncertainty_budget": budget, "deep": {"one": {"two": [1.5, None]}}}))
    text = " ".join("".join(page.words).split())
    for warning in troubled().warnings:
        assert warning.message in text
        explained = words.explain(warning.code)
        assert explained.meaning in text
        assert f"{explained.title[:1].upper()}{explained.title[1:]} ({warning.code})" in text
    assert page.table("contribution", "u percent", "share") == [["reference", "0.1", "0.4"], ["noise", "0.2", "0.6"]]
    assert "deep · one · two1.5, –" in text.replace(" deep", "deep")


def outcomes(deviation_in_u, chi2=1.0):
    """Outcome of each test of the magnitude for these deviations, in the order of frequency."""
    deviation_in_u = np.asarray(deviation_in_u, dtype=float)
    n = len(deviation_in_u)
    measured = replace(
        BASE.measured,
        frequency_hz=tuple(np.arange(1.0, n + 1)),
        magnitude=(2.0,) * n,
        magnitude_uncertainty=(0.02,) * n,
        deviation_percent=tuple(deviation_in_u),
        phase_deg=(None,) * n,
        phase_deg_uncertainty=(None,) * n,
        deviation_phase_deg=(None,) * n,
        record=("a",) * n,
    )
    fit = Fit(1.0, 1.0, 1.0, 1.0, 1.0, 1.0, chi2, 2 * n - 3, chi2 < 2)
    table = residual_tests(replace(BASE, measured=measured, fit=fit))
    return {row[0].removeprefix("magnitude: "): row[3] for row in table.rows}


def test_residual_tests_see_what_they_are_for():
    rng = np.random.default_rng(0)
    noise = rng.normal(size=40)
    assert set(outcomes(noise).values()) == {"passed"}
    assert outcomes(noise, chi2=3.0)["χ²/ν of all points"] == "failed"
    spike = noise.copy()
    spike[7] = 6.0
    assert outcomes(spike)["largest deviation"] == "failed"
    trend = outcomes(np.linspace(-1.5, 1.5, 40) + 0.1 * noise)
    assert (trend["runs of one sign"], trend["correlation of neighbours"]) == ("failed", "failed")
    assert trend["largest deviation"] == "passed"
    assert outcomes(2.5 * noise)["points within U"] == "failed"
    assert list(outcomes(noise[:7])) == ["χ²/ν of all points"]


def test_residual_tests_fail_of_noise_as_rarely_as_they_say():
    rng = np.random.default_rng(1)
    failed = {}
    for _ in range(400):
        for name, outcome in outcomes(rng.normal(size=60)).items():
            failed[name] = failed.get(name, 0) + (outcome == "failed")
    assert max(failed.values()) <= 13  # 4 expected of 400; more with probability 1e-4


def test_several_results_in_one_page():
    results = [later(1, 1.0, "2021-03-01"), later(2, 1.001, "2023-03-01"), later(3, 1.01, "2025-03-01")]
    page = report.content(results, "html", ["a", "b", "c"])
    assert len(page) <= LIMIT
    found = Reader(page.decode())
    assert found.open == []
    for figure in found.figures.values():
        go.Figure(figure)
    change = found.figures["drift1"]["data"][0]
    assert change["x"] == ["2021-03-01", "2023-03-01", "2025-03-01"]
    np.testing.assert_allclose(change["y"], [0.0, 0.1, 1.0], atol=1e-6)
    drawn = {axis: [t for t in found.figures["curves"]["data"] if t["yaxis"] == axis] for axis in ("y2", "y3", "y4")}
    np.testing.assert_allclose(drawn["y3"][2]["y"], 1.0, atol=1e-6)
    turned = np.subtract(drawn["y2"][2]["y"], results[2].response.phase_deg)
    np.testing.assert_allclose((turned + 180.0) % 360.0, 180.0, atol=1e-6)
    np.testing.assert_allclose(drawn["y4"][2]["y"], 0.0, atol=1e-6)


def test_without_plotly_the_remedy_is_named(monkeypatch):
    from vibrident.show.media import html

    html._plotly.cache_clear()
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(InputError, match=r"vibrident\[report\]"):
        report.content(table2(), "html")
    html._plotly.cache_clear()


def test_the_budget_states_what_each_source_adds():
    result = table2()
    parts = {"natural_frequency": 0.0123456, "sensitivity": 3.456e-6}
    rows = [
        {
            "source": "noise",
            "type": "A",
            "kind": "data",
            "standard_uncertainty": None,
            "unit": "",
            "contributions": parts,
        },
        {
            "source": "amplifier",
            "type": "B",
            "kind": "gain",
            "standard_uncertainty": 0.001,
            "unit": "1",
            "degrees_of_freedom": 50.0,
            "contributions": {"sensitivity": 1.02e-4, "natural_frequency": 0.0},
        },
    ]
    result = replace(result, settings={"uncertainty_budget": rows})
    page, shown = read(result), raised_to_measured(result)
    table = next(t for t in page.tables if t[0][:4] == ["source", "type", "kind", "u"])
    columns = {head.split(" / ")[0]: j for j, head in enumerate(table[0])}
    assert [row[:5] for row in table[1:3]] == [
        ["noise", "A", "data", "–", "–"],
        ["amplifier", "B", "gain", "0.001", "50"],
    ]
    for name in parts:
        parameter, j = shown.parameters[name], columns[parameter_name(name).words]
        unit = table[0][j].split(" / ")[1]
        factor = factor_to(unit.removeprefix("(").removesuffix(")") if unit.startswith("(") else unit, parameter.unit)
        for row, text in zip(rows, (table[1][j], table[2][j]), strict=True):
            assert_rounded(text, row["contributions"][name], factor)
        assert_rounded(table[-1][j], parameter.standard_uncertainty, factor)


def test_a_record_named_by_its_frequency_is_named_once():
    result = table2()
    old = result.signals[0].record
    frequency = result.measured.frequency_hz[result.measured.record.index(old)]
    name = frequency_text(frequency)
    records = tuple(name if record == old else record for record in result.measured.record)
    measured = replace(result.measured, record=records)
    signals = (replace(result.signals[0], record=name), *result.signals[1:])
    page = report.content(replace(result, measured=measured, signals=signals), "html").decode()
    assert f"<option>{name}</option>" in page
    assert f"{name}, {name}" not in page
