"""``vibrident history`` as users meet it: what it prints, writes and refuses."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest
from tests.support.lives import at_reference, calibrated
from tests.support.printed import typed
from tests.support.shell import printed, run

from vibrident.base.nominal import Nominal
from vibrident.lab.history.tables import _percent
from vibrident.result import Result
from vibrident.show.history import drift_table, histories
from vibrident.show.points import sensitivity_at
from vibrident.show.report import content


@pytest.fixture(scope="module")
def lived(tmp_path_factory):
    """A store with a sensor that drifts and was repaired, and the results as files."""
    folder = tmp_path_factory.mktemp("lived")
    rng = np.random.default_rng(7)
    bias = 1 + 0.005 * rng.normal()
    results = []
    for i in range(8):
        step = 0.02 if i > 4 else 0.0
        value = 0.1 * (bias + 0.0005 * i + step + 0.001 * rng.normal())
        results.append(calibrated(value, f"{2010 + i}-03-01", data=str(i)))
        results[-1].save(folder / f"result{i}.json")
    calibrated(0.05, "2020-01-01", serial="12", data="other").save(folder / "other.json")
    return folder, results


@pytest.fixture(scope="module")
def store(lived):
    folder, _ = lived
    url = str(folder / "h.db")
    files = sorted(str(file) for file in folder.glob("*.json"))
    assert run("history", "add", *files, "--store", url).exit_code == 0
    repaired = ("--kind", "repaired", "--date", "2014-06-01", "--note", "new [cable]")
    assert run("history", "event", "4711", *repaired, "--store", url).exit_code == 0
    return url


def test_show_gives_every_calibration_with_both_en_drift_and_prediction(lived, store):
    _, results = lived
    document = json.loads(printed("history", "show", "4711", "--store", store, "--format", "json", "--tolerance", "2%"))
    rows = document["calibrations"]
    assert [row["value"] for row in rows] == pytest.approx([at_reference(result) for result in results])
    assert [row["series"] for row in rows] == [1] * 5 + [2] * 3
    for before, row in itertools.pairwise(rows):
        difference = row["value"] - before["value"]
        own = 2 * np.hypot(before["u_own"], row["u_own"])
        shared = [next(iter(r["shared"].values())) for r in (before, row)]
        exact = np.hypot(own, 2 * (shared[1] - shared[0]))
        assert row["en"]["correlated"] == pytest.approx(difference / exact, rel=1e-6)
        assert row["en"]["ordinary"] == pytest.approx(difference / np.hypot(before["U"], row["U"]))
    drift = document["drift"]
    assert sum(drift["probability"].values()) == pytest.approx(1.0)
    assert drift["prediction"]["reading"]["u"] < drift["prediction"]["u"]  # the reference's error is in both readings
    assert document["due"]["limits"][1] == pytest.approx(1.02 * rows[-1]["value"])
    text = printed("history", "show", "4711", "--store", store)
    for part in ("●", "ordinary E_n", "Series 2 begins on 2015-03-01", "random walk", "EWMA", "new [cable]"):
        assert part in text


def test_a_report_of_the_results_states_the_same_en(lived, store):
    _, results = lived
    document = json.loads(printed("history", "show", "4711", "--store", store, "--format", "json"))
    (told,) = histories(results, [str(i) for i in range(len(results))])
    rows = drift_table(told).rows[: len(results)]
    assert rows[0][0] == "|S| at 160 Hz"
    en = [row["en"]["correlated"] for row in document["calibrations"][1:]]
    assert [float(typed(row[-1])) for row in rows[1:]] == pytest.approx(en, abs=0.0051)


def test_a_report_holds_the_history_of_its_sensor(lived, store, tmp_path):
    folder, _ = lived
    for form in ("html", "md"):
        printed("report", str(folder / "result3.json"), "--store", store, "--format", form, "--out", str(tmp_path))
        text = (tmp_path / f"report.{form}").read_text(encoding="utf-8")
        assert "History of the sensitivity at 160 Hz" in text
        assert "2017-03-01" in text
    refused = run("report", str(folder / "result3.json"), "--store", store, "--format", "pdf")
    assert refused.exit_code == 2


def instruments(certificate):
    return {
        "laboratory": "L",
        "instruments": [{"name": "vibrometer", "serial_number": "7", "certificate": certificate}],
    }


@pytest.mark.parametrize(
    ("told", "printed_en", "assumed"),
    [
        (lambda year: {}, "+2.47 or +0.", True),
        (lambda year: instruments("PTB 1"), "+2.47 ", False),
        (lambda year: instruments(f"PTB {year}"), "+0.", False),
        (lambda year: {"instruments": ["vibrometer"]}, "+2.47 or +0.", True),
    ],
)
def test_what_no_instrument_says_is_assumed_and_said(tmp_path, told, printed_en, assumed):
    """A change of 0.7 % under a reference of 0.5 %: it is one only if the reference is the same."""
    values = {2020: 0.1, 2021: 0.1, 2022: 0.1007}
    url = str(tmp_path / "h.db")
    made = [
        calibrated(value, f"{year}-01-01", data=str(year), certificate=told(year)) for year, value in values.items()
    ]
    files = [each.save(tmp_path / f"{number}.json") for number, each in enumerate(made)]
    printed("history", "add", *files, "--store", url)
    text = printed("history", "show", "4711", "--store", url)
    for said in (text, content(made, "md").decode()):
        words = " ".join(said.split())
        assert ("Assumed to be the same each time" in words) is assumed
        assert printed_en in words
    assert ("if not the same: calibration of the reference" in text) is assumed  # an alarm of the EWMA only if it is


def test_the_soonest_comes_first_by_risk_or_interval(tmp_path):
    url = str(tmp_path / "h.db")
    lives = {"short": ("2020-01-01", "2020-07-01"), "long": ("2018-01-01", "2020-01-01"), "gone": ("2010-01-01",)}
    for serial, dates in lives.items():
        for date in dates:
            file = calibrated(date=date, serial=serial, data=serial + date).save(tmp_path / "r.json")
            printed("history", "add", file, "--store", url)
    printed("history", "event", "gone", "--kind", "recalled", "--date", "2011-01-01", "--store", url)
    rows = json.loads(printed("history", "due", "--tolerance", "50%", "--store", url, "--format", "json"))
    assert [row["serial_number"] for row in rows] == ["short", "long", "gone"]
    first = [min(filter(None, (row["date"], row["by_interval"]))) for row in rows[:2]]
    assert first == sorted(first)


def test_the_history_takes_date_number_and_approver_from_the_certificate(tmp_path):
    url, stated = str(tmp_path / "h.db"), tmp_path / "certificate.toml"
    stated.write_text('[certificate]\nnumber = "2026-7"\ndate_of_calibration = 2026-03-01\napproved_by = "B. Head"\n')
    file = calibrated(date=None, data="a").save(tmp_path / "r.json")
    printed("history", "add", file, "--certificate", stated, "--store", url)
    printed("history", "approve", "1", "--store", url)
    document = json.loads(printed("history", "show", "4711", "--store", url, "--format", "json"))
    (row,) = document["calibrations"]
    assert (row["date"], row["date_stated"], row["certificate_number"]) == ("2026-03-01", True, "2026-7")
    assert [event["by"] for event in document["events"] if event["kind"] == "approved"] == ["B. Head"]


def test_a_parameter_has_a_history_too(store):
    document = json.loads(
        printed("history", "show", "4711", "--store", store, "--format", "json", "--quantity", "natural_frequency")
    )
    assert document["quantity"]["unit"] == "Hz"
    assert {row["value"] for row in document["calibrations"]} == {5000.0}
    refused = run("history", "show", "4711", "--store", store, "--quantity", "delay")
    assert refused.exit_code == 2
    assert "natural_frequency" in refused.output


def test_the_sensitivity_at_another_frequency_has_a_history_too(lived, store):
    _, results = lived
    asked = ("history", "show", "4711", "--store", store, "--format", "json")
    document = json.loads(printed(*asked, "--frequency", "315"))
    expected = [sensitivity_at(result, Nominal(315.0, 10**2.5)).magnitude for result in results]
    rows = document["calibrations"]
    assert [row["value"] for row in rows] == pytest.approx(expected)
    assert next(iter(rows[0]["shared"].values())) == pytest.approx(0.005 * expected[0], rel=1e-6)
    reference = json.loads(printed(*asked))["calibrations"]
    assert rows[2]["en"]["correlated"] == pytest.approx(reference[2]["en"]["correlated"], rel=1e-3)
    refused = run(*asked, "--frequency", "777")
    assert refused.exit_code == 2
    assert "315" in refused.output
    assert run(*asked, "--frequency", "315", "--quantity", "sensitivity").exit_code == 2


def test_list_and_due_of_all_sensors(store):
    rows = json.loads(printed("history", "list", "--store", store, "--format", "json"))
    assert [(row["serial_number"], row["calibrations"]) for row in rows] == [("12", 1), ("4711", 8)]
    rows = json.loads(printed("history", "due", "--tolerance", "1%", "--store", store, "--format", "json"))
    assert {row["serial_number"] for row in rows} == {"12", "4711"}
    assert rows[0]["by_interval"] or rows[0]["date"]
    assert "no drift" in printed("history", "due", "12", "--tolerance", "0.01", "--store", store)
    assert "soonest" in printed("history", "due", "--tolerance", "1%", "--store", store)
    refused = run("history", "due", "--store", store)
    assert refused.exit_code == 2
    assert "--tolerance" in refused.output


def test_tolerances_may_differ_by_type(store, tmp_path):
    limits = tmp_path / "limits.toml"
    entry = '[[limits]]\ntype = "{}"\nparameter = "sensitivity"\nnominal = 0.1\ntolerance_percent = 5\n'
    limits.write_text(entry.format("type A"))
    asked = ("history", "due", "--limits", str(limits), "--store", store)
    rows = json.loads(printed(*asked, "--format", "json"))
    assert [row["limits"] for row in rows] == [pytest.approx([0.095, 0.105])] * 2
    assert "by type" in printed(*asked)
    limits.write_text(entry.format("type B"))
    rows = json.loads(printed(*asked, "--format", "json"))
    assert {row["why"] for row in rows} == {"no tolerance for its type"}
    assert "no tolerance" in printed(*asked)
    assert run(*asked, "--tolerance", "1%").exit_code == 2


def test_what_was_approved_counts_and_other_evaluations_of_its_data_are_superseded(tmp_path):
    url = str(tmp_path / "h.db")
    for i, value in enumerate((0.1, 0.101)):
        calibrated(value, data="the same").save(tmp_path / f"{i}.json")
    printed("history", "add", str(tmp_path / "0.json"), str(tmp_path / "1.json"), "--store", url)

    def counting():
        rows = json.loads(printed("history", "show", "4711", "--store", url, "--format", "json"))["calibrations"]
        return {row["id"]: (row["counts"], row["standing"]) for row in rows}

    assert counting() == {1: (False, "added"), 2: (True, "added")}  # the newer evaluation
    assert "2, of the same data, is superseded" in printed("history", "approve", "1", "--store", url)
    assert counting() == {1: (True, "approved"), 2: (False, "superseded")}
    printed("history", "event", "4711", "--kind", "recalled", "--calibration", "1", "--store", url)
    assert counting() == {1: (False, "recalled"), 2: (False, "superseded")}
    assert run("history", "approve", "1", "--store", url).exit_code == 2
    assert run("history", "approve", "77", "--store", url).exit_code == 2


def test_a_stored_result_comes_back_and_a_table_goes_out(lived, store, tmp_path):
    _, results = lived
    number = json.loads(printed("history", "show", "4711", "--store", store, "--format", "json"))["calibrations"][2][
        "id"
    ]
    printed("history", "result", str(number), "--store", store, "--out", str(tmp_path / "back.json"))
    assert Result.load(tmp_path / "back.json") == results[2]
    parquet = pytest.importorskip("pyarrow.parquet")
    printed("history", "export", str(tmp_path / "all.parquet"), "--store", store)
    table = parquet.read_table(tmp_path / "all.parquet").to_pylist()
    assert len(table) == 9
    of_one = [row for row in table if row["serial_number"] == "4711"]
    assert [row["reference_sensitivity"] for row in of_one] == pytest.approx([at_reference(r) for r in results])
    assert of_one[0]["sensitivity_u"] == pytest.approx(results[0].parameters["sensitivity"].standard_uncertainty)
    printed("history", "export", str(tmp_path / "all.csv"), "--store", store)
    assert len((tmp_path / "all.csv").read_text().splitlines()) == 10


def test_the_page_and_the_picture_show_the_history(store, tmp_path):
    pytest.importorskip("plotly")
    page, picture = tmp_path / "h.html", tmp_path / "h.svg"
    for file in (page, picture):
        printed("history", "show", "4711", "--store", store, "--tolerance", "2%", "--out", str(file))
    text = page.read_text(encoding="utf-8")
    figures = json.loads(text.split('id="figures">')[1].split("</script>")[0])
    assert set(figures) == {"values", "control"}
    assert "new [cable]" in text
    assert ElementTree.parse(picture).getroot().tag.endswith("svg")
    assert run("history", "show", "4711", "--store", store, "--out", str(tmp_path / "h.txt")).exit_code == 2


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("show", "47"), "4711"),
        (("show", "4711", "--at", "soon"), "2025-03-31"),
        (("show", "4711", "--at", "2011-01-01"), "before the last"),
        (("show", "4711", "--tolerance", "wide"), "1%"),
        (("show", "4711", "--interval", "-1"), "a number from 0.001 to 1000"),
        (("show", "4711", "--tolerance", "1%", "--nominal", "0"), "cannot be 0"),
        (("event", "4711", "--kind", "painted"), "repaired"),
        (("event", "4711", "--kind", "superseded"), "--calibration"),
        (("event", "4711", "--kind", "recalled", "--calibration", "99"), "no such calibration"),
        (("result", "99", "--out", "x.json"), "no such calibration"),
        (("result", "1", "--out", "/proc/nowhere/x.json"), "cannot be written"),
        (("export", "x.xlsx"), ".parquet"),
    ],
)
def test_what_cannot_be_done_is_said(store, arguments, said):
    done = run("history", *arguments, "--store", store)
    assert done.exit_code == 2
    assert said in done.output
    assert "Traceback" not in done.output


def test_a_sensor_that_was_recalled_is_not_due_until_it_is_back(lived, store):
    asked = ("history", "due", "12", "--tolerance", "1%", "--store", store)
    event = ("history", "event", " 12 ", "--store", store, "--date")
    for kind, date, said in (("recalled", "2019-05-01", "alone"), ("recalled", "2020-05-01", "recalled on 2020-05-01")):
        printed(*event, date, "--kind", kind)
        assert said in printed(*asked)
    assert "recalled on" in printed("history", "due", "--tolerance", "1%", "--store", store)
    printed(*event, "2020-06-01", "--kind", "repaired")
    assert "recalled" not in printed(*asked)


def test_a_calibration_that_does_not_count_is_shown_and_its_sensor_is_in_the_list(tmp_path):
    url, made = str(tmp_path / "h.db"), calibrated(0.1)
    unknown = {name: replace(one, standard_uncertainty=None) for name, one in made.parameters.items()}
    replace(made, parameters=unknown).save(tmp_path / "r.json")
    asked = ("--quantity", "natural_frequency", "--store", url)
    printed("history", "add", str(tmp_path / "r.json"), "--store", url)
    shown = printed("history", "show", "4711", *asked)
    assert "5000" in shown
    assert "no uncertainty" in shown
    for serial in ((), ("4711",)):
        assert "no calibration counts" in printed("history", "due", *serial, "--tolerance", "1%", *asked)


def test_sensors_of_one_serial_number_are_told_apart(tmp_path):
    url, makers = str(tmp_path / "h.db"), ("A", "B")
    for maker in makers:
        calibrated(sensor={"manufacturer": maker}).save(tmp_path / f"{maker}.json")
        printed("history", "add", str(tmp_path / f"{maker}.json"), "--store", url)
    refused = run("history", "show", "4711", "--type", "type A", "--store", url)
    assert (refused.exit_code, "--manufacturer" in refused.output) == (2, True)
    for maker in makers:
        assert f"{maker} type A" in printed("history", "show", "4711", "--manufacturer", maker, "--store", url)


def test_a_probability_is_printed_as_one():
    assert [_percent(value) for value in (None, 1e-20, 0.0523, 0.994, 0.9951, 1.0)] == [
        *("–", "below 0.01 %", "5.2 %", "99 %", "100 %", "100 %")
    ]


def test_one_refused_result_keeps_all_out(lived, tmp_path):
    folder, _ = lived
    calibrated(date=None).save(tmp_path / "undated.json")
    url = str(tmp_path / "h.db")
    done = run("history", "add", str(folder / "result1.json"), str(tmp_path / "undated.json"), "--store", url)
    assert done.exit_code == 2
    assert "undated.json" in done.output
    assert not (tmp_path / "h.db").exists()
