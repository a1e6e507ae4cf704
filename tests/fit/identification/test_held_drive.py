"""A drive in stairs, as a converter holds it between samples, is fitted as such and named."""

import numpy as np
import pytest
from scipy import signal

import vibrident
from vibrident.data.records import Calibration, Record
from vibrident.data.screening.held import is_held_drive

RATE_HZ, SAMPLES = 100.0, 3000


def stepped(seed, model="accelerometer", quantity="drive"):
    """A step into a system of 1/π Hz and damping 1.5; SciPy integrates the held input exactly."""
    time = np.arange(SAMPLES) / RATE_HZ
    drive = (time >= 2.0) * 1.0
    system = signal.TransferFunction([8.0], [1.0, 6.0, 4.0])
    response = signal.lsim(system, drive, time, interp=False)[1]
    response = response + 1e-3 * np.random.default_rng(seed).normal(size=SAMPLES)
    record = Record("step", drive, response, RATE_HZ, "random")
    return Calibration(records=(record,), model=model, quantity=quantity)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_held_step_is_fitted_as_held(seed):
    """As band-limited it was 18 u off and the sensor was blamed."""
    result = vibrident.identify(stepped(seed))
    for name, truth in {"natural_frequency": 1 / np.pi, "damping_ratio": 1.5}.items():
        stated = result.parameters[name]
        assert abs(stated.value - truth) < 4 * stated.standard_uncertainty
    assert result.fit.adequate
    assert result.warning_codes == ()
    assert "held between its samples" in result.settings["estimator_choice"]


def test_only_a_drive_that_repeats_is_held():
    assert is_held_drive(stepped(1))
    assert not is_held_drive(stepped(1, quantity="acceleration"))
    moving = np.random.default_rng(4).normal(size=SAMPLES)
    record = Record("noise", moving, moving, RATE_HZ, "random")
    assert not is_held_drive(Calibration(records=(record,), quantity="drive"))
