"""Channels that stand still at an end of a record whose motion goes on there."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from vibrident.data.records import Record
from vibrident.data.screening import screen

SAMPLES = 4000
STILL = 25


def motion_and_response(seed: int, *, delay: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return a random motion in a band, and the response of a sensor that rests at first."""
    generator = np.random.default_rng(seed)
    band = signal.butter(4, (0.01, 0.4), btype="bandpass", output="sos")
    motion = signal.sosfilt(band, generator.standard_normal(SAMPLES + 500))
    pole = 0.95 * np.exp(0.6j)
    answer = signal.lfilter([0.0, 1.0], np.poly([pole, pole.conj()]).real, motion)
    return motion[500:], answer[500 - delay : motion.size - delay]


def noisy(values: np.ndarray, seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).standard_normal(values.size)
    return values + 1e-3 * np.std(values) * noise


def screened(reference: np.ndarray, response: np.ndarray) -> tuple[Record, list[str]]:
    records, findings = screen([Record("r", reference, response, 1e4, "random")])
    return records[0], [finding.code for finding in findings]


@pytest.mark.parametrize("channels", [("response",), ("reference",), ("response", "reference")])
@pytest.mark.parametrize("end", [slice(0, STILL), slice(-STILL, None)])
def test_still_samples_are_left_out_at_either_end(end: slice, channels: tuple[str, ...]) -> None:
    missed = 0
    for seed in range(20):
        reference, response = motion_and_response(seed)
        values = {"reference": noisy(reference, seed), "response": noisy(response, seed + 100)}
        for name in channels:
            values[name][end] = 0.0
        record, codes = screened(**values)
        mask = record.mask & record.reference_mask
        missed += not ("dead_channel" in codes and not mask[end].any())
        assert mask[2 * STILL : -2 * STILL].all()
    # Both channels leave it slowly, as from rest, where both are at zero by chance.
    assert missed <= (2 if len(channels) == 2 else 0)


def test_a_motion_that_sets_off_slowly_is_no_finding() -> None:
    """Both channels rest exactly before it, where nothing is noisy."""
    begins = np.minimum(np.arange(SAMPLES) / 200.0, 1.0) ** 2
    values = [np.roll(begins * channel, STILL) for channel in motion_and_response(1)]
    for channel in values:
        channel[:STILL] = 0.0
    record, codes = screened(*values)
    assert not codes
    assert record.mask.all()


def test_rest_before_a_motion_that_begins_in_the_record_is_no_finding() -> None:
    reference, response = motion_and_response(1)
    reference[:STILL] = 0.0
    response[:STILL] = 0.0
    records, findings = screen([Record("r", reference, response, 1e4, "shock")])
    assert records[0].mask.all()
    assert not findings
