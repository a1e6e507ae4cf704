"""Hammer and exciter: a force reference, and the structure behind it with its stiffness, mass and damping."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.support.mounted import table
from tests.support.shell import run

import vibrident
from vibrident.base.errors import InputError, ModelError
from vibrident.physics.models import parse
from vibrident.physics.simulation import Sine, exact_response

MASS, STIFFNESS, DAMPING = 0.8, 2e5, 12.0  # kg, N/m, N s/m
VALUES = {
    "compliance": 1 / STIFFNESS,
    "natural_frequency": (STIFFNESS / MASS) ** 0.5 / (2 * np.pi),
    "damping_ratio": DAMPING / (2 * (STIFFNESS * MASS) ** 0.5),
}
MODAL = {"modal_stiffness": STIFFNESS, "modal_mass": MASS, "damping_coefficient": DAMPING}
CORES = {"receptance": ("m", "m/N"), "mobility": ("m/s", "m/(s N)"), "accelerance": ("m/s^2", "m/(s^2 N)")}
HZ = np.geomspace(5.0, 2000.0, 60)


@pytest.mark.parametrize(("power", "core"), [*enumerate(CORES)])
def test_the_response_is_that_of_mass_spring_and_dashpot(power, core):
    s = 2j * np.pi * HZ
    expected = s**power / (MASS * s**2 + DAMPING * s + STIFFNESS)
    np.testing.assert_allclose(parse(core).frequency_response(VALUES, HZ, "force"), expected, rtol=1e-12)


@pytest.mark.parametrize(("power", "core"), [*enumerate(CORES)])
def test_in_time_it_is_the_integrated_equation_of_motion(power, core):
    """m ẍ + c ẋ + k x = F from rest, by a general solver."""
    times = np.arange(400) / 4000.0
    force = Sine(60.0, 10.0, 0.3)

    def slope(t, state):
        return [state[1], (force.value(np.array([t]))[0] - DAMPING * state[1] - STIFFNESS * state[0]) / MASS]

    motion = solve_ivp(slope, (0, times[-1]), [0.0, 0.0], "DOP853", times, rtol=1e-11, atol=1e-18)
    acceleration = (force.value(times) - DAMPING * motion.y[1] - STIFFNESS * motion.y[0]) / MASS
    expected = [motion.y[0], motion.y[1], acceleration][power]
    found = exact_response(parse(core), VALUES, force, sampling_rate_hz=4000.0, samples=400, start="rest")
    np.testing.assert_allclose(found[1:], expected[1:], atol=1e-7 * np.max(np.abs(expected)))


@pytest.mark.parametrize("core", CORES)
def test_a_hammer_gives_stiffness_mass_and_damping(core):
    made = vibrident.simulate(
        (core, VALUES), "shock",
        sampling_rate_hz=5000.0, samples=6000, amplitude=100.0, quantity="force", response_noise=1e-3,
    )  # fmt: skip
    unit, _ = CORES[core]
    assert (made.reference_unit, made.response_unit) == ("N", unit)
    result = vibrident.identify(made)
    assert result.fit.adequate
    for name, true in (VALUES | MODAL).items():
        found = result.parameters[name]
        assert found.value == pytest.approx(true, abs=5 * found.standard_uncertainty), name
    units = {name: result.parameters[name].unit for name in ("compliance", *MODAL)}
    assert units == {"compliance": "m/N", "modal_stiffness": "N/m", "modal_mass": "kg", "damping_coefficient": "N s/m"}
    assert result.sensitivity_per == {"quantity": "force", "unit": "N"}


def test_all_three_are_one_structure():
    """A joint fit of displacement and acceleration shares compliance, natural frequency and damping."""
    calibrations = [
        table(seed, core, VALUES, HZ, quantity="force", response_unit=CORES[core][0])
        for seed, core in enumerate(("receptance", "accelerance"))
    ]
    first, second = vibrident.identify_together(calibrations, share=["natural_frequency", "damping_ratio"])
    values = [each.parameters["natural_frequency"].value for each in (first, second)]
    assert values[0] == pytest.approx(values[1], rel=1e-12)


def test_a_table_says_what_it_is_per(tmp_path):
    """In its own units, (mm/s²)/N, from the file to the summary and the curve."""
    response = parse("accelerance").frequency_response(VALUES, HZ, "force") * 1e3
    columns = HZ, np.abs(response), np.rad2deg(np.angle(response))
    header = "f (Hz),A ((mm/s^2)/N),phase (deg)"
    np.savetxt(tmp_path / "frf.csv", np.transpose(columns), delimiter=",", header=header, comments="")
    (tmp_path / "cal.toml").write_text(
        '[sensor]\nmodel = "accelerance"\n[reference]\nquantity = "force"\n[response]\nunit = "m/s^2"\n'
        '[table]\nfile = "frf.csv"\nfrequency = 1\nmagnitude = 2\nphase = 3\n'
    )
    done = run("identify", tmp_path / "cal.toml", "--out", tmp_path / "out", "--no-pictures")
    assert done.exit_code == 0, done.output
    result = vibrident.Result.load(tmp_path / "out" / "result.json")
    assert result.parameters["modal_mass"].value == pytest.approx(MASS, rel=1e-6)
    assert result.to_sensor().input_unit == "N"
    assert "modal mass" in done.output


def made(**changes):
    return replace(table(1, "accelerance", VALUES, HZ, quantity="force", response_unit="m/s^2"), **changes)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"model": "accelerometer"}, "needs a motion as its reference"),
        ({"model": "accelerance+mounting"}, "needs a motion as its reference"),
        ({"quantity": "acceleration"}, "needs a force as its reference"),
        ({"response_unit": "V"}, "not in the unit of accelerance"),
        ({"model": "mobility"}, "not in the unit of mobility"),
    ],
)
def test_a_model_of_the_other_kind_gets_one_sentence(changes, says):
    with pytest.raises(ModelError, match=says):
        vibrident.identify(made(**changes))


def test_what_needs_a_motion_refuses_a_force(tmp_path):
    result = vibrident.identify(made())
    with pytest.raises(InputError, match="response to a force cannot be described"):
        vibrident.export(result, "sacpz", tmp_path)
    with pytest.raises(InputError, match="carries a sensor of motion"):
        vibrident.predict_mounted(result, frequency_hz=100.0)
    time = np.arange(400) / 1e4
    moved = vibrident.Calibration.from_arrays(np.sin(600.0 * time), np.sin(600.0 * time), 1e4, response_unit="m/s^2")
    with pytest.raises(InputError, match="of another kind"):
        vibrident.predict(result, moved)
    vibrident.report(result, tmp_path / "report.md")
    report = (tmp_path / "report.md").read_text()
    assert "N" in report
    assert "modal mass" in report


def test_a_gain_behind_a_force_is_that_of_a_force_sensor():
    hz = np.array([100.0, 200.0])
    calibration = table(1, "gain", {"sensitivity": 0.01}, hz, quantity="force", response_unit="V")
    found = vibrident.identify(calibration).parameters["sensitivity"]
    assert found.unit == "V/N"
    assert found.value == pytest.approx(0.01, rel=5e-3)
