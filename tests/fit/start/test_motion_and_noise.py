"""State what records say before any model: samples that are left out hide neither noise nor motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from bench.adversary.cases import BY_NAME
from bench.adversary.judge import judged

from vibrident.data.records import BoolArray, Record
from vibrident.fit.problem.band import Band
from vibrident.fit.problem.bin_problem import BinProblem
from vibrident.fit.start.motion_and_noise import MotionAndNoise, estimate_motion_and_noise
from vibrident.physics.discretisation import method
from vibrident.physics.models import parse
from vibrident.physics.simulation import simulate

RATE_HZ = 10e3
SAMPLES = 8000


def motion_and_noise_of(record: Record, used: BoolArray) -> MotionAndNoise:
    """Estimate motion and noise of a record whose response is used there."""
    everywhere = np.ones(SAMPLES, dtype=bool)
    whole = replace(record, valid=used, reference_valid=everywhere)
    model = parse("accelerometer")
    start = dict.fromkeys(model.parameter_names, 1.0)
    problem = BinProblem.build([whole], model, method("bandlimited"), "acceleration", start)
    return estimate_motion_and_noise(Band(problem, np.inf))


def noise_between(seen: MotionAndNoise, low_hz: float, high_hz: float) -> float:
    """Return the noise of a sample, as the bins of a part of the band have it."""
    level = seen.levels[0].total
    samples = seen.heard[0][0]
    frequency_hz = np.arange(len(level)) * RATE_HZ / samples
    return float(np.mean(level[(frequency_hz > low_hz) & (frequency_hz < high_hz)])) / samples


def moved(seed: int = 3) -> Record:
    made = simulate(
        "paper",
        "random",
        samples=SAMPLES,
        sampling_rate_hz=RATE_HZ,
        frequencies_hz=[30.0, 1500.0],
        response_noise=1e-2,
        seed=seed,
    )
    return made.records[0]


def in_runs(share: float, length: int, rng: np.random.Generator) -> BoolArray:
    """Return where samples are used, those left out in runs of about a length."""
    count = round((1.0 - share) * SAMPLES / length)
    begins = rng.integers(0, SAMPLES - length, count)
    used = np.ones(SAMPLES, dtype=bool)
    used[np.add.outer(begins, np.arange(length)).reshape(-1)] = False
    return used


@pytest.mark.parametrize(("share", "length"), [(0.95, 1), (0.8, 20), (0.6, 20), (0.5, 200)])
def test_samples_left_out_hide_neither_noise_nor_motion(share: float, length: int, rng: np.random.Generator) -> None:
    """A bin holds the noise of the samples that are used."""
    record = moved()
    whole = motion_and_noise_of(record, np.ones(SAMPLES, dtype=bool))
    used = in_runs(share, length, rng)
    gaps = motion_and_noise_of(record, used)
    for low_hz, high_hz in ((200.0, 1200.0), (2000.0, 3500.0)):
        expected = float(np.mean(used)) * noise_between(whole, low_hz, high_hz)
        assert 0.7 < noise_between(gaps, low_hz, high_hz) / expected < 1.4
    block_hz = 24.0 * RATE_HZ / SAMPLES / share
    assert gaps.band_hz[0] < whole.band_hz[0] + block_hz
    assert gaps.band_hz[1] > whole.band_hz[1] - block_hz
    assert 0.8 < gaps.count / whole.count < 1.25


def test_clipped_peaks_hide_no_motion() -> None:
    """What is left out follows from the response itself."""
    record = moved()
    whole = motion_and_noise_of(record, np.ones(SAMPLES, dtype=bool))
    gaps = motion_and_noise_of(record, np.abs(record.response) < 0.4 * np.max(np.abs(record.response)))
    assert 0.5 < noise_between(gaps, 200.0, 1200.0) / noise_between(whole, 200.0, 1200.0) < 2.0
    assert gaps.count > 0.8 * whole.count


@pytest.mark.parametrize(
    ("case", "run"), [("decay/with sines/pickup-in-light/12 bit", 91), ("clean/in-light/mixed/12 bit", 80)]
)
def test_a_rounded_sine_tells_of_the_bins_around_it_alone(case: str, run: int) -> None:
    """Elsewhere the rounding of its reference was taken for motion: a generator constant 171 times too small."""
    assert judged(BY_NAME[case].trial(run))["class"] == "right"


def test_a_few_bins_have_a_start() -> None:
    """The level around them is one number, which was written to where it cannot be."""
    case = BY_NAME["defect/dropouts held reference:10x5/mixed/far-light/1 %"]
    assert judged(case.trial(99))["class"] in {"right", "warned", "refused"}


@pytest.mark.parametrize(
    ("case", "run"),
    [
        ("noises/reference brown, response ar2/acceleration/shock running", 141),
        ("quantities/velocity/accelerometer+highpass/shock", 141),
    ],
)
def test_what_rings_in_a_resonance_narrower_than_a_bin_is_motion(case, run):
    """No bin was heard: each place of the grid was as likely, and the first explained nothing."""
    assert judged(BY_NAME[case].trial(run))["class"] == "right"
