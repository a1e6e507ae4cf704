"""State that the first fit reaches the optimum where starts of other kinds were led astray."""

import numpy as np
import pytest
from bench.adversary.cases import BY_NAME

from vibrident import identify
from vibrident.data.records import Calibration, Record

RATE_HZ = 1000.0
SAMPLES = 600
#: Sensitivity, natural frequency and damping ratio of a sensor whose resonance is above half the rate.
TRUTH = {"sensitivity": 2.0, "natural_frequency": 600.0, "damping_ratio": 0.1}
#: Noise of the reference and of the response, relative to their standard deviations.
NOISE = 0.02, 1e-3


def response_at(frequency_hz, sensitivity, natural_frequency, damping_ratio):
    relative = frequency_hz / natural_frequency
    return sensitivity / (1.0 - relative**2 + 2j * damping_ratio * relative)


def four_shocks(seed):
    rng = np.random.default_rng(seed)
    time_s = np.arange(SAMPLES) / RATE_HZ
    response = response_at(np.fft.rfftfreq(4 * SAMPLES, 1.0 / RATE_HZ), **TRUTH)
    made = []
    for number, width_s in enumerate(rng.uniform(0.006, 0.009, 4)):
        reference = np.exp(-0.5 * ((time_s - 0.2) / width_s) ** 2)
        output = np.fft.irfft(response * np.fft.rfft(reference, 4 * SAMPLES), 4 * SAMPLES)[:SAMPLES]
        reference, output = (
            values + level * values.std() * rng.normal(size=SAMPLES)
            for values, level in zip((reference, output), NOISE, strict=True)
        )
        made.append(Record(f"shock-{number}", reference, output, RATE_HZ, "shock"))
    return Calibration(records=tuple(made), model="accelerometer")


def least_uncertainty(calibration):
    """Return Cramér and Rao's limit for the sensitivity, the noise of both channels known."""
    information = np.zeros((3, 3))
    frequency_hz = np.fft.rfftfreq(SAMPLES, 1.0 / RATE_HZ)[1:]
    through = response_at(frequency_hz, **TRUTH)
    steps = [{**TRUTH, name: value * (1.0 + 1e-6)} for name, value in TRUTH.items()]
    slopes = np.stack([response_at(frequency_hz, **step) - through for step in steps])
    slopes /= 1e-6 * np.array(list(TRUTH.values()))[:, None]
    for record in calibration.records:
        of_reference, of_response = (
            (level * np.std(values)) ** 2
            for values, level in zip((record.reference, record.response), NOISE, strict=True)
        )
        # The motion is its transform less the noise in it: all of that is beyond some 60 Hz.
        motion = np.fft.rfft(record.reference)[1:] * (frequency_hz < 60.0)
        columns = slopes * motion / np.sqrt(0.5 * SAMPLES * (of_response + of_reference * np.abs(through) ** 2))
        information += (columns @ columns.conj().T).real
    return float(np.sqrt(np.linalg.inv(information)[0, 0]))


@pytest.mark.parametrize("seed", [5, 6, 7, 8, 10])
@pytest.mark.quick("5", "6", "8")
def test_noise_of_the_reference_does_not_lead_shocks_to_a_resonance_at_infinity(seed):
    """The bins that show motion do not tell initial states that ring above half the rate. Elsewhere these are no noise:
    of four shocks with 2 % of noise in the reference the resonance at 600 Hz was stated at 8.7 kHz. Where χ² rises by
    3 towards infinity, its interval has no end there."""
    calibration = four_shocks(seed)
    result = identify(calibration)
    assert result.fit.adequate
    for name, value in TRUTH.items():
        found = result.parameters[name]
        low, high = found.interval_95
        u = found.standard_uncertainty
        assert (u is None) == ((name, seed) == ("natural_frequency", 7))
        assert low < value < (high or np.inf) if u is None else abs(found.value - value) < 4.0 * u
        assert found.value < 1.5 * value
    stated = result.parameters["sensitivity"].standard_uncertainty or np.nan
    assert 0.7 < stated / least_uncertainty(calibration) < 1.5


@pytest.mark.parametrize(
    ("name", "seed"),
    [
        ("clean/in-light/multisine/8 bit", 27),
        ("clean/pickup-in-light/multisine/8 bit", 28),
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
