"""Shocks that run when the record begins: much of the response is the sensor's ringing from before."""

import numpy as np
import pytest
from bench.adversary.cases import BY_NAME
from bench.adversary.judge import judged

import vibrident
from vibrident.data.records import Calibration, Record
from vibrident.physics.models import parse

#: Times that acceleration is integrated to give the reference.
INTEGRATIONS = {"acceleration": 0, "velocity": 1, "displacement": 2}
#: A record is this part of the time in which the shock recurs.
PART = 1.0 / 1.37


def coloured(samples, rng):
    """Noise of a resonance at a fifth of the sampling rate, of power one."""
    noise = rng.standard_normal(samples + 200)
    for k in range(2, noise.size):
        noise[k] += 1.2 * np.cos(0.4 * np.pi) * noise[k - 1] - 0.64 * noise[k - 2]
    return noise[200:] / noise[200:].std()


def record(number, model, parameters, quantity, rate_hz, samples, level, rng):
    """Record that begins within a push of 4/rate to 14/rate, or in its ringing."""
    period = int(samples / PART)
    width = rng.uniform(1.0, 1.6) / (0.35 * 0.2 * rate_hz) / 4.292
    time = np.arange(period) / rate_hz - 0.25 * samples / rate_hz
    push = np.exp(-0.5 * (time / width) ** 2) - 0.25 * np.exp(-0.5 * ((time / width - 12.0) / 4.0) ** 2)
    hz = np.fft.rfftfreq(period, 1.0 / rate_hz)
    bins = np.where((hz > 0.0) & (hz < 0.45 * rate_hz), np.fft.rfft(push), 0.0)
    s = 2j * np.pi * np.maximum(hz, hz[1])
    sensor = parse(model).frequency_response(parameters, hz[1:])
    answer = bins * np.concatenate([[0.0], sensor])
    begin = int(0.25 * samples + rng.uniform(-1.0, 1.0) * 1.3 / (0.35 * 0.2))
    channels = [
        np.fft.irfft(rows, period)[begin : begin + samples] for rows in (bins / s ** INTEGRATIONS[quantity], answer)
    ]
    response = channels[1] + level * channels[1].std() * coloured(samples, rng)
    return Record(f"shock {number}", channels[0], response, rate_hz, "shock")


CASES = {
    "the likelier of two estimates": (
        "accelerometer+delay",
        {"sensitivity": 0.6, "natural_frequency": 253.6, "damping_ratio": 0.0036, "delay": 2.7e-4},
        "velocity",
        (4, 10_000.0, 2000, 3e-5),
    ),
    "a short delay": (
        "velocity-pickup+delay",
        {"generator_constant": 0.083, "natural_frequency": 35.3, "damping_ratio": 1.53, "delay": 1.36e-3},
        "displacement",
        (1, 2000.0, 2000, 4e-4),
    ),
}


#: Draws of each case.
DRAWS = [
    ("the likelier of two estimates", 2),
    ("the likelier of two estimates", 4),
    ("a short delay", 2),
    ("a short delay", 3),
]


@pytest.mark.parametrize(("name", "seed"), DRAWS)
@pytest.mark.quick("the likelier of two estimates-2", "a short delay-2", "a short delay-3")
def test_shocks_that_run_when_the_record_begins_are_fitted(name, seed):
    model, true, quantity, (count, rate_hz, samples, level) = CASES[name]
    rng = np.random.default_rng(seed)
    records = tuple(record(number, model, true, quantity, rate_hz, samples, level, rng) for number in range(count))
    result = vibrident.identify(Calibration(records=records, model=model, quantity=quantity))
    assert set(result.warning_codes) <= {"polarity", "weakly_determined"}
    for parameter_name, value in true.items():
        parameter = result.parameters[parameter_name]
        assert abs(parameter.value - value) < 4.0 * parameter.standard_uncertainty, parameter_name


def test_ringing_is_no_second_clock():
    """Of ringing alone another ratio of the clocks is another natural frequency."""
    outcome = judged(BY_NAME["quantities/displacement/velocity-pickup/shock running"].trial(78))
    assert outcome["class"] == "right"
    assert "clock_suspect" not in outcome["codes"]


@pytest.mark.parametrize(
    ("case", "run"),
    [
        ("quantities/displacement/velocity-pickup+highpass/shock running", 96),
        ("quantities/displacement/accelerometer+delay/shock running", 98),
        ("noises/strong ar2, response ar2/displacement/burst running", 96),
        pytest.param("clean/in-light/shock/hum 1 %", 98, marks=pytest.mark.slow),
        ("clean/in-light+delay=40/sweep/8 bit", 96),
    ],
)
def test_noise_of_the_reference_counts_by_the_response_of_each_place(case, run):
    """By a response without a model it was too small beside a resonance: χ²/ν was 284, or bins without motion told the
    start."""
    assert judged(BY_NAME[case].trial(run))["class"] == "right"


@pytest.mark.slow
def test_noise_that_leads_out_of_the_records_ends_the_rounds():
    """The delay ran off, and the records were refused as too short; the place before led to the sensor."""
    case = BY_NAME["quantities/acceleration/accelerometer+highpass+delay/shock running"]
    assert judged(case.trial(149))["class"] == "right"
