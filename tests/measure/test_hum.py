"""Hum is found in a residual by its frequency, taken out, and is no misfit; a misfit is no hum."""

import numpy as np

import vibrident
from vibrident.measure.hum import without_hum
from vibrident.simulation import simulate

RATE, N = 2000.0, 1000
P = {"sensitivity": 0.1, "natural_frequency": 120.0, "damping_ratio": 0.6}
TONES = np.geomspace(10.3, 395.0, 15)


def humming(seed, hum=0.01):
    """Multisine records with hum and its third harmonic, between lines."""
    clean = simulate(
        ("accelerometer", P), "multisine", frequencies_hz=TONES, sampling_rate_hz=RATE, samples=N, repeats=4,
        response_noise=1e-3, start="steady", seed=seed,
    )  # fmt: skip
    rng, t, records = np.random.default_rng(seed), np.arange(N) / RATE, []
    for record in clean.records:
        size, phase = hum * np.sqrt(2.0) * np.std(record.response), 2.0 * np.pi * rng.random(2)
        wave = np.cos(2 * np.pi * 24.7 * t + phase[0]) + 0.3 * np.cos(2 * np.pi * 74.1 * t + phase[1])
        records.append(record.with_response(record.response + size * wave, ""))
    return clean, vibrident.Calibration(records=tuple(records), model="accelerometer")


def test_a_clean_sensor_beside_hum_is_adequate():
    for seed in range(3):
        result = vibrident.identify(humming(seed)[1])
        assert result.warning_codes == (), seed
        for name, true in P.items():
            found = result.parameters[name]
            assert abs(found.value - true) < 4.0 * found.standard_uncertainty


def test_hum_is_taken_out_and_a_misfit_of_the_motion_is_not():
    clean, calibration = humming(1)
    predicted = [r.response for r in clean.records]
    records, count = without_hum(calibration.records, predicted)
    assert count == len(records)
    for record, v in zip(records, predicted, strict=True):
        assert np.std(record.response - v) < 1e-3 * np.std(v)
    assert without_hum(clean.records, [1.02 * v for v in predicted])[1] == 0
