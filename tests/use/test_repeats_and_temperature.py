"""Runs, remounted or not, and temperatures: what is stated covers the truth, and its parts are told apart."""

from dataclasses import replace

import numpy as np
import pytest
from bench.laboratory import COEFFICIENTS, TRUE, coverage, records

import vibrident
from vibrident.base.errors import InputError
from vibrident.data.io import read
from vibrident.data.io.writer import write_calibration
from vibrident.data.records import Calibration, Circumstances, SystematicEffect
from vibrident.show import certificate_tables, document
from vibrident.show.media import markdown


def mounted(seed=0, mountings=5, runs=3, spread=(1e-3, 1e-4), **more):
    rng, made = np.random.default_rng(seed), []
    for m in range(mountings):
        drawn = {name: value * (1 + spread[0] * rng.standard_normal()) for name, value in TRUE.items()}
        for r in range(runs):
            own = {name: value * (1 + spread[1] * rng.standard_normal()) for name, value in drawn.items()}
            mounting = str(m) if mountings > 1 else ""
            made += records(rng, own, Circumstances(run=str(r + 1), mounting=mounting))
    return Calibration(tuple(made), **more)


def rows_of(result):
    return {row["source"]: row for row in result.settings["uncertainty_budget"]}


def test_remounting_is_a_component_of_its_own():
    effect = SystematicEffect("laser", "gain", 0.002)
    result = vibrident.identify(mounted(effects=(effect,)), "accelerometer")
    rows, gain = rows_of(result), result.parameters["sensitivity"]
    assert list(rows) == ["repeatability", "remounting", "laser"]
    assert (rows["repeatability"]["degrees_of_freedom"], rows["remounting"]["degrees_of_freedom"]) == (10, 4)
    parts = {name: row["contributions"]["sensitivity"] / gain.value for name, row in rows.items()}
    assert parts["laser"] == pytest.approx(0.002, rel=1e-3)
    values = np.array([row["sensitivity"] for row in result.settings["repeats"]["values"]]).reshape(5, 3)
    assert gain.value == pytest.approx(values.mean(), rel=1e-9)
    whole = values.mean(axis=1).std(ddof=1) / np.sqrt(5) / gain.value
    assert np.hypot(parts["repeatability"], parts["remounting"]) == pytest.approx(whole, rel=1e-3)
    own = np.sqrt(values.var(axis=1, ddof=1).mean() / 15) / gain.value
    assert parts["repeatability"] == pytest.approx(own, rel=1e-3)
    assert gain.standard_uncertainty / gain.value == pytest.approx(np.hypot(whole, 0.002), rel=1e-3)
    freedom = np.hypot(whole, 0.002) ** 4 / (whole**4 / 4)
    assert result.settings["effective_degrees_of_freedom"] <= freedom * 1.001
    assert "5 mountings" in result.settings["uncertainty_covers"]
    scatter, laser = result.settings["point_budget"]["sources"]
    assert scatter["source"] == "scatter of 5 mountings"
    squares = np.square(scatter["magnitude"]) + np.square(laser["magnitude"])
    np.testing.assert_allclose(np.sqrt(squares), result.measured.magnitude_uncertainty, rtol=1e-3)
    assert result.warnings == ()


def test_without_remounting_it_is_repeatability_alone():
    result = vibrident.identify(mounted(mountings=1, runs=6), "accelerometer")
    assert list(rows_of(result)) == ["repeatability"]
    assert rows_of(result)["repeatability"]["degrees_of_freedom"] == 5
    assert result.settings["effective_degrees_of_freedom"] == pytest.approx(5)
    noise = result.measured.magnitude_noise / result.measured.magnitude
    assert np.all((noise > 0) & (noise < 1e-3))


def test_a_calibration_file_states_runs_and_temperatures(tmp_path):
    made = mounted(mountings=2, runs=2)
    path = write_calibration(tmp_path, made)
    again = read(path)
    assert [r.circumstances for r in again.records] == [r.circumstances for r in made.records]
    text = markdown.render(document.report(vibrident.identify(path, "accelerometer")))
    assert "## Runs" in text
    path.write_text(path.read_text().replace('run = "2"', "").replace('mounting = "1"', ""))
    with pytest.raises(InputError, match="run"):
        vibrident.identify(path, "accelerometer")


def test_temperature_coefficients():
    rng, made = np.random.default_rng(5), []
    for t in (-20.0, 23.0, 60.0):
        own = {name: value * (1 + COEFFICIENTS[name] * (t - 23.0)) for name, value in TRUE.items()}
        made += records(rng, own, Circumstances(temperature_c=t))
    effects = (SystematicEffect("laser", "gain", 0.01),)
    result = vibrident.identify(Calibration(tuple(made), effects=effects), "accelerometer")
    found = result.settings["temperature"]
    assert (found["reference_c"], found["of_result_c"]) == (23.0, 23.0)
    for name, true in COEFFICIENTS.items():
        line = found["coefficients"][name]
        assert abs(line["per_k"] - true) < 4 * line["standard_uncertainty"]
        assert line["standard_uncertainty"] < 0.05 * abs(true)  # the common gain is in no ratio
    assert len(certificate_tables.temperature(result).rows) == 4
    assert "## Temperature" in markdown.render(document.report(result))
    some = [made[0], *records(rng, TRUE, Circumstances()), made[-1]]
    with pytest.raises(InputError, match="temperature"):
        vibrident.identify(Calibration(tuple(some)), "accelerometer")


def at_temperatures(off, seed=5):
    """Six temperatures; ``off``: factor on the sensitivity at each."""
    rng, made = np.random.default_rng(seed), []
    for t, factor in zip((3.0, 13.0, 23.0, 33.0, 43.0, 53.0), off, strict=True):
        own = {name: value * (1 + COEFFICIENTS[name] * (t - 23.0)) for name, value in TRUE.items()}
        own["sensitivity"] *= factor
        made += records(rng, own, Circumstances(temperature_c=t))
    return vibrident.identify(Calibration(tuple(made)), "accelerometer")


@pytest.mark.parametrize("place", [2, 4])
def test_a_temperature_off_the_line_is_named_and_the_coefficient_widened(place):
    off = np.ones(6)
    off[place] = 1.01
    result, t = at_temperatures(off), 3.0 + 10.0 * place
    line = result.settings["temperature"]["coefficients"]["sensitivity"]
    true = COEFFICIENTS["sensitivity"]
    assert line["interval_95"][0] <= true <= line["interval_95"][1]
    assert line["explained_by_c"] == [t]
    assert result.warning_codes == ("lack_of_fit",)
    assert f"explained by the value at {t:g} °C alone; without it the coefficient is -" in result.warnings[0].message
    (finding,) = result.findings
    # it is in the value that is stated where it was found at its temperature
    assert finding.impact == ({"sensitivity": pytest.approx(0.01 * TRUE["sensitivity"], rel=0.05)} if t == 23 else {})
    others = result.settings["temperature"]["coefficients"]["natural_frequency"]
    assert "birge_ratio" not in others


def test_a_sensitivity_that_bends_over_temperature_is_said():
    off = 1.0 + 3e-6 * np.array([-20.0, -10.0, 0.0, 10.0, 20.0, 30.0]) ** 2
    result = at_temperatures(off)
    assert result.settings["temperature"]["coefficients"]["sensitivity"]["explained_by_c"] == [None]
    assert "by a parabola alone" in result.warnings[0].message


def test_a_clean_line_is_as_it_was():
    result = at_temperatures(np.ones(6))
    assert (result.warnings, result.findings) == ((), ())


def test_a_run_outside_the_others_is_named_and_covered():
    rng, made = np.random.default_rng(2), []
    for run in range(6):
        own = {name: value * (1 + 1e-4 * rng.standard_normal()) for name, value in TRUE.items()}
        own["sensitivity"] *= 1.02 if run == 3 else 1.0
        made += records(rng, own, Circumstances(run=str(run)))
    result = vibrident.identify(Calibration(tuple(made)), "accelerometer")
    assert result.warning_codes == ("regimes",)
    assert result.warnings[0].message.startswith("Run 3 lies outside the scatter of the others by its sensitivity.")
    (finding,) = result.findings
    assert finding.impact["sensitivity"] == pytest.approx(TRUE["sensitivity"] * 0.02 / 6, rel=0.1)
    low, high = result.parameters["sensitivity"].interval_95
    assert low <= TRUE["sensitivity"] <= high


@pytest.mark.slow
@pytest.mark.parametrize("study", ["repeats", "temperature"])
def test_coverage(study):
    """200 draws: three standard deviations are 0.046; `python -m bench.laboratory` takes 500."""
    for name, share in coverage(study, 200).items():
        assert abs(share - 0.95) <= 0.046, name


def test_runs_and_temperatures_of_free_decays():
    """They tell natural frequency and damping ratio, run by run and degree by degree, as other records do."""

    def decay(natural_hz, seed, **circumstances):
        values = {"natural_frequency": natural_hz, "damping_ratio": 0.05, "sensitivity": 1.0}
        made = vibrident.simulate(
            ("accelerometer", values), "decay", sampling_rate_hz=2000.0, samples=600, response_noise=1e-3, seed=seed
        )
        return replace(made.records[0], circumstances=Circumstances(**circumstances))

    drawn = 50.0 * (1 + 1e-3 * np.random.default_rng(1).standard_normal(4))
    runs = vibrident.identify(Calibration(tuple(decay(f, i, run=str(i)) for i, f in enumerate(drawn))))
    found = runs.parameters["natural_frequency"]
    assert found.value == pytest.approx(drawn.mean(), rel=1e-4)
    assert found.standard_uncertainty == pytest.approx(drawn.std(ddof=1) / 2, rel=0.1)
    assert not runs.has_gain
    warm = [decay(50.0 * (1 - 2e-4 * (t - 23.0)), i, temperature_c=t) for i, t in enumerate((3.0, 23.0, 43.0))]
    line = vibrident.identify(Calibration(tuple(warm))).settings["temperature"]["coefficients"]["natural_frequency"]
    assert line["per_k"] == pytest.approx(-2e-4, abs=4 * line["standard_uncertainty"])
