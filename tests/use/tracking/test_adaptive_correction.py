"""`correct --track`: a sensor that moved by 5 % between two records gives the acceleration back."""

from __future__ import annotations

import numpy as np
from tests.support.random_record import RATE_HZ, TRUTH
from tests.support.tracked import answered, motion

from vibrident import Calibration, correct, identify
from vibrident.use.tracking.adaptive import correct_tracked


def test_each_record_has_the_parameters_of_its_time(rng):
    moved = {**TRUTH, "sensitivity": 0.105, "natural_frequency": 1260.0}
    first = motion("random", 8000, rng)
    noise = 1e-4 * rng.normal(size=(3, 8000))
    known = identify(Calibration.from_arrays(first, answered(first) + noise[0], RATE_HZ, excitation="random"))
    second = motion("random", 8000, rng)
    pair = ([first, second], [answered(first) + noise[1], answered(second, moved) + noise[2]])
    records = Calibration.from_arrays(*pair, RATE_HZ, excitation="random")

    def errors(found):
        part = slice(500, -500)
        pairs = [(one.acceleration[part], one.reference[part]) for one in found.corrections]
        return [float(np.sqrt(np.mean((a - u) ** 2) / np.mean(u**2))) for a, u in pairs]

    fixed, adaptive = errors(correct(known, records)), errors(correct_tracked(known, records, band_hz=None, noise=None))
    floor = fixed[0]  # the noise alone: that sensor did not move
    assert adaptive[0] < 1.1 * floor
    assert fixed[1] > 5.0 * floor
    assert adaptive[1] < 1.1 * floor


def test_the_peak_of_a_shock_is_kept_within_half_a_percent(rng):
    """The certificate is of before sensitivity and resonance moved by 5 %; the shock follows a random motion."""
    moved = {**TRUTH, "sensitivity": 0.105, "natural_frequency": 1260.0}
    first, shock = motion("random", 8000, rng), np.zeros(8000)
    shock[4000:4040] = 10.0 * np.sin(np.pi * np.arange(40) / 40.0) ** 2  # 2 ms
    noise = 1e-4 * rng.normal(size=(3, 8000))
    known = identify(Calibration.from_arrays(first, answered(first) + noise[0], RATE_HZ, excitation="random"))
    pair = ([first, shock], [answered(first, moved) + noise[1], answered(shock, moved) + noise[2]])
    records = Calibration.from_arrays(*pair, RATE_HZ, excitation=["random", "shock"])

    def off(found):
        return float(np.max(found.corrections[1].acceleration)) / 10.0 - 1.0

    assert abs(off(correct(known, records))) > 0.03
    assert abs(off(correct_tracked(known, records, band_hz=None, noise=None))) < 0.005
