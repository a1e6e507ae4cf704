"""The Runge–Kutta response: its order, its limits, its agreement with the exact response in every case."""

import numpy as np
import pytest

from vibrident.base.errors import InputError
from vibrident.physics.models import parse
from vibrident.physics.simulation import (
    Decay,
    HalfSineShock,
    Sine,
    Superposition,
    Sweep,
    exact_response,
    excitation_noise,
    rk4_response,
)
from vibrident.physics.simulation.rk4 import classical_rk4

MODEL = parse("accelerometer+delay")
RATE, SAMPLES = 16000.0, 200
FELT = excitation_noise(
    1.0, sampling_rate_hz=RATE, samples=SAMPLES, rng=np.random.default_rng(1), band_hz=(0.0, 2000.0)
)
MOTIONS = [
    Sine(1000.0, 9.8, -np.pi / 2),
    Superposition((Sine(630.0, 9.8), FELT)),
    Sweep(100.0, 1500.0, 0.012, 9.8, taper=0.3),
    Decay(9.8),
]


def parameters(delay=0.0):
    return {"sensitivity": 0.104, "natural_frequency": 652.0, "damping_ratio": 0.182, "delay": delay}


def errors(start, substeps, delay):
    """Largest error of every motion, relative to its largest response."""
    p = parameters(delay)
    found = rk4_response(
        MODEL, p, MOTIONS, sampling_rates_hz=[RATE] * len(MOTIONS), samples=SAMPLES, start=start, substeps=substeps
    )
    truth = np.stack(
        [exact_response(MODEL, p, m, sampling_rate_hz=RATE, samples=SAMPLES, start=start) for m in MOTIONS]
    )
    return np.max(np.abs(found - truth), axis=1) / np.max(np.abs(truth), axis=1)


@pytest.mark.parametrize("start", ["rest", "steady"])
@pytest.mark.parametrize("delay", [0.0, 2.3 / RATE, -1.7 / RATE])
def test_the_order_is_four(start, delay):
    substeps = np.array([2, 4, 8, 16])
    table = np.array([errors(start, int(count), delay) for count in substeps])
    slopes = np.polyfit(np.log(1.0 / substeps), np.log(table), 1)[0]
    assert np.all(np.abs(slopes - 4.0) < 0.2), slopes
    assert np.all(table[-1] < 1e-6)


def test_records_of_different_rates_advance_together():
    rates = [8000.0, 16000.0, 48000.0]
    motions = [Sine(300.0, 1.0)] * 3
    together = rk4_response(MODEL, parameters(1e-4), motions, sampling_rates_hz=rates, samples=100)
    for row, rate in zip(together, rates, strict=True):
        alone = rk4_response(MODEL, parameters(1e-4), motions[:1], sampling_rates_hz=[rate], samples=100)[0]
        np.testing.assert_allclose(row, alone, rtol=1e-12, atol=1e-15)


def test_one_step_is_the_textbook_step():
    """ẏ = y − t² + 1, y(0) = 0.5, h = 0.5: y(0.5) = 1.4251302083333333 (Burden & Faires, sec. 5.4, as h = 0.5)."""
    drive = np.array([[0.0, 0.25, 0.5]]) ** 2
    found = classical_rk4(lambda y, t2: y - t2 + 1.0, np.array([[0.5]]), drive, np.array([0.5]))
    assert found[0, 1, 0] == pytest.approx(1.4251302083333333, rel=1e-14)


def test_shock_agrees_although_it_is_not_smooth():
    shock = HalfSineShock(50.0, 2e-3, 1e-3)  # edges on samples, so every step is smooth
    found = rk4_response(MODEL, parameters(), [shock], sampling_rates_hz=[RATE], samples=SAMPLES, substeps=8)[0]
    truth = exact_response(MODEL, parameters(), shock, sampling_rate_hz=RATE, samples=SAMPLES)
    assert np.max(np.abs(found - truth)) < 1e-6 * np.max(np.abs(truth))


def test_divergence_is_refused_before_it_happens():
    """|λ| h = 4.1 lies outside the stability region (2.83 on the imaginary axis)."""
    with pytest.raises(InputError) as caught:
        rk4_response(MODEL, parameters(), [Sine(10.0, 1.0)], sampling_rates_hz=[1000.0], samples=100)
    assert "diverges" in caught.value.problem
    assert "substeps" in caught.value.remedy
    rk4_response(MODEL, parameters(), [Sine(10.0, 1.0)], sampling_rates_hz=[1000.0], samples=100, substeps=2)


def test_no_steps_are_refused():
    with pytest.raises(InputError, match="substeps is not usable"):
        rk4_response(MODEL, parameters(), [Sine(10.0, 1.0)], sampling_rates_hz=[RATE], samples=100, substeps=0)
