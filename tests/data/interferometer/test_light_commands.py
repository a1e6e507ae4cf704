"""Raw light through the commands: simulate, inspect, identify, report."""

from __future__ import annotations

import json

import pytest
from tests.support.shell import printed, run

from vibrident.result import Result
from vibrident.show import setting_tables
from vibrident.show.report import render


def test_light_goes_through_the_commands(tmp_path):
    made, looked, found = tmp_path / "made", tmp_path / "looked", tmp_path / "found"
    optics = "noise=0.02,bits=12,dropouts=1,ellipse=random"
    settings = ["--rate", "400000", "--samples", "24000", "--frequencies", "150,400,1000", "--start", "steady"]
    settings += ["--response-noise", "0.001", "--seed", "3", "--optics", optics]
    printed("simulate", "--interferometer", "quadrature", "--out", made, *settings)
    truth = json.loads((made / "truth.json").read_text(encoding="utf-8"))
    assert truth["interferometer"]["bits"] == 12
    said = printed("inspect", made / "calibration.toml", "--out", looked)
    assert "Interferometer" in said
    assert "fringe_slip" in said
    assert (looked / "light.png").stat().st_size > 10_000
    printed("identify", made / "calibration.toml", "--no-pictures", "--out", found)
    result = Result.load(found / "result.json")
    for name, stated in truth["parameters"].items():
        parameter = result.parameters[name]
        assert abs(parameter.value - stated["value"]) < 4.0 * parameter.standard_uncertainty
    assert "fringe_slip" in result.warning_codes
    assert setting_tables.light(result).rows[0][0] == "150 Hz"
    assert "## Interferometer" in render(result)


@pytest.mark.parametrize(("optics", "word"), [("nosie=1", "noise"), ("noise=much", "number")])
def test_a_wrong_key_of_the_optics_is_refused(tmp_path, optics, word):
    done = run("simulate", "--interferometer", "quadrature", "--out", tmp_path / "x", "--optics", optics)
    assert done.exit_code == 2
    assert word in done.stderr


@pytest.mark.parametrize("kind", ["quadrature", "heterodyne"])
@pytest.mark.quick("heterodyne")
def test_simulated_light_can_be_identified_as_it_is(kind, tmp_path):
    """Nobody need know how fast the phase turns: the signals are sampled fast enough for the motion."""
    made, found = tmp_path / "made", tmp_path / "found"
    settings = ["--samples", "8000", "--frequencies", "160,400,1000", "--response-noise", "0.001", "--seed", "3"]
    printed("simulate", "--interferometer", kind, "--out", made, *settings)
    printed("identify", made / "calibration.toml", "--no-pictures", "--out", found)
    truth = json.loads((made / "truth.json").read_text(encoding="utf-8"))
    result = Result.load(found / "result.json")
    for name, stated in truth["parameters"].items():
        parameter = result.parameters[name]
        assert abs(parameter.value - stated["value"]) < 4.0 * parameter.standard_uncertainty
