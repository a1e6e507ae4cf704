"""A faster converter with the same density of noise knows no less, and motion is found wherever it is in a record."""

from __future__ import annotations

import re

import numpy as np
import pytest

from vibrident.data.interferometer import rough
from vibrident.data.interferometer.choice import choose
from vibrident.data.interferometer.demodulation import demodulate
from vibrident.data.interferometer.effects import effects
from vibrident.data.interferometer.rough import at_needed_rate, highest_frequency, rough_frequency
from vibrident.data.interferometer.setting import Interferometer, signals_in_memory
from vibrident.data.interferometer.survey import survey
from vibrident.data.io import read
from vibrident.physics.simulation.optics import Optics, write_optical_calibration

SETTING = Interferometer("quadrature", 632.991e-9, direction=1)
HERTZ, SECONDS, SLOWEST = 1e4, 0.04, 4e5


def found(rate, swing, noise, seed):
    """Error of a sine's amplitude, and its u by the ellipse, from a record of less than a fringe."""
    random = np.random.default_rng([seed, int(rate)])
    time = np.arange(int(rate * SECONDS)) / rate
    phase = swing * np.cos(2.0 * np.pi * HERTZ * time + 0.3) + 0.7 + seed
    u = np.stack([0.05 + np.cos(phase), -0.03 + 0.85 * np.sin(phase + 0.12)])
    u = u + noise * np.sqrt(rate / SLOWEST) * random.standard_normal(u.shape)
    signals = signals_in_memory(u, rate)
    signals = at_needed_rate(signals) or signals
    seen = survey(signals)
    (choice,) = choose([seen], ["a"])
    made = demodulate(signals, SETTING, seen, choice, 1, "a", HERTZ, HERTZ)
    found = effects([made.answer])
    assert not [effect for effect in found if effect.kind == "cyclic"]
    reference = np.sqrt(2.0) * np.std(made.displacement_m) / SETTING.metres_per_radian
    return reference / swing - 1.0, float(np.linalg.norm([effect.standard_uncertainty for effect in found]))


@pytest.mark.parametrize(("swing", "noise"), [(0.5, 0.03), (1.0, 0.03), (1.5, 0.01)])
@pytest.mark.quick("0.5-0.03", "1.5-0.01")
def test_u_of_a_small_motion_does_not_rise_with_the_optical_rate(swing, noise):
    """Nor is its turning taken for a cyclic error, which made u ten to a thousand times as large."""
    slow, fast = ([found(rate, swing, noise, seed) for seed in (1, 2)] for rate in (SLOWEST, 4.0 * SLOWEST))
    for (_, before), (_, after) in zip(slow, fast, strict=True):
        assert after < 1.15 * before
    for off, u in slow + fast:
        assert abs(off) < 4.0 * u + 3.0 * noise / np.sqrt(SECONDS * SLOWEST)


def of(phase, rate, noise=0.02):
    """Signals of a phase, and their ellipse."""
    random = np.random.default_rng(8)
    u = np.stack([np.cos(phase), np.sin(phase)])
    signals = signals_in_memory(u + noise * random.standard_normal(u.shape), rate)
    return signals, choose([survey(signals)], ["a"])[0]


def test_motion_late_in_a_long_record_is_found():
    """The first million samples alone showed only the slow motion, and a late shock was filtered away."""
    rate = 2e7
    time = np.arange(1_400_000) / rate
    burst = 3.0 * np.exp(-(((time - 0.065) / 1e-3) ** 2)) * np.sin(2.0 * np.pi * 5000.0 * time)
    signals, choice = of(8.0 * np.sin(2.0 * np.pi * 20.0 * time) + burst, rate)
    assert 4000.0 < highest_frequency(signals, choice, 40)[0] < 9000.0


def test_a_line_of_noise_is_not_taken_for_motion():
    """Of one spectrum, a line stood out by chance in every third short record."""
    rate, time = 1e5, np.arange(20_000) / 1e5
    signals, choice = of(50.0 * np.sin(2.0 * np.pi * 100.0 * time), rate)
    random, values = np.random.default_rng(9), signals.block(0, signals.samples)
    for _ in range(20):
        again = signals_in_memory(values + 0.02 * random.standard_normal(values.shape), rate)
        assert highest_frequency(again, choice, 1)[0] < 1000.0


def test_a_sine_slower_than_the_first_look_is_found(monkeypatch):
    monkeypatch.setattr(rough, "PIECE_SAMPLES", 1 << 12)
    rate, time = 1e5, np.arange(60_000) / 1e5
    signals, choice = of(200.0 * np.sin(2.0 * np.pi * 10.0 * time), rate)
    assert abs(rough_frequency(signals, choice) - 10.0) < 1.0


@pytest.mark.parametrize(("times", "said"), [(1.0, False), (2.0, True), (0.5, True), (1.3, False)])
def test_an_optical_rate_that_is_wrong_by_a_factor_is_suspected(tmp_path, times, said):
    """Without stated frequencies nothing else told it."""
    settings = {"sampling_rate_hz": 5e4, "samples": 3000, "start": "steady", "frequencies_hz": [400.0, 1000.0]}
    write_optical_calibration(tmp_path, "paper", "sine", Optics(rate_hz=1e6), seed=1, **settings)
    file = tmp_path / "calibration.toml"
    text = re.sub(r"frequency_hz = .*\n", "", file.read_text())
    file.write_text(text.replace("rate_hz = 1000000.0", f"rate_hz = {1e6 * times!r}"))
    found = [finding.message for record in read(file).records for finding in record.optical.findings]
    assert len(found) == said
    assert not said or "factor of 2" in found[0]
