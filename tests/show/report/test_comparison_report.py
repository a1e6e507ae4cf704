"""Several results: differences, E_n and drift, in each form of the report."""

import datetime
import io
import math
import re
from dataclasses import replace

import numpy as np
import pypdf
import pytest
from tests.support.printed import NUMBER, assert_rounded, later, typed
from tests.support.sample_results import pickup, table2, table_only

from vibrident.base.amounts import UnitScale
from vibrident.base.errors import InputError
from vibrident.show import report
from vibrident.show.comparison import ComparedQuantity, Value, comparison_tables, difference, quantities
from vibrident.show.history import date_of, drift_table, histories
from vibrident.use.comparison import normalized_error, not_comparable, shared_sources

FACTORS = (1.0, 1.0012, 1.0031, 0.9990)
DATES = ("2021-03-01", "2022-04-11", "2023-03-02", "2025-03-31")
NAMES = ("a", "b", "c", "d")


@pytest.fixture(scope="module")
def results():
    return [later(i + 1, factor, date) for i, (factor, date) in enumerate(zip(FACTORS, DATES, strict=True))]


def test_normalized_error_of_a_known_case():
    assert normalized_error(10.3, 0.3, 10.0, 0.4) == pytest.approx(0.6)
    assert normalized_error(10.0, 0.4, 10.3, 0.3) == pytest.approx(-0.6)
    assert normalized_error(1.0, 0.0, 1.0, 0.0) is None


def test_a_gain_that_depends_on_frequency_is_shared_as_it_is_at_each():
    """The row of the budget holds the largest; with that, the difference of two equal sensors had U² < 0 and no E_n."""
    made = table2()
    f, size = made.measured.frequency_hz, made.measured.magnitude
    relative = np.linspace(0.001, 0.003, len(f))
    gain = {"source": "gain", "type": "B", "magnitude": list(relative * size), "phase_deg": [0.0] * len(f)}
    row = {"source": "gain", "kind": "gain", "standard_uncertainty": 0.003, "contributions": {}}
    points = {"frequency_hz": list(f), "sources": [gain]}
    made = replace(made, settings={**made.settings, "uncertainty_budget": [row], "point_budget": points})
    for i in (0, 7, len(f) - 1):
        (u,) = shared_sources(made, sensitivity=(f[i], 2.0)).values()
        assert u == pytest.approx(2.0 * relative[i])


def test_normalized_error_of_independent_noise_is_below_one_as_often_as_the_coverage_says():
    rng = np.random.default_rng(3)
    u = np.array([0.3, 0.8])
    pairs = rng.normal(size=(20_000, 2)) * u
    inside = np.mean([abs(normalized_error(a, 2 * u[0], b, 2 * u[1])) <= 1 for a, b in pairs])
    assert inside == pytest.approx(math.erf(math.sqrt(2)), abs=4 * math.sqrt(0.95 * 0.05 / 20_000))


def test_every_number_beside_each_other_is_the_results(results):
    (_, subjects), (_, table), *others = comparison_tables(results, NAMES)
    assert subjects.header == ("", *NAMES)
    lines = iter(table.rows)
    first = results[0]
    seen = []
    for row in lines:
        quantity, unit, _, *values = row
        differences, en = next(lines)[3:], next(lines)[3:]
        seen.append(quantity)
        if quantity != "sensitivity":
            continue
        assert unit == "mV/(m/s²)"
        base = first.parameters["sensitivity"]
        for i, result in enumerate(results):
            parameter = result.parameters["sensitivity"]
            value, u = re.fullmatch(rf"({NUMBER}) ± ({NUMBER})", values[i]).groups()
            assert_rounded(value, parameter.value, 1e3)
            assert_rounded(u, 2 * parameter.standard_uncertainty, 1e3)
            if i:
                assert_rounded(differences[i].removesuffix(" %"), 100 * (parameter.value / base.value - 1))
                spread = math.hypot(2 * parameter.standard_uncertainty, 2 * base.standard_uncertainty)
                assert_rounded(en[i], (parameter.value - base.value) / spread)
    assert seen[:3] == ["|S| at 160 Hz", "sensitivity", "natural frequency"]
    assert [title for title, _ in comparison_tables(results, NAMES)[2:]] == [
        f"Sensitivity of {name} beside a" for name in "bcd"
    ]
    nominal = others[0][1]
    assert len(nominal.rows) == 21
    assert {row[5] for row in nominal.rows} == {"+0.12 %"}


def test_many_results_share_tables_with_the_first(results):
    many = [*results, *results]
    titles = [title for title, _ in comparison_tables(many, "abcdefgh")]
    assert "Parameters (a, b, c, d, e)" in titles
    assert "Parameters (a, f, g, h)" in titles


def test_no_error_number_where_it_would_mislead(results):
    assert not_comparable(results[0], results[1]) == ""
    assert not_comparable(results[0], replace(results[0], estimator="lsm")) == "same data"
    other = later(9, 1.0, "2025-01-01", serial="4712")
    assert not_comparable(results[0], other) == "another sensor"
    _, (_, table), *_ = comparison_tables([results[0], other], NAMES[:2])
    assert {row[4] for row in table.rows if row[2] == "E_n"} == {"another sensor"}


def test_results_of_different_quantities_share_what_they_can():
    found = quantities([table2(), pickup()])
    assert [quantity.label for quantity in found] == ["natural frequency", "damping ratio", "natural angular frequency"]
    titles = [title for title, _ in comparison_tables([table2(), pickup()], ("one", "two"))]
    assert titles == ["What is compared", "Parameters"]


def test_the_drift_of_one_sensor(results):
    shuffled = [results[2], results[0], results[3], results[1]]
    (history,) = histories(shuffled, ("c", "a", "d", "b"))
    assert [date.isoformat() for date in history.dates] == list(DATES)
    assert not history.evaluated
    rows = drift_table(history).rows[:4]
    assert [row[2] for row in rows] == list(DATES)
    assert rows[0][5:] == ("", "", "")
    u = [result.response.magnitude_uncertainty[0] for result in results]
    assert len(set(u)) == 1
    for i in range(1, 4):
        assert_rounded(rows[i][5].removesuffix(" %"), 100 * (FACTORS[i] - 1))
        assert float(typed(rows[i][6])) == pytest.approx((FACTORS[i] - 1) * 110.06 / math.hypot(0.227, 0.227), abs=0.02)
        assert float(typed(rows[i][7])) == pytest.approx(
            (FACTORS[i] - FACTORS[i - 1]) * 110.06 / math.hypot(0.227, 0.227), abs=0.02
        )


def test_a_date_that_is_not_stated_is_that_of_the_evaluation_and_it_is_said(results):
    undated = replace(results[1], certificate={})
    assert date_of(undated) == datetime.date(2025, 1, 1)
    (history,) = histories([results[0], undated], NAMES[:2])
    assert history.evaluated
    assert "that of the evaluation" in drift_table(history).notes[-1]
    assert date_of(replace(undated, provenance={})) is None


def test_no_history_of_one_date_or_without_a_serial_number(results):
    assert histories([results[0], replace(results[1], certificate=results[0].certificate)], NAMES[:2]) == ()
    nameless = [replace(result, sensor={"type": "x"}) for result in results]
    assert histories(nameless, NAMES) == ()
    two = [*results[:2], later(8, 1.0, DATES[0], "B"), later(9, 1.0, DATES[1], "B")]
    assert len(histories(two, NAMES)) == 2


@pytest.mark.parametrize("form", ["html", "md", "pdf"])
def test_each_form_holds_the_same_numbers(results, form):
    made = report.content(results, form, NAMES)
    if form == "pdf":
        text = " ".join(page.extract_text() for page in pypdf.PdfReader(io.BytesIO(made)).pages)
    else:
        text = re.sub(r"<script.*?</script>", "", made.decode(), flags=re.DOTALL)
    text = " ".join(text.replace("|", " ").split())
    for date in DATES:
        assert date in text
    (history,) = histories(results, NAMES)
    for row in drift_table(history).rows:
        assert row[3] in text
        assert row[6] in text
    assert "Drift of Brüel MSV 3000 no. 4711" in text


@pytest.mark.parametrize("form", ["html", "md", "pdf"])
def test_results_with_nothing_in_common(form):
    made = report.content([table_only(), pickup()], form)
    assert made


def test_files_have_names_of_their_own(results, tmp_path):
    assert report.write(results[0], "html", tmp_path / "one").name == "report.html"
    assert report.write(results[0], "pdf", tmp_path / "one").name == "certificate.pdf"
    assert report.write(results[:2], "pdf", tmp_path / "two").name == "comparison.pdf"
    assert report.write(results[:2], "md", tmp_path / "two.md").read_text().startswith("# Comparison of 2")
    assert report.write(results[:1], "html", tmp_path / "deep" / "er" / "x.html").is_file()
    with pytest.raises(InputError, match=r"html \| pdf \| md"):
        report.write(results[0], "docx", tmp_path)


def test_differences_stand_to_the_place_of_their_uncertainty():
    row = ComparedQuantity("", UnitScale(1.0, "V"), (), relative=True)
    assert difference(Value(100.002, 0.002), Value(100.0, 0.002), row) == "+0.0020 %"  # U of it is 0.0057 %
    assert difference(Value(99.9996, 0.002), Value(100.0, 0.002), row) == "−0.0004 %"
    assert difference(Value(-101.0, None), Value(-100.0, None), row) == "+1.0 %"
    phase = ComparedQuantity("", UnitScale(1.0, "°"), (), relative=False)
    assert difference(Value(-1.1e-5, 2e-6), Value(0.0, 2e-6), phase) == "−0.0000110"
