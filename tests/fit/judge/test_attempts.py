"""State that the first fit reaches the optimum where starts of other kinds were led astray."""

import numpy as np
import pytest
from bench.adversary.cases import BY_NAME

from vibrident import identify
from vibrident.data.records import Calibration, Record


@pytest.mark.xfail(reason="initial states that the heard bins do not tell are read as noise", strict=False)
def test_noise_of_the_reference_does_not_lead_shocks_to_a_resonance_at_infinity():
    """Σ Y X*/Σ |X|² of bands that hold nothing else is drawn to zero: of four shocks with 2 % of it the model was
    rejected, at 60 kHz where the resonance is at 600 Hz."""
    rng, rate, n = np.random.default_rng(5), 1000.0, 600
    time_s, relative = np.arange(n) / rate, np.fft.rfftfreq(4 * n, 1.0 / rate) / 600.0
    response = 2.0 / (1.0 - relative**2 + 0.2j * relative)
    made = []
    for number, width_s in enumerate(rng.uniform(0.006, 0.009, 4)):
        reference = np.exp(-0.5 * ((time_s - 0.2) / width_s) ** 2)
        output = np.fft.irfft(response * np.fft.rfft(reference, 4 * n), 4 * n)[:n]
        reference, output = (v + u * v.std() * rng.normal(size=n) for v, u in ((reference, 0.02), (output, 1e-3)))
        made.append(Record(f"shock-{number}", reference, output, rate, "shock"))
    result = identify(Calibration(records=tuple(made), model="accelerometer"))
    found = result.parameters["natural_frequency"]
    assert found.standard_uncertainty is not None
    assert abs(found.value - 600.0) < 4.0 * found.standard_uncertainty
    assert result.fit.adequate


@pytest.mark.parametrize(
    ("name", "seed"),
    [
        ("clean/in-light/multisine/8 bit", 27),
        pytest.param(
            "clean/pickup-in-light/multisine/8 bit",
            28,
            marks=pytest.mark.xfail(reason="false hum beside the resonance", strict=False),
        ),
    ],
)
def test_a_displacement_of_eight_bits_leads_to_the_resonance_that_its_steps_hide(name, seed):
    """The steps of the reference, which the sensor's model raises with the square of the frequency, draw equal weights
    to a third of the natural frequency, and to a hundredth of the sensitivity."""
    trial = BY_NAME[name].trial(seed)
    result = identify(trial.calibration(), model=trial.model)
    assert set(result.warning_codes) <= {"weakly_determined"}
    for parameter in ("natural_frequency", "damping_ratio"):
        found = result.parameters[parameter]
        assert found.standard_uncertainty is not None
        assert abs(found.value - trial.truth[parameter]) < 4.0 * found.standard_uncertainty
