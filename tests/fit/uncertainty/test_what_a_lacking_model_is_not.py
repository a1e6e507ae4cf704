"""A linear sensor that the model does not describe is said to lack a fit, and neither to be nonlinear nor to change."""

import numpy as np
import pytest

import vibrident

RATE, SAMPLES, S0, FN, DAMPING = 20000.0, 4000, 0.01, 2500.0, 0.03
FREQUENCY = np.array([40, 160, 630, 1250, 2000, 2500, 3150, 4000.0])


def oscillator(f, natural=FN):
    return S0 / (1 - (f / natural) ** 2 + 2j * DAMPING * f / natural)


SENSORS = {
    "another resonance beside it": lambda f: oscillator(f) + 0.1 * oscillator(f, 2600.0),
    "electronics of second order": lambda f: oscillator(f) / (1 + 1.41j * f / 6000 - (f / 6000) ** 2),
    "decimation filter of third order": lambda f: oscillator(f) * np.sinc(f / RATE) ** 3,
    "damping of a viscoelastic": lambda f: S0 / (1 - (f / FN) ** 2 + 2 * DAMPING * (1j * f / FN) ** 0.7),
}


@pytest.mark.parametrize("name", SENSORS)
@pytest.mark.quick("decimation filter of third order")
def test_it_neither_changes_nor_depends_on_the_amplitude(name):
    time, rng = np.arange(SAMPLES) / RATE, np.random.default_rng(7)
    waves = [np.exp(2j * np.pi * f * time) for f in np.round(FREQUENCY * SAMPLES / RATE) * RATE / SAMPLES]
    noise = 1e-4 * rng.standard_normal((len(waves), SAMPLES))
    reference = [10.0 * w.real for w in waves]
    response = [(10.0 * h * w).real + e for h, w, e in zip(SENSORS[name](FREQUENCY), waves, noise, strict=True)]
    result = vibrident.identify(vibrident.Calibration.from_arrays(reference, response, RATE))
    assert "lack_of_fit" in result.warning_codes
    assert "regimes" not in result.warning_codes
    assert not [w for w in result.warnings if "amplitude" in w.message]
