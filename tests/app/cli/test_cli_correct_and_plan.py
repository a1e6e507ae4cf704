"""``vibrident correct`` and ``vibrident plan``: what they write, print, and refuse."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from tests.support.shell import printed

from vibrident.result import Result

PLAN = (
    "plan", "--model", "accelerometer", "--parameter", "natural_frequency=650", "--parameter", "damping_ratio=0.18",
    "--parameter", "sensitivity=0.104", "--frequencies", "100:2000", "--rate", "25600", "--samples", "2000",
    "--response-noise", "0.01",
)  # fmt: skip


@pytest.fixture(scope="module")
def shock(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shock") / "cal"
    printed("simulate", "--out", folder, "--excitation", "shock", "--samples", 4000, "--response-noise", 0.002)
    return folder / "calibration.toml"


def columns(path):
    with path.open(encoding="ascii") as stream:
        rows = list(csv.reader(stream))
    return rows[0], np.array([[float(cell) if cell else np.nan for cell in row] for row in rows[1:]])


def test_correct_writes_acceleration_with_uncertainty(identified, shock, tmp_path):
    said = printed("correct", identified, shock, "--out", tmp_path / "out")
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"shock.csv", "correction.json", "correction.png"}
    header, table = columns(tmp_path / "out" / "shock.csv")
    assert header == ["time_s", "acceleration", "standard_uncertainty"]
    assert table.shape == (4000, 3)
    document = json.loads((tmp_path / "out" / "correction.json").read_text(encoding="utf-8"))
    row = document["records"][0]
    low, high = row["peak"]["interval_95"]
    assert low < row["peak"]["value"] < high
    assert row["peak"]["value"] == pytest.approx(np.max(table[:, 1]), rel=0.01)
    assert row["peak"]["value"] == pytest.approx(9.80665, rel=0.02)
    assert row["peak"]["standard_uncertainty"] == pytest.approx(table[np.argmax(table[:, 1]), 2], rel=0.05)
    assert row["band"]["low_hz"] == 0.0
    assert 650 < row["band"]["high_hz"] < 0.25 * 51200
    assert "before the motion" in row["noise"]["assumption"]
    assert row["reference"]["rmse"] < 0.1
    assert document["unit"] == "m/s^2"
    assert "peak" in said


def test_correct_without_a_reference_gives_the_same(run, identified, shock, tmp_path):
    text = shock.read_text(encoding="utf-8").replace('excitation = "shock"', 'excitation = "decay"')
    for file in shock.parent.glob("*.csv"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    (tmp_path / "alone.toml").write_text(text, encoding="utf-8")
    band = ("--band", "0:3000", "--no-pictures")
    assert run("correct", identified, shock, "--out", tmp_path / "with", *band).exit_code == 0
    assert run("correct", identified, tmp_path / "alone.toml", "--out", tmp_path / "alone", *band).exit_code == 0
    one, other = (columns(tmp_path / name / "shock.csv")[1] for name in ("with", "alone"))
    np.testing.assert_array_equal(one, other)
    document = json.loads((tmp_path / "alone" / "correction.json").read_text(encoding="utf-8"))
    assert document["records"][0]["reference"] is None


def test_correct_passes_the_results_doubts_on(run, identified, shock, tmp_path):
    document = json.loads(identified.read_text(encoding="utf-8"))
    document["warnings"] = [{"code": "lack_of_fit", "message": "The model does not explain the data."}]
    (tmp_path / "result.json").write_text(json.dumps(document), encoding="utf-8")
    done = run("correct", tmp_path / "result.json", shock, "--out", tmp_path / "out", "--no-pictures")
    assert done.exit_code == 0
    assert "does not explain" in done.stderr


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--band", "0:90000"), "half the sampling rate"),
        (("--band", "wide"), "two frequencies"),
        (("--noise", "-1"), "a number from 0"),
    ],
)
def test_correct_refuses(options, says, run, identified, shock, tmp_path):
    done = run("correct", identified, shock, "--out", tmp_path / "out", *options)
    assert done.exit_code == 2
    assert says in done.stderr
    assert "Traceback" not in done.output
    assert not (tmp_path / "out").exists()


def test_correct_refuses_other_units_tables_and_cubic_models(run, identified, shock, tmp_path):
    other = tmp_path / "cal"
    other.mkdir()
    for file in shock.parent.glob("*.csv"):
        (other / file.name).write_bytes(file.read_bytes())
    text = shock.read_text(encoding="utf-8")
    (other / "mv.toml").write_text(text.replace('unit = "V"', 'unit = "mV"'), encoding="utf-8")
    done = run("correct", identified, other / "mv.toml", "--out", tmp_path / "out")
    assert done.exit_code == 2
    assert "unit of the result" in done.stderr
    document = json.loads(identified.read_text(encoding="utf-8"))
    document["model"] = "accelerometer+cubic"
    (tmp_path / "cubic.json").write_text(json.dumps(document), encoding="utf-8")
    done = run("correct", tmp_path / "cubic.json", shock, "--out", tmp_path / "out")
    assert done.exit_code == 2
    assert "linear" in done.stderr
    assert not (tmp_path / "out").exists()


def test_plan_prints_and_writes(tmp_path):
    said = printed(*PLAN, "--best", 6, "--criterion", "D", "--out", tmp_path / "out")
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"plan.json", "plan.png"}
    document = json.loads((tmp_path / "out" / "plan.json").read_text(encoding="utf-8"))
    assert len(document["points"]) == 6
    assert document["criterion"] == "D"
    assert 0.5 < document["efficiency"] <= 1.0
    assert len(document["candidates_hz"]) == 14
    parameters = document["parameters"]
    assert 0 < parameters["natural_frequency"]["standard_uncertainty"] < 0.1
    all_points = document["standard_uncertainty_of_all_candidates"]
    assert all_points["sensitivity"] < parameters["sensitivity"]["standard_uncertainty"]
    for word in ("natural frequency", "Frequencies in Hz", "D-optimal choice of 6 out of 14"):
        assert word in said


def test_plan_from_a_result_foresees_its_own_uncertainties(identified, tmp_path):
    printed("plan", "--from", identified, "--out", tmp_path / "out")
    planned = json.loads((tmp_path / "out" / "plan.json").read_text(encoding="utf-8"))["parameters"]
    for name, parameter in Result.load(identified).parameters.items():
        assert planned[name]["standard_uncertainty"] == pytest.approx(parameter.standard_uncertainty, rel=0.25)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("plan",), "--from RESULT"),
        ((*PLAN, "--best", 1), "at least 2 points"),
        ((*PLAN, "--criterion", "E"), "D | A"),
        (PLAN[:-2], "noise"),
        (PLAN[:-6], "given"),
        ((*PLAN, "--parameter", "delay"), "NAME=VALUE"),
        ((*PLAN, "--parameter", "delay=1e-5"), "sensitivity, natural_frequency, damping_ratio"),
    ],
)
def test_plan_refuses(arguments, says, run):
    done = run(*arguments)
    assert done.exit_code == 2, done.output
    assert says in done.stderr
    assert "Traceback" not in done.output
