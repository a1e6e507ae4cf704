"""A sensor far above the sampling rate is found from records that begin within a shock."""

import numpy as np

import vibrident
from vibrident.data.records import Calibration, Record
from vibrident.physics.models import parse

RATE_HZ = 51_200.0
SAMPLES = 1000
TRUE = {"sensitivity": 1.3e-5, "natural_frequency": 121_000.0, "damping_ratio": 0.04}


def record(number, rng):
    """Steady part of a push that recurs after 1370 samples; the record begins within it."""
    time = np.arange(1370) - 250.0
    width = rng.uniform(1.0, 1.6) / 0.07 / 4.292
    push = np.exp(-0.5 * (time / width) ** 2) - 0.25 * np.exp(-0.5 * ((time / width - 12.0) / 4.0) ** 2)
    hz = np.fft.rfftfreq(1370, 1.0 / RATE_HZ)
    bins = np.where((hz > 0.0) & (hz < 0.45 * RATE_HZ), np.fft.rfft(push), 0.0)
    answer = bins * parse("accelerometer").frequency_response(TRUE, hz)
    begin = 250 + int(rng.uniform(-18.0, 18.0))
    moved, answered = (np.fft.irfft(rows, 1370)[begin : begin + SAMPLES] for rows in (bins, answer))
    brown = np.cumsum(rng.standard_normal(SAMPLES))
    answered = answered + 3e-5 * answered.std() * (brown - brown.mean()) / brown.std()
    moved = moved + 7.5e-5 * moved.std() * rng.standard_normal(SAMPLES)
    return Record(f"shock {number}", moved, answered, RATE_HZ, "shock")


def test_the_descent_does_not_end_at_the_sampling_rate():
    for seed in range(6):
        rng = np.random.default_rng(seed)
        records = tuple(record(number, rng) for number in range(8))
        result = vibrident.identify(Calibration(records=records, model="accelerometer", quantity="acceleration"))
        natural = result.parameters["natural_frequency"]
        assert abs(natural.value - TRUE["natural_frequency"]) < 4.0 * natural.standard_uncertainty, seed
