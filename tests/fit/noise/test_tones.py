"""Tones of a residual beside those that are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vibrident.fit.noise.tones import (
    MAX_TONES,
    RecordTones,
    resonant_bins,
    tone_excess,
    tones_alike,
    with_shared_tones,
    with_tones,
)


@pytest.mark.parametrize(
    ("found", "beside"),
    [
        ((42.3, 41.2), ()),
        ((43.0, 60.0), (43.0, 60.0)),
        ((60.0, 42.0), (60.0,)),
    ],
)
def test_what_is_left_near_a_known_tone_is_no_other(found, beside):
    """A resonance's harmonic was taken for eleven tones within a hundredth of a bin of each other."""
    assert with_tones((42.0,), found) == (42.0, *beside)


def test_there_are_no_more_than_are_looked_for():
    many = tuple(10.0 * number for number in range(1, 2 * MAX_TONES))
    assert with_tones(many[:1], many[1:]) == many[:MAX_TONES]


RECORDS, BINS = 8, 500


def test_a_tone_shows_where_the_motion_leaves_no_freedom():
    """A block of three loud bins is explained whole: a harmonic of the mains there was none."""
    residual = np.ones(BINS, complex)
    residual[40] = 4.0
    noise = residual.copy()
    noise[38:42] = 0.0
    freedom = np.where(noise == 0.0, 0.0, 1.0)
    noise[80] *= 0.5  # half of a tone's amplitude, where the motion takes half of a bin
    freedom[80] = 0.5
    excess = tone_excess(residual, noise, np.ones(BINS), np.zeros(BINS, dtype=bool), freedom)
    assert excess[40] == pytest.approx(16.0)
    assert excess[80] == pytest.approx(1.0)


def beside_white_noise(places, bin_hz=1.0, excess=None):
    """A record with these tones, which shows no others."""
    return RecordTones(places, (), np.zeros(BINS) if excess is None else excess, bin_hz, BINS)


def test_a_tone_of_most_records_is_of_all():
    """Its frequency is that of the longest record; a tone of fewer than most is theirs alone."""
    tones = (5.02, 20.0), (50.1, 30.0), (300.0,), (4.97,)
    records = [beside_white_noise(*pair) for pair in zip(tones, (10.0, 1.0, 1.0, 10.0), strict=True)]
    assert [hz for hz, owners in tones_alike(records) if len(owners) > 2] == pytest.approx((50.1,))
    shared = [(5.02, 20.0), (50.1, 30.0), (300.0, 50.1), (4.97,)]
    for places, expected in zip(with_shared_tones(records), shared, strict=True):
        assert places == pytest.approx(expected)


def test_a_tone_of_two_records_is_in_all_that_show_it_together(rng):
    """Hum of 0.1 % stood out of two records of eight, and all together rejected the model."""
    weak = rng.exponential(size=(6, BINS))
    weak[:, 40] += 4.0
    records = [beside_white_noise((40.2,))] * 2 + [beside_white_noise((), excess=excess) for excess in weak]
    assert with_shared_tones(records) == [pytest.approx((40.2,))] * 8


def test_what_the_others_do_not_show_is_a_record_s_own(rng):
    """A tone of two of eight records, beside noise alone in the others."""
    for _ in range(200):
        records = [beside_white_noise((40.2,))] * 2
        records += [beside_white_noise((), excess=excess) for excess in rng.exponential(size=(6, BINS))]
        assert [len(places) for places in with_shared_tones(records)] == [1, 1, 0, 0, 0, 0, 0, 0]


@pytest.mark.parametrize(("damping", "fundamental"), [(0.02, (11.87,)), (0.7, ())])
def test_the_fundamental_that_a_resonance_hides_is_of_all(damping, fundamental):
    """The fit took it for ringing, and the natural frequency was 7 u off."""
    over = np.arange(BINS) / 12.0
    resonant = resonant_bins(1.0 / np.abs(1.0 - over**2 + 2j * damping * over + 1e-9) ** 2)
    records = [replace(beside_white_noise((35.6 + 0.01 * number,)), resonant=resonant) for number in range(4)]
    for number, places in enumerate(with_shared_tones(records)):
        assert places == pytest.approx((35.6 + 0.01 * number, *fundamental), abs=0.01)


def tones_beside(fundamental, amplitude, rng, bin_hz=(1.0,) * RECORDS):
    """Places of tones in white noise of variance one, beside a weak tone at three times that of a known one.

    Records have bins of any width, in which the fundamental is known to a tenth of a bin.
    """
    records = []
    for width in bin_hz:
        noise = (rng.normal(size=BINS) + 1j * rng.normal(size=BINS)) / np.sqrt(2.0)
        offset = np.arange(BINS) - 3.0 * 33.4 / width
        phase = np.exp(2j * np.pi * rng.random())
        residual = noise + amplitude * phase * np.sinc(offset) * np.exp(-1j * np.pi * offset)
        excess = tone_excess(residual, residual, np.ones(BINS), np.zeros(BINS, dtype=bool), np.ones(BINS))
        records.append(RecordTones(((fundamental + 0.03 * rng.normal()) / width,), (), excess, width, BINS))
    return [
        tuple(set(places) - set(record.known))
        for record, places in zip(records, with_shared_tones(records), strict=True)
    ]


def test_a_weak_harmonic_that_all_records_show_is_of_each(rng):
    """The third harmonic of hum of 0.1 % was none in each record, and all together rejected the model."""
    for _ in range(20):
        for places in tones_beside(33.4, 3.5, rng):
            assert any(abs(place - 100.2) < 0.2 for place in places)


def test_records_of_other_lengths_show_a_weak_harmonic_too(rng):
    """Each had its own places of tones, and was looked at alone: no record showed it."""
    widths = (1.0, 1.0, 0.5, 0.5, 0.7, 0.7, 0.9, 1.0)
    for _ in range(20):
        for width, places in zip(widths, tones_beside(33.4, 3.5, rng, widths), strict=True):
            assert any(abs(place * width - 100.2) < 0.2 for place in places)


def test_a_weak_tone_that_is_no_harmonic_may_be_a_misfit(rng):
    assert not any(any(tones_beside(41.0, 3.5, rng)) for _ in range(20))


def test_noise_alone_has_no_harmonic(rng):
    assert sum(any(tones_beside(33.4, 0.0, rng)) for _ in range(200)) <= 2  # one of a thousand groups
