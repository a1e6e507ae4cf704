"""Each command on small simulated data: what it prints, what it writes."""

import csv
import json
import math
import re
from typing import get_args

import numpy as np
import pytest
from tests.support.shell import printed

import vibrident
from vibrident.app.cli import options
from vibrident.base.errors import InputError
from vibrident.result import WARNING_CODES, Result
from vibrident.use.comparison import read_truth

#: Standard uncertainties within which an estimate must meet the truth; beyond 4 with probability 6e-5.
CLOSE = 4.0
CONTRACT = {
    "schema": str,
    "model": str,
    "estimator": str,
    "settings": dict,
    "provenance": dict,
    "parameters": dict,
    "correlation": dict,
    "fit": dict,
    "response": dict,
    "measured": dict,
    "warnings": list,
}
CURVE = ("frequency_hz", "magnitude", "phase_deg", "magnitude_uncertainty", "phase_deg_uncertainty")


def assert_close(result: Result, truth: dict[str, float]):
    for name, true in truth.items():
        parameter = result.parameters[name]
        assert abs(parameter.value - true) < CLOSE * parameter.standard_uncertainty, name


def shown(folder):
    return sorted(file.name for file in folder.iterdir())


def test_the_names_in_the_help_are_those_of_the_library():
    from vibrident.data.records import EXCITATIONS, QUANTITIES
    from vibrident.fit.judge.document import Uncertainty
    from vibrident.physics.discretisation import METHODS
    from vibrident.physics.simulation import SENSORS

    assert set(options.DISCRETISATIONS) == set(METHODS)
    assert options.QUANTITIES == QUANTITIES
    assert set(options.EXCITATIONS) == set(EXCITATIONS) - {"decay"}  # a decay alone identifies nothing by itself
    assert set(options.SENSORS) < set(SENSORS)
    assert get_args(Uncertainty) == options.UNCERTAINTIES


def test_help_lists_the_commands_that_exist(run):
    text = run("--help").stdout
    for command in ("demo", "simulate", "inspect", "identify", "predict", "compare", "report", "doctor"):
        assert re.search(rf"\b{command}\b", text)
        assert run(command, "--help").exit_code == 0


def test_version(run):
    assert run("--version").stdout == f"vibrident {vibrident.__version__}\n"


def test_simulate_writes_what_identify_takes(made, identified):
    assert shown(made) == sorted(
        ["calibration.toml", "truth.json", *(f"{f}_Hz.csv" for f in ("100", "300", "500", "630", "800"))]
    )
    truth = json.loads((made / "truth.json").read_text())
    assert truth["seed"] == 7
    assert truth["parameters"]["sensitivity"]["unit"] == "V/(m/s^2)"
    assert truth["parameters"]["resonance_frequency"]["value"] == pytest.approx(630.0, rel=1e-12)
    assert_close(Result.load(identified), read_truth(made / "truth.json"))


@pytest.mark.parametrize("excitation", ["multisine", "sweep", "random", "shock"])
def test_other_excitations_are_identified_as_they_are(excitation, tmp_path):
    printed(
        "simulate", "--out", tmp_path / "cal", "--excitation", excitation, "--samples", 4096, "--rate", 12800,
        "--frequencies", "20:2000", "--response-noise", 0.01, "--start", "rest", "--force",
    )  # fmt: skip
    printed("identify", tmp_path / "cal" / "calibration.toml", "--out", tmp_path / "out", "--no-pictures")
    truth = read_truth(tmp_path / "cal" / "truth.json")
    assert_close(Result.load(tmp_path / "out" / "result.json"), truth)


def test_identify_prints_and_writes_what_was_agreed(identified, made, run, tmp_path):
    document = json.loads(identified.read_text(encoding="utf-8"))
    for field, kind in CONTRACT.items():
        assert isinstance(document[field], kind), field
    assert document["schema"] == "vibrident.result/1"
    for name in ("sensitivity", "natural_frequency", "damping_ratio", "resonance_frequency"):
        parameter = document["parameters"][name]
        low, high = parameter["interval_95"]
        assert low < parameter["value"] < high
        assert parameter["standard_uncertainty"] > 0
        assert isinstance(parameter["unit"], str)
        assert parameter["identifiable"] is True
    fit = document["fit"]
    assert all(math.isfinite(fit[name]) for name in ("rmse", "mae", "mse", "r2", "rpd", "nrmse", "chi2_reduced"))
    assert isinstance(fit["degrees_of_freedom"], int)
    assert fit["adequate"] is True
    assert len({len(document["response"][column]) for column in CURVE}) == 1
    assert len({len(document["measured"][column]) for column in (*CURVE, "deviation_percent")}) == 1
    size = len(document["correlation"]["names"])
    assert np.shape(document["correlation"]["matrix"]) == (size, size)
    assert document["warnings"] == []
    assert len(document["provenance"]["files"][0]["sha256"]) == 64
    done = run("identify", made / "calibration.toml", "--out", tmp_path / "out", "--no-pictures", "--strict")
    assert done.exit_code == 0  # no warning, so strict changes nothing
    assert "natural frequency" in done.stdout
    assert "adequate" in done.stdout
    assert f"Written: {tmp_path / 'out' / 'result.json'}" in done.stdout
    assert done.stderr == ""


def test_identify_draws_pictures(made, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "notes.txt").write_text("mine")
    (tmp_path / "out" / "result.json").write_text("old")
    printed("identify", made / "calibration.toml", "--out", tmp_path / "out")
    pictures = ["deviation.png", "residuals.png", "sensitivity.png", "signals.png", "training.png"]
    assert shown(tmp_path / "out") == sorted([*pictures, "notes.txt", "result.json"])
    assert (tmp_path / "out" / "notes.txt").read_text() == "mine"
    assert all((tmp_path / "out" / name).read_bytes()[:4] == b"\x89PNG" for name in pictures)
    assert Result.load(tmp_path / "out" / "result.json").model == "accelerometer"


def test_strict_exits_with_3_for_a_warning_and_writes_the_result(run, tmp_path):
    run("simulate", "--out", tmp_path / "cal", "--sensor", "inverted", *SMALL_AND_CLEAN)
    arguments = ["identify", tmp_path / "cal" / "calibration.toml", "--out", tmp_path / "out", "--no-pictures"]
    assert run(*arguments).exit_code == 0
    done = run(*arguments, "--strict")
    assert done.exit_code == 3
    assert "polarity" in done.stderr
    document = json.loads((tmp_path / "out" / "result.json").read_text())
    assert [warning["code"] for warning in document["warnings"]] == ["polarity"]
    assert set(document["warnings"][0]) == {"code", "message"}
    assert document["warnings"][0]["code"] in WARNING_CODES
    quiet = run(*arguments, "--quiet")
    assert quiet.stdout == ""
    assert quiet.stderr.startswith("Warning (polarity): ")


SMALL_AND_CLEAN = ("--frequencies", "100,300,500,630,800", "--rate", "12800", "--samples", "2000",
                   "--response-noise", "0.01", "--seed", "7")  # fmt: skip


@pytest.mark.needs("network")
def test_settings_of_an_estimator_reach_it(made, tmp_path):
    chosen = ["--estimator", "ipnn", "--discretisation", "euler", "--optimiser", "adam", "--steps", "5", "--weights"]
    said = printed("identify", made / "calibration.toml", "--out", tmp_path, "--no-pictures", *chosen)
    result = Result.load(tmp_path / "result.json")
    assert result.estimator == "ipnn"
    assert result.settings["discretisation"] == "euler"
    assert result.settings["optimiser"] == "adam"
    assert "W1" in said
    assert "Weights of the network" in said


def test_weights_of_a_method_without_a_network(made, run, tmp_path):
    done = run("identify", made / "calibration.toml", "--out", tmp_path, "--no-pictures", "--weights")
    assert done.exit_code == 0
    assert "ml trains no network" in done.stderr


def test_inspect_shows_records_findings_and_a_picture(calibration, tmp_path, monkeypatch):
    file = calibration.with_name("630_Hz.csv")
    rows = list(csv.reader(file.read_text().splitlines()))
    for row in rows[1:]:
        row[2] = repr(min(float(row[2]), 1.5))
    dead = calibration.with_name("800_Hz.csv")
    file.write_text("\n".join(",".join(row) for row in rows) + "\n")
    flat = [",".join([*line.split(",")[:2], "0.5"]) for line in dead.read_text().splitlines()[1:]]
    dead.write_text("\n".join(["time_s,reference_acceleration,response", *flat]) + "\n")
    monkeypatch.chdir(tmp_path)
    said = printed("inspect", calibration)
    for text in ("100 Hz", "12800", "acceleration in m/s²", "(clipped)", "(dead_channel)", "clipped at 1.5", "800 Hz"):
        assert text in said
    assert "Written: calibration.inspect.png" in said
    assert (tmp_path / "calibration.inspect.png").read_bytes()[:4] == b"\x89PNG"


def test_inspect_a_table(tmp_path):
    (tmp_path / "frf.csv").write_text("f,m,p\n10,1.0,0\n20,1.1,-2\n30,1.2,-3\n")
    (tmp_path / "table.toml").write_text('[table]\nfile = "frf.csv"\nfrequency = 1\nmagnitude = 2\nphase = 3\n')
    said = printed("inspect", tmp_path / "table.toml", "--out", tmp_path / "out")
    assert "frf.csv" in said
    assert shown(tmp_path / "out") == ["inspect.png"]


def test_inspect_refuses_a_model_that_identify_would_refuse(run, tmp_path):
    (tmp_path / "frf.csv").write_text("f,m,p\n10,1.0,0\n20,1.1,-2\n30,1.2,-3\n")
    table = '[table]\nfile = "frf.csv"\nfrequency = 1\nmagnitude = 2\nphase = 3\n'
    (tmp_path / "table.toml").write_text('[sensor]\nmodel = "accelerometr"\n' + table)
    done = run("inspect", tmp_path / "table.toml", "--out", tmp_path / "out")
    assert done.exit_code == 2
    assert "did you mean 'accelerometer'?" in done.stderr
    assert not (tmp_path / "out").exists()


def test_predict_meets_the_measured_response_within_its_noise(identified, run, tmp_path):
    other = ["--excitation", "random", "--frequencies", "20:2000", "--rate", 12800, "--samples", 3000]
    run("simulate", "--out", tmp_path / "cal", *other, "--response-noise", 0.02, "--seed", 3)
    printed("predict", identified, tmp_path / "cal" / "calibration.toml", "--out", tmp_path / "out")
    document = json.loads((tmp_path / "out" / "prediction.json").read_text())
    (record,) = document["records"]
    assert record["name"] == "random"
    assert record["nrmse"] == pytest.approx(0.02, rel=0.05)  # the noise; 3000 samples tell it to 1.3 %
    assert document["rmse"] == record["rmse"]
    rows = list(csv.DictReader((tmp_path / "out" / record["file"]).read_text().splitlines()))
    assert len(rows) == record["samples"] == 3000
    used = [row for row in rows if row["predicted"]]
    assert len(used) == record["samples_compared"] == 3000 - record["samples_without_prediction"]
    residual = np.array([float(row["response"]) - float(row["predicted"]) for row in used])
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(record["rmse"], rel=1e-12)
    times = np.array([float(row["time_s"]) for row in rows])
    assert times == pytest.approx(np.arange(3000) / 12800)


def test_predict_gives_every_record_a_file_of_its_own(calibration, identified, tmp_path):
    text = calibration.read_text()
    calibration.write_text(
        text.replace('name = "100 Hz"', 'name = "a/b"').replace('name = "300 Hz"', 'name = "A\\\\b"')
    )
    printed("predict", identified, calibration, "--out", tmp_path / "out")
    document = json.loads((tmp_path / "out" / "prediction.json").read_text())
    files = [record["file"] for record in document["records"]]
    assert files == ["a_b.csv", "A_b_2.csv", "500_Hz.csv", "630_Hz.csv", "800_Hz.csv"]
    assert shown(tmp_path / "out") == sorted([*files, "prediction.json"])


def test_compare_methods(made, tmp_path):
    arguments = ["--estimators", "ml,ipnn", "--discretisations", "zoh,bandlimited", "--truth", made / "truth.json"]
    printed("compare", made / "calibration.toml", *arguments, "--out", tmp_path / "out")
    document = json.loads((tmp_path / "out" / "comparison.json").read_text())
    assert document["schema"] == "vibrident.comparison/1"
    assert document["deviations_from"] == "truth"
    methods = {method["name"]: method for method in document["methods"]}
    assert list(methods) == ["ml", "ipnn zoh", "ipnn bandlimited"]
    entries = {name: method["parameters"]["natural_frequency"] for name, method in methods.items()}
    assert abs(entries["ml"]["deviation_in_u"]) < CLOSE
    assert abs(entries["ipnn bandlimited"]["deviation_in_u"]) < CLOSE
    # A held input comes half a sample late, 9° at 630 Hz and 12.8 kHz, which the fit takes for another resonance.
    assert abs(entries["ipnn bandlimited"]["deviation_percent"]) < 0.02
    assert 1.0 < abs(entries["ipnn zoh"]["deviation_percent"]) < 10.0
    assert "lack_of_fit" in methods["ipnn zoh"]["warnings"]
    saved = [tmp_path / "out" / f"{name}.json" for name in ("ml", "ipnn-zoh")]
    assert Result.load(saved[1]).settings["discretisation"] == "zoh"
    said = printed("compare", *saved, "--out", tmp_path / "again")
    assert "natural frequency" in said
    document = json.loads((tmp_path / "again" / "comparison.json").read_text())
    assert document["deviations_from"] == "ml"
    assert document["methods"][0]["parameters"]["damping_ratio"]["deviation_percent"] == 0.0


def test_compare_leaves_out_what_does_not_suit(run, tmp_path):
    run("simulate", "--out", tmp_path / "cal", "--excitation", "random", "--samples", 3000, "--rate", 12800)
    done = run("compare", tmp_path / "cal" / "calibration.toml", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    assert "Left out: ml." in done.stderr
    assert "Left out: lsm." in done.stderr
    assert shown(tmp_path / "out") == ["comparison.json", "ipnn.json"]
    named = run("compare", tmp_path / "cal" / "calibration.toml", "--estimators", "ml", "--out", tmp_path / "o2")
    assert named.exit_code == 2
    pair = ["compare", tmp_path / "cal" / "calibration.toml", "--out", tmp_path / "o3", "--models"]
    printed(*pair, "accelerometer,accelerometer+delay")
    assert shown(tmp_path / "o3") == ["comparison.json", "ipnn-accelerometer-delay.json", "ipnn-accelerometer.json"]
    unknown = run(*pair, "accelerometer,acelerometer")
    assert unknown.exit_code == 2
    assert "Left out" not in unknown.stderr  # refused before anything is identified


@pytest.mark.usefixtures("unpainted")
def test_report_beside_the_result_and_elsewhere(identified, run, tmp_path):
    results = [tmp_path / name / "result.json" for name in ("a", "b")]
    for file in results:
        file.parent.mkdir()
        file.write_bytes(identified.read_bytes())
    assert run("report", results[0]).exit_code == 0
    assert "report.md" in shown(tmp_path / "a")
    assert "![" in (tmp_path / "a" / "report.md").read_text(encoding="utf-8")
    printed("report", *results, "--out", tmp_path / "all")
    assert shown(tmp_path / "all") == ["a", "b", "comparison.md"]
    assert (tmp_path / "all" / "b" / "sensitivity.png").is_file()


def test_demo_meets_the_truth(tmp_path):
    said = printed("demo", "--out", tmp_path / "demo")
    result = Result.load(tmp_path / "demo" / "result.json")
    assert_close(result, read_truth(tmp_path / "demo" / "truth.json"))
    assert result.warnings == ()
    written = {file for file in shown(tmp_path / "demo") if not file.endswith(".csv")}
    assert {"report.md", "sensitivity.png", "training.png", "network.json", "network.png"} < written
    assert all(file in said for file in written)
    assert "W3 feedback" in said
    assert "difference / u" in said
    assert "Look at" in said


def test_doctor_finds_a_sound_installation_fit():
    said = printed("doctor")
    assert "cannot be used" not in said
    assert "Fit for use." in said


@pytest.mark.needs("network")
def test_doctor_says_what_is_wrong(run, monkeypatch):
    from vibrident.app import doctor
    from vibrident.base import backend

    monkeypatch.setattr(backend, "arithmetic_error", lambda: math.inf)
    for check in ("_packages_and_extras", "_identification"):  # they take most of the time
        monkeypatch.setattr(doctor, check, lambda: [])
    done = run("doctor")
    assert done.exit_code == 2
    assert "pip install 'jax==" in done.stdout
    assert "Sum of matrix products" in done.stderr


def test_true_values_that_cannot_be_read(tmp_path):
    (tmp_path / "truth.json").write_text('{"schema": "vibrident.truth/1", "parameters": {"a": 1}}')
    with pytest.raises(InputError, match="true values"):
        read_truth(tmp_path / "truth.json")


@pytest.mark.slow
def test_identify_samples_the_posterior_where_asked(run, made, tmp_path):
    done = run("identify", made / "calibration.toml", "--out", tmp_path, "--no-pictures", "--posterior")
    assert done.exit_code == 0, done.output
    document = json.loads((tmp_path / "result.json").read_text())
    rows = document["settings"]["posterior"]["parameters"]
    assert set(rows) == set(document["parameters"])
    assert "Posterior distribution" in done.output
    network = run("identify", made / "calibration.toml", "--out", tmp_path / "no", "--estimator", "ipnn", "--posterior")
    assert network.exit_code == 0, network.output
