"""A sensor that changes within a record: its regimes, their times, and what they have in common."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.support.changed_sensor import Life, answered, calibration

from vibrident import Calibration, Result, identify
from vibrident.physics.simulation import Sensor, simulate, with_noise
from vibrident.use.regimes.pieces import is_alike_throughout

RATE_HZ = 8000.0
SAMPLES = 12000
SHORT = 6000

#: Lives of a sensor, and the parameters that stay the same.
CASES = {
    "range switch": ([(0, 600.0, 0.1, 0.1), (2500, 600.0, 0.1, 1.0)], {"natural_frequency", "damping_ratio"}),
    "resistor in and out": (
        [(0, 600.0, 0.1, 0.1), (2000, 600.0, 0.3, 0.1), (4000, 600.0, 0.1, 0.1)],
        {"sensitivity", "natural_frequency"},
    ),
    "everything": ([(0, 600.0, 0.1, 0.1), (3500, 640.0, 0.2, 0.102)], set()),
}


def off(result: Result, lives: list[Life]) -> tuple[float, float]:
    """Largest deviation of a parameter, in u, and of a time, in periods."""
    regimes = result.settings["regimes"]
    assert len(regimes) == len(lives)
    units, periods = [], []
    for regime, life in zip(regimes, lives, strict=True):
        stated = list(regime["parameters"].values())
        values = np.array([each["value"] for each in stated])
        u = np.array([each["standard_uncertainty"] for each in stated])
        units.append(np.max(np.abs(values - life.values) / u))
        periods.append(abs(regime["from_s"] - life.first / RATE_HZ) * life.natural_hz)
    return float(np.max(units)), float(np.max(periods))


@pytest.mark.parametrize("name", CASES)
def test_each_regime_is_found_with_its_time_and_what_stays_the_same(name, rng):
    stated, common = CASES[name]
    lives = [Life(*each) for each in stated]
    result = identify(calibration(rng, lives, SHORT, 1e-3))
    units, periods = off(result, lives)
    assert units < 4.0
    assert periods < 2.0
    assert result.warning_codes[0] == "regimes"
    assert [finding.time_s for finding in result.findings] == [
        regime["from_s"] for regime in result.settings["regimes"][1:]
    ]
    regimes = [each["parameters"] for each in result.settings["regimes"]]
    same = {name for name in regimes[0] if len({each[name]["value"] for each in regimes}) == 1}
    assert same == common
    longest = max(result.settings["regimes"], key=lambda each: each["to_s"] - each["from_s"])
    for key, each in longest["parameters"].items():
        assert result.parameters[key].value == pytest.approx(each["value"], rel=1e-9)
        assert result.parameters[key].standard_uncertainty == pytest.approx(each["standard_uncertainty"], rel=1e-6)


def test_common_parameters_are_known_better(rng):
    """Two halves of one sensor but for its gain: damping is known by both."""
    lives = [Life(0, 600.0, 0.1, 0.1), Life(SHORT // 2, 600.0, 0.1, 0.11)]
    result = identify(calibration(rng, lives, SHORT, 1e-3))
    alone = identify(calibration(rng, lives[:1], SHORT // 2, 1e-3))
    gain = alone.parameters["damping_ratio"].standard_uncertainty
    assert result.parameters["damping_ratio"].standard_uncertainty == pytest.approx(gain / np.sqrt(2.0), rel=0.15)


def test_a_sensor_that_stays_has_no_regimes(rng):
    result = identify(calibration(rng, [Life(0, 600.0, 0.1, 0.1)], SHORT, 1e-3))
    assert not result.warnings
    assert "regimes" not in result.settings


def test_another_model_is_no_change(rng):
    """A sensor with a second mode is the same throughout: the model is what is named."""
    sensor = {"sensitivity": 0.1, "natural_frequency": 600.0, "damping_ratio": 0.1}
    sensor |= {"mode2_frequency": 900.0, "mode2_damping": 0.02, "mode2_gain": 0.05}
    loose = Sensor("loose", "accelerometer with a second mode", "accelerometer+mode2", sensor)
    motion = {"sampling_rate_hz": RATE_HZ, "samples": SAMPLES, "frequencies_hz": [10.0, 1500.0]}
    record = simulate(loose, "random", **motion, repeats=1, seed=1)
    result = identify(with_noise(record, response_noise=1e-3, seed=2), "accelerometer")
    assert "regimes" not in result.settings
    assert result.settings["explained_by"] == "accelerometer+mode2"


def pulses(rng: np.random.Generator) -> np.ndarray:
    """A train of pulses, one about every fiftieth of a second, of different sizes."""
    time_s = np.arange(SAMPLES) / RATE_HZ
    begins = np.arange(150, SAMPLES, 400) / RATE_HZ
    sizes = rng.uniform(0.5, 1.5, begins.size)
    return sum(s * np.exp(-0.5 * ((time_s - at) / 2e-4) ** 2) for s, at in zip(sizes, begins, strict=True))


@pytest.mark.parametrize(("excitation", "quantity"), [("shock", "acceleration"), ("random", "drive")])
@pytest.mark.quick("shock-acceleration")
def test_a_resistor_switched_in_under_pulses_and_under_a_held_drive(rng, excitation, quantity):
    """Between pulses the sensor is at rest: the change is seen by the next one."""
    lives = [Life(0, 600.0, 0.1, 0.1), Life(6000, 600.0, 0.3, 0.1)]
    u = pulses(rng) if excitation == "shock" else rng.standard_normal(SAMPLES // 16).repeat(16)
    y = answered(u, RATE_HZ, lives)
    y = y + 1e-3 * np.std(y) * rng.normal(size=SAMPLES)
    result = identify(Calibration.from_arrays(u, y, RATE_HZ, quantity=quantity, excitation=excitation))
    units, _ = off(result, lives)
    assert units < 4.0
    assert result.settings["regimes"][1]["from_s"] == pytest.approx(6000 / RATE_HZ, abs=400 / RATE_HZ)


def test_motion_that_is_not_alike_shows_no_regimes():
    """A sweep shows each mode at another time, a single shock is over soon."""
    sensor = {"sensitivity": 0.1, "natural_frequency": 600.0, "damping_ratio": 0.1}
    sensor |= {"mode2_frequency": 900.0, "mode2_damping": 0.02, "mode2_gain": 0.05}
    loose = Sensor("loose", "accelerometer with a second mode", "accelerometer+mode2", sensor)
    for kind in ("sweep", "shock"):
        motion = {"sampling_rate_hz": RATE_HZ, "samples": SAMPLES, "frequencies_hz": [10.0, 1500.0]}
        (record,) = simulate(loose, kind, **motion, repeats=1, seed=1).records
        assert not is_alike_throughout(record)
    assert is_alike_throughout(replace(record, reference=pulses(np.random.default_rng(1))))


def draw(rng: np.random.Generator) -> tuple[list[Life], float]:
    """Two or three lives of a fifth of a record or more, and the noise."""
    count = int(rng.integers(2, 4))
    parts = 0.2 + (1.0 - 0.2 * count) * rng.dirichlet(np.ones(count))
    first = np.concatenate([[0.0], np.cumsum(parts)[:-1]])
    life = Life(0, float(rng.uniform(200.0, 900.0)), float(rng.uniform(0.03, 0.5)), 0.1)
    lives = [life]
    for begin in (first[1:] * SAMPLES).astype(int).tolist():
        gain, natural_hz, damping = life.gain, life.natural_hz, life.damping
        kind = rng.choice(["range", "gain", "damping", "frequency", "all"])
        if kind in ("gain", "all"):
            gain *= float(np.exp(rng.choice([-1.0, 1.0]) * rng.uniform(0.01, 0.3)))
        if kind == "range":
            gain *= float(rng.choice([0.1, 10.0]))
        if kind in ("damping", "all"):
            factor = rng.uniform(1.3, 4.0)
            damping = float(min(damping * factor, 0.9) if damping < 0.6 else damping / factor)
        if kind in ("frequency", "all"):
            natural_hz *= float(1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.01, 0.1))
        life = Life(begin, natural_hz, damping, gain)
        lives.append(life)
    return lives, float(10.0 ** rng.uniform(-4.0, -2.0))


@pytest.mark.slow
def test_a_hundred_drawn_records():
    """Times within two periods and parameters within 4 u in 95 of 100; none is silent."""
    right, silent = 0, []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        lives, noise = draw(rng)
        result = identify(calibration(rng, lives, SAMPLES, noise))
        if not result.warnings:
            silent.append(seed)
        if len(result.settings.get("regimes", [])) == len(lives):
            units, periods = off(result, lives)
            right += units < 4.0 and periods < 2.0
    assert not silent
    assert right >= 95


def test_a_model_that_lacks_a_delay_is_not_sought_in_pieces(rng, monkeypatch):
    """What it leaves is coherent with the motion: a sensor that stays explains the record, and no piece is fitted."""

    def no_pieces(*_):
        raise AssertionError("pieces are fitted")

    monkeypatch.setattr("vibrident.use.regimes.identification.find_regimes", no_pieces)
    (whole,) = calibration(rng, [Life(0, 600.0, 0.1, 0.1)], SHORT, 1e-3).records
    channels = whole.reference[3:], whole.response[:-3]
    late = Calibration.from_arrays(*channels, RATE_HZ, quantity="acceleration", excitation="random")
    assert "lack_of_fit" in identify(late, "accelerometer").warning_codes
