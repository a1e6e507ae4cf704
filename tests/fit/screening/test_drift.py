"""A drift that the motion does not explain is told from noise of any colour."""

import numpy as np

from vibrident.data.records import Record
from vibrident.fit.screening.drift import slow_tones, without_drift

N, RATE = 1000, 1e3
T = np.arange(N) / RATE


def record(values):
    return Record("r", np.sin(2.0 * np.pi * 40.0 * T), np.sin(2.0 * np.pi * 40.0 * T) + values, RATE, "random")


def noise(rng, power):
    """Of this power of frequency, standard deviation one."""
    lines = np.fft.rfft(rng.standard_normal(N)) * np.maximum(np.arange(N // 2 + 1), 1.0) ** (power / 2.0)
    values = np.fft.irfft(lines, N)
    return values / np.std(values)


def test_noise_that_grows_with_frequency_is_no_drift():
    """As that of a displacement does in a prediction: a slope draws noise of all frequencies."""
    rng = np.random.default_rng(1)
    for power in (-1.0, 0.0, 4.0, 6.0):
        for _ in range(50):
            predicted = np.sin(2.0 * np.pi * 40.0 * T) + 30.0 * noise(rng, power)
            _, findings = without_drift([record(0.0)], [predicted])
            assert findings == ()


def test_a_drift_is_found_and_taken_out():
    rng = np.random.default_rng(2)
    for power in (0.0, 6.0):
        own = 0.01 * noise(rng, power)
        (kept,), findings = without_drift([record(own + 0.2 * T)], [np.sin(2.0 * np.pi * 40.0 * T)])
        assert [found.code for found in findings] == ["drift"]
        slope = np.polyfit(T, kept.response - np.sin(2.0 * np.pi * 40.0 * T) - own, 1)[0]
        assert abs(slope) < 0.01


def settling(time_constant):
    """A zero that settles, as while an amplifier warms up."""
    return 1.0 - np.exp(-T / time_constant)


def test_a_zero_that_settles_is_left_to_the_fit():
    """Whether large or small; only what matters is said. The noise of a record, up to 1/f, is none."""
    rng = np.random.default_rng(3)
    predicted = np.sin(2.0 * np.pi * 40.0 * T)
    for power in (-1.0, 0.0, 4.0):
        for _ in range(30):
            (kept,), findings = without_drift([record(0.005 * noise(rng, power))], [predicted])
            assert (slow_tones(kept), findings) == ((), ())
    for size, own, codes in ((0.3, 5e-3, ["drift"]), (0.01, 1e-4, [])):
        (kept,), findings = without_drift([record(own * noise(rng, 0.0) + size * settling(0.4))], [predicted])
        assert slow_tones(kept)
        assert [found.code for found in findings] == codes
        assert np.std(kept.response - predicted) < 1.2 * own  # what is looked for in the residual does not meet it
