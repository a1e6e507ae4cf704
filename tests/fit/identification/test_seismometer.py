"""A seismometer by its coil, as observatories calibrate: step, pulses, random current; mass position and velocity."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from vibrident import Calibration, Result, identify

#: Poles of the STS-2 as its response files state them, rad/s; its makers state 120 s and 0.707.
PUBLISHED = np.array([-0.037004 + 0.037016j, -0.037004 - 0.037016j])
RATE_HZ, SAMPLES, FINER = 4.0, 6000, 8
MOTOR = 0.4  # response unit per unit of current


def current(kind: str, rng: np.random.Generator) -> np.ndarray:
    """A current through the calibration coil, held between the samples of its converter."""
    time_s = np.arange(SAMPLES) / RATE_HZ
    if kind == "step":
        return np.where(time_s < 60.0, 0.0, 1.0)
    if kind == "pulses":
        return np.where((time_s % 400.0 >= 60.0) & (time_s % 400.0 < 75.0), 1.0, 0.0)
    return rng.standard_normal(SAMPLES // 8).repeat(8)


def driven(kind: str, output: str, seed: int = 1) -> Result:
    """The response to a current, integrated exactly between the samples, with 1e-3 of noise, identified."""
    rng = np.random.default_rng(seed)
    drive = current(kind, rng)
    numerator = [MOTOR, 0.0] if output == "velocity" else [MOTOR * float(np.abs(PUBLISHED[0])) ** 2]
    system = signal.lti(numerator, np.poly(PUBLISHED).real)
    time_s = np.arange(FINER * SAMPLES) / (FINER * RATE_HZ)
    response = signal.lsim(system, drive.repeat(FINER), time_s, interp=False)[1][::FINER]
    response = response + 1e-3 * np.std(response) * rng.standard_normal(SAMPLES)
    excitation = "shock" if kind == "pulses" else "random"
    model = "velocity-pickup" if output == "velocity" else "accelerometer"
    calibration = Calibration.from_arrays(
        drive, response, RATE_HZ, quantity="drive", excitation=excitation, model=model, reference_unit="A"
    )
    return identify(calibration)


@pytest.mark.parametrize("output", ["velocity", "mass position"])
@pytest.mark.parametrize("kind", ["step", "pulses", "random"])
def test_the_coil_gives_the_published_period_and_damping(kind, output):
    result = driven(kind, output)
    assert result.warning_codes == ()
    natural_hz, damping = (result.parameters[name] for name in ("natural_frequency", "damping_ratio"))
    size = float(np.abs(PUBLISHED[0]))
    assert natural_hz.value == pytest.approx(size / (2.0 * np.pi), abs=4.0 * natural_hz.standard_uncertainty)
    assert damping.value == pytest.approx(-PUBLISHED[0].real / size, abs=4.0 * damping.standard_uncertainty)
    gain = result.parameters["generator_constant" if output == "velocity" else "sensitivity"]
    assert gain.value == pytest.approx(MOTOR, abs=4.0 * gain.standard_uncertainty)
    assert damping.value == pytest.approx(0.707, abs=0.002)
    if output == "velocity":
        period = result.parameters["free_period"]
        assert period.unit == "s"
        assert period.value == pytest.approx(120.0, rel=2e-3)
        relative = natural_hz.standard_uncertainty / natural_hz.value
        assert period.standard_uncertainty == pytest.approx(period.value * relative, rel=1e-9)


def test_poles_are_those_of_the_published_response():
    poles = driven("random", "velocity").to_sensor().to_scipy().poles
    np.testing.assert_allclose(np.sort_complex(poles), np.sort_complex(PUBLISHED), rtol=2e-3)
