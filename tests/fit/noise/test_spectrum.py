"""The noise spectrum of a residual, against noise of known size."""

import numpy as np
import pytest

from vibrident.fit.noise.spectrum import PredictedMotion, noise_spectrum


@pytest.mark.parametrize("natural", [0.01, 0.1])
@pytest.mark.parametrize("samples", [1000, 4000])
def test_noise_of_the_reference_is_told_without_motion(samples: int, natural: float) -> None:
    """White, through a high-pass: residual and prediction are coherent, and no error of the model is taken for that.

    The mean of twenty within 10 %, and each within 30 %.
    """
    frequency = np.arange(samples // 2 + 1) / samples / natural
    transfer = frequency**2 / (frequency**2 - 1.0 - 0.8j * frequency)
    found = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        reference, response = (np.fft.rfft(size * rng.normal(size=samples)) for size in (1.0, 0.01))
        predicted = transfer * reference
        motion = PredictedMotion(predicted, float(samples), int(0.4 * samples), np.abs(transfer) ** 2)
        found.append(noise_spectrum(response - predicted, motion, 0.0).input_noise)
    assert np.mean(found) == pytest.approx(1.0, abs=0.1)
    assert np.all(np.abs(np.array(found) - 1.0) < 0.3)
