"""The uncertainty budget: systematic effects act as brute-force changes of the data do; a published example."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import vibrident
from vibrident.data.io import write_calibration
from vibrident.data.records import Calibration, ResponseTable, SystematicEffect
from vibrident.fit.information import inverse_normal
from vibrident.physics.models import parse
from vibrident.physics.simulation import SENSORS

MODEL = parse("accelerometer+delay")
TRUTH = SENSORS["paper"].parameters | {"delay": 20e-6}
FREQUENCY = np.geomspace(20, 1500, 30)
NAMES = ("sensitivity", "natural_frequency", "damping_ratio", "delay")


def table(change=None, clock=0.0):
    h = MODEL.frequency_response(TRUTH, FREQUENCY)
    if change is not None:
        h = h * np.exp(change(FREQUENCY))
    size = np.abs(MODEL.frequency_response(TRUTH, FREQUENCY))
    return ResponseTable(FREQUENCY * (1.0 + clock), np.abs(h), np.unwrap(np.angle(h)), 0.002 * size, np.full(30, 0.002))


def identified(data, *effects):
    return vibrident.identify(Calibration(table=data, model="accelerometer+delay", effects=effects))


EFFECTS = {
    "gain": (SystematicEffect("voltmeter", "gain", 1e-3), lambda f: 1e-3 + 0 * f),
    "timing": (SystematicEffect("skew", "timing", 1e-6), lambda f: -2j * np.pi * f * 1e-6),
    "phase": (SystematicEffect("phase", "phase", 1e-3), lambda f: -1e-3j + 0 * f),
    "mounting": (SystematicEffect("mount", "mounting", 1e-4, 1000.0), lambda f: 1e-4 * (f / 1000.0) ** 2 + 0j),
}


@pytest.mark.parametrize("kind", EFFECTS)
def test_a_contribution_is_what_the_effect_does_to_the_fit(kind):
    effect, change = EFFECTS[kind]
    plain, stated, moved = identified(table()), identified(table(), effect), identified(table(change))
    row = stated.settings["uncertainty_budget"][1]
    assert row["source"] == effect.source
    assert row["type"] == "B"
    for name in NAMES:
        shift = abs(moved.parameters[name].value - plain.parameters[name].value)
        u = plain.parameters[name].standard_uncertainty
        assert row["contributions"][name] == pytest.approx(shift, rel=0.01, abs=1e-4 * u)
        total = np.hypot(u, row["contributions"][name])
        assert stated.parameters[name].standard_uncertainty == pytest.approx(total, rel=1e-9)


def test_the_sampling_clock_scales_the_natural_frequency_and_nothing_but_what_hangs_on_it():
    stated = identified(table(), SystematicEffect("clock", "clock", 1e-4))
    moved, plain = identified(table(clock=1e-4)), identified(table())
    row = stated.settings["uncertainty_budget"][1]["contributions"]
    for name in NAMES:
        shift = abs(moved.parameters[name].value - plain.parameters[name].value)
        u = plain.parameters[name].standard_uncertainty
        assert row[name] == pytest.approx(shift, rel=0.01, abs=1e-4 * u)
    assert row["natural_frequency"] == pytest.approx(1e-4 * TRUTH["natural_frequency"], rel=1e-3)


def test_more_data_do_not_reduce_what_is_common_to_them():
    effect = EFFECTS["mounting"][0]
    once = identified(table(), effect)
    data = table()
    finer = data.magnitude_uncertainty / 100
    sharper = replace(data, magnitude_uncertainty=finer, phase_uncertainty_rad=np.full(30, 2e-5))
    again = identified(sharper, effect)
    for name in NAMES:
        parts = [r.settings["uncertainty_budget"][1]["contributions"][name] for r in (once, again)]
        assert parts[0] == pytest.approx(parts[1], rel=1e-6)


def test_few_degrees_of_freedom_widen_the_interval():
    """Welch–Satterthwaite (GUM G.4): an effect known from two degrees of freedom rules the gain's coverage factor."""
    known = identified(table(), SystematicEffect("voltmeter", "gain", 0.01))
    guessed = identified(table(), SystematicEffect("voltmeter", "gain", 0.01, degrees_of_freedom=2.0))
    assert known.settings["coverage_factor"] == pytest.approx(1.96, abs=0.01)
    assert guessed.settings["coverage_factor"] == pytest.approx(4.30, abs=0.02)


def test_gum_h3_the_thermometer():
    """JCGM 100:2008, H.3: y1 = −0.1712(29) °C, y2 = 0.00218(67), r = −0.930, s = 0.0035 °C."""
    t = np.array([21.521, 22.012, 22.512, 23.003, 23.507, 23.999, 24.513, 25.002, 25.503, 26.010, 26.511])
    b = -np.array([0.171, 0.169, 0.166, 0.159, 0.164, 0.165, 0.156, 0.157, 0.159, 0.161, 0.160])
    a = np.stack([np.ones(11), t - 20.0], axis=1)
    inverse = inverse_normal(a.T @ a)
    y = inverse @ a.T @ b
    s = np.sqrt(np.sum((b - a @ y) ** 2) / 9)
    u = s * np.sqrt(np.diag(inverse))
    assert (round(y[0], 4), round(y[1], 5)) == (-0.1712, 0.00218)
    assert (round(u[0], 4), round(u[1], 5), round(s, 4)) == (0.0029, 0.00067, 0.0035)
    assert round(inverse[0, 1] / np.sqrt(inverse[0, 0] * inverse[1, 1]), 3) == -0.930


def test_a_calibration_file_states_them_and_keeps_them(tmp_path):
    effects = (EFFECTS["mounting"][0], SystematicEffect("voltmeter", "gain", 5e-4, degrees_of_freedom=50.0))
    calibration = Calibration(table=table(), model="accelerometer+delay", effects=effects)
    path = write_calibration(tmp_path / "again", calibration)
    assert "[[uncertainty]]" in path.read_text()
    assert vibrident.read(path).effects == effects
    wrong = path.read_text().replace("frequency_hz = 1000.0\n", "")
    path.write_text(wrong)
    with pytest.raises(vibrident.InputError, match="mounting"):
        vibrident.read(path)
