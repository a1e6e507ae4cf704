"""``identify`` with several calibration files: what it prints and writes, and what other commands make of it."""

import json
import shutil

import numpy as np
import pytest
from tests.support.shell import printed

from vibrident.result import Result

#: As the calibration `made` of the folder's conftest.
SMALL = ("--frequencies", "100,300,500,630,800", "--rate", "12800", "--samples", "2000", "--response-noise", "0.01")
MECHANICS = ("natural_frequency", "damping_ratio")


@pytest.fixture(scope="module")
def again(tmp_path_factory):
    """The same sensor's calibration once more, with noise of its own."""
    folder = tmp_path_factory.mktemp("again") / "later"
    printed("simulate", "--out", folder, *SMALL, "--seed", 8)
    return shutil.copy(folder / "calibration.toml", folder / "later.toml")


@pytest.fixture(scope="module")
def joint(made, again, tmp_path_factory):
    folder = tmp_path_factory.mktemp("joint") / "out"
    said = printed("identify", made / "calibration.toml", again, "--out", folder, "--no-pictures")
    return folder, said


def test_each_file_gets_a_result(joint, identified):
    folder, printed = joint
    assert sorted(str(f.relative_to(folder)) for f in folder.rglob("*.*")) == ["later/result.json", "result.json"]
    results = [Result.load(folder / "result.json"), Result.load(folder / "later" / "result.json")]
    alone = Result.load(identified)
    for name in (*MECHANICS, "sensitivity"):
        first, second = (result.parameters[name] for result in results)
        assert first.value == pytest.approx(second.value, rel=1e-12)
        assert first.standard_uncertainty < alone.parameters[name].standard_uncertainty
    for position, result in enumerate(results):
        about = result.settings["joint"]
        assert about["position"] == position
        assert [one["file"] for one in about["calibrations"]] == ["calibration.toml", "later.toml"]
        assert about["consistency"]["consistent"]
        sources = [row["source"].partition(":")[0] for row in result.settings["uncertainty_budget"]]
        assert sources == ["calibration.toml", "later.toml"]
    assert "Joint fit of 2 calibrations" in printed
    assert "consistent" in printed


def test_other_commands_take_either_result(joint, again, tmp_path):
    folder, _ = joint
    second = folder / "later" / "result.json"
    printed("predict", second, again, "--out", tmp_path / "predicted")
    prediction = json.loads((tmp_path / "predicted" / "prediction.json").read_text())
    assert prediction["rmse"] == pytest.approx(Result.load(second).fit.rmse, rel=1e-6)
    printed("report", folder / "result.json", "--format", "md", "--out", tmp_path / "report")
    printed("compare", folder / "result.json", second, "--out", tmp_path / "compared")


def test_what_is_shared_can_be_named(made, again, tmp_path):
    out = tmp_path / "out"
    files = (made / "calibration.toml", again)
    printed("identify", *files, "--share", "natural_frequency", "--out", out, "--no-pictures", "--quiet")
    results = [Result.load(out / "result.json"), Result.load(out / "later" / "result.json")]
    shared, own = ([result.parameters[name].value for result in results] for name in MECHANICS)
    assert shared[0] == pytest.approx(shared[1], rel=1e-12)
    assert not np.isclose(own[0], own[1], rtol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--share", "natural_frequncy"), "did you mean 'natural_frequency'?"),
        (("--share", "delay"), "is not a parameter of these models"),
        (("--model", "accelerometer,accelerometer,accelerometer"), "The number of models is not that"),
        pytest.param(
            ("--estimator", "ipnn", "--residual"),
            "A learned residual belongs to one calibration",
            marks=pytest.mark.needs("network"),
        ),
    ],
)
def test_bad_choices_are_one_message(run, made, again, tmp_path, arguments, said):
    done = run("identify", made / "calibration.toml", again, *arguments, "--out", tmp_path / "out", "--no-pictures")
    assert done.exit_code == 2
    assert said in " ".join(done.output.split())
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("arguments", [("--share", "damping_ratio"), ("--model", "accelerometer,accelerometer+delay")])
def test_options_of_several_files_need_several(run, made, tmp_path, arguments):
    done = run("identify", made / "calibration.toml", *arguments, "--out", tmp_path / "out", "--no-pictures")
    assert done.exit_code == 2
    assert "for several" in done.output
