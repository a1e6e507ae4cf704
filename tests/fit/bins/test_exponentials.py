"""Laws of exponentials at the bins: closed forms are the transforms of their samples."""

import numpy as np
import pytest

from vibrident.fit.bins.exponentials import motion_bins

SAMPLES = 1000
BINS = 400
#: On a bin, beside one, between two; oscillations that die away fast and slowly; a lag; an offset.
EXPONENTS = np.array([0.2j * np.pi, 2j * np.pi * 0.0123, -0.01 + 0.5j, -2.0 + 3.0j, -0.3, -30.0, 0.0])


@pytest.mark.parametrize("share_used", [1.0, 0.9])
@pytest.mark.parametrize("taper", [1.0, np.linspace(0.1, 2.0, SAMPLES)], ids=["whole", "tapered"])
def test_bins_in_closed_form_are_those_of_the_samples(share_used, taper, rng):
    """Of real and imaginary parts, and of both growing with time; with and without samples left out."""
    used = (rng.random(SAMPLES) < share_used) * taper
    time = np.arange(SAMPLES)
    waves = np.exp(EXPONENTS[:, None] * time)
    turning = EXPONENTS.imag != 0.0
    columns = [part for each in (waves, waves * time / SAMPLES) for part in (each.real, each.imag[turning])]
    expected = np.fft.rfft(np.concatenate(columns) * used)[:, :BINS]
    assert np.max(np.abs(motion_bins(EXPONENTS, used, BINS, growing=True) - expected)) < 1e-10
