"""A converter's step is read from the values, and rounding is no misfit."""

from dataclasses import replace

import numpy as np
import pytest

import vibrident
from vibrident.data.screening.steps import converter_step

SHOCK = {"sampling_rate_hz": 20_000.0, "samples": 1000, "repeats": 6, "amplitude": 100.0}


def rounded(values, bits):
    """By a converter whose range is twice the peak."""
    step = 4.0 * float(np.max(np.abs(values))) / 2**bits
    return step * np.rint(values / step)


def test_the_step_is_read_where_values_repeat_on_a_grid():
    values = np.cumsum(np.random.default_rng(1).standard_normal(3000))
    assert converter_step(values) == 0.0
    assert converter_step(np.where(values > 10.0, 10.0, values)) == 0.0  # clipped, not rounded
    assert converter_step(0.3 + 0.25 * np.rint(values / 0.25)) == pytest.approx(0.25)
    assert converter_step(1e-12 * np.rint(values / 0.25)) == pytest.approx(1e-12)


def test_the_step_is_read_where_hardly_two_values_are_alike():
    """Of 500 values of 16 bits; of as many that no converter rounded there is none."""
    for seed in range(20):
        values = np.random.default_rng(seed).standard_normal(500)
        assert converter_step(values) == 0.0
        assert converter_step(rounded(values, 16)) == pytest.approx(4.0 * np.max(np.abs(values)) / 2**16)


@pytest.mark.parametrize("bits", [6, 10, 12, 14, 16, 18])
def test_the_step_is_read_of_numbers_of_single_precision(bits):
    """Their own steps grow with the numbers, which hid a converter's step of 12 bits or more."""
    times = np.arange(4000)
    for seed in range(5):
        rng = np.random.default_rng(seed)
        values = np.sin(rng.uniform(0.01, 3.0) * times) + 1e-3 * rng.standard_normal(times.size)
        single = 9.81 * rounded(values, bits).astype(np.float32).astype(float)
        assert converter_step(single) == pytest.approx(9.81 * 4.0 * np.max(np.abs(values)) / 2**bits, rel=1e-4)
        assert converter_step(values.astype(np.float32).astype(float)) < 1e-6


@pytest.mark.parametrize("bits", [8, 12, 16, 20, 24])
@pytest.mark.parametrize("period", [8, 25, 125])
def test_the_step_is_read_of_a_motion_in_step_with_the_sampling(bits, period):
    """Thousands of steps lie between any two; of four different sizes all may be multiples of a few steps."""
    for seed in range(10):
        phase, scale = np.random.default_rng(seed).uniform(0.0, 6.28), 9.81 * (1 + seed)
        values = np.tile(np.sin(2.0 * np.pi * np.arange(period) / period + phase), 8)
        assert converter_step(scale * values) == 0.0
        read = converter_step(scale * np.rint(values * 2.0 ** (bits - 1)) / 2.0 ** (bits - 1))
        steps = read * 2.0 ** (bits - 1) / scale
        assert steps == pytest.approx(round(steps), rel=1e-6)
        assert 1 <= round(steps) <= (1 if period > 8 else 4)


@pytest.mark.parametrize("bits", [8, 12])
@pytest.mark.draws(4, 8)
@pytest.mark.quick("few-8")
def test_steps_repeat_with_a_sweep_and_their_uncertainty_holds(bits, draws):
    """Six sweeps of one motion are rounded alike, which noise alone does not tell: z was 2.4 rms and up to 5.2."""
    distances = []
    for number in range(draws):
        true = {"sensitivity": 0.1, "natural_frequency": 300.0 * 1.35**number, "damping_ratio": 0.05 * (1 + number)}
        clean = vibrident.simulate(
            ("accelerometer", true), "sweep", samples=1000, sampling_rate_hz=10e3, repeats=6, amplitude=10.0,
            frequencies_hz=(50.0, 2000.0), response_noise=1e-5, seed=number,
        )  # fmt: skip
        records = [
            replace(r, reference=rounded(r.reference, bits), response=rounded(r.response, bits)) for r in clean.records
        ]
        result = vibrident.identify(vibrident.Calibration(records=tuple(records), model="accelerometer"))
        assert result.warning_codes == ()
        assert "steps of the converters" in result.settings["uncertainty_covers"]
        found = result.parameters
        distances += [(found[n].value - v) / found[n].standard_uncertainty for n, v in true.items()]
    assert 0.4 < np.sqrt(np.mean(np.square(distances))) < 1.4
    assert np.max(np.abs(distances)) < 4.0


@pytest.mark.parametrize("bits", [8, 12])
def test_a_shock_of_few_steps_is_clean_and_its_uncertainty_holds(bits):
    """Most of the record is still: what rounding does there is neither noise nor misfit, and is in u."""
    for seed in range(2):
        clean = vibrident.simulate("paper", "shock", response_noise=1e-5, seed=seed, **SHOCK)
        records = [r.with_response(rounded(r.response, bits), "") for r in clean.records]
        result = vibrident.identify(vibrident.Calibration(records=tuple(records), model="accelerometer"))
        assert result.warning_codes == (), seed
        for name, true in vibrident.physics.simulation.SENSORS["paper"].parameters.items():
            found = result.parameters[name]
            assert abs(found.value - true) < 4.0 * found.standard_uncertainty, (seed, name)


def sines(frequencies_hz, bits, seed, noise=1e-6, amplitude=1.0):
    """One second of each at 6400 Hz, by a converter of twice the amplitude; sensitivity one, fn 1200 Hz, δ 0.6."""
    rng = np.random.default_rng(seed)
    time, step = np.arange(6400) / 6400.0, 4.0 / 2**bits
    reference, response = [], []
    for frequency in frequencies_hz:
        wave = amplitude * np.exp(2j * np.pi * frequency * time + 1j * rng.uniform(0.0, 6.0))
        gain = 1.0 / (1.0 - (frequency / 1200.0) ** 2 + 1.2j * frequency / 1200.0)
        reference.append(wave.real + 1e-6 * rng.standard_normal(time.size))
        felt = (gain * wave).real + noise * rng.standard_normal(time.size)
        response.append(step * np.rint(felt / step))
    return vibrident.Calibration.from_arrays(reference, response, 6400.0, model="accelerometer")


TRUE = {"sensitivity": 1.0, "natural_frequency": 1200.0, "damping_ratio": 0.6}
IN_STEP = (20, 40, 80, 160, 200, 320, 400, 640, 800, 1280, 1600)


@pytest.mark.parametrize(("bits", "noise"), [(8, 1e-6), (12, 1e-6), (8, 6e-3)])
@pytest.mark.draws(1, 2)
@pytest.mark.quick("few-8-1e-06", "few-8-0.006")
def test_sines_in_step_with_the_sampling_are_rounded_alike_in_every_period(bits, noise, draws):
    """A few samples a period have a few errors, which no longer record averages: they passed for a bent sensor."""
    distances = []
    for seed in range(draws):
        result = vibrident.identify(sines(IN_STEP, bits, seed, noise))
        assert result.warning_codes == ()
        found = result.parameters
        distances += [(found[n].value - v) / found[n].standard_uncertainty for n, v in TRUE.items()]
        assert found["natural_frequency"].value == pytest.approx(1200.0, rel=0.5 / 2**bits + 1e-3)
    assert np.max(np.abs(distances)) < 4.0


def test_the_step_between_few_values_is_that_of_their_common_grid():
    assert converter_step(np.tile([0.0, 13.0, 28.0, -7.0], 100) * 2.5e-3) == pytest.approx(2.5e-3)
    assert converter_step(np.tile([0.0, 130.0, 287.0, -71.0], 100) * 2.5e-3 + 1.0) == pytest.approx(2.5e-3)


def test_steps_of_a_model_without_a_network_are_looked_at_without_a_prediction():
    calibration = sines(IN_STEP, 12, 1)
    result = vibrident.identify(calibration, model="accelerometer+boxcar")  # a warning would be an error
    assert result.fit.adequate
