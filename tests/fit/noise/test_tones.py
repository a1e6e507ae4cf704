"""Tones of a residual beside those that are known."""

from __future__ import annotations

import pytest
from bench.adversary.cases import BY_NAME
from bench.adversary.judge import judged

from vibrident.fit.noise.tones import MAX_TONES, common_tones, with_tones


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


def test_a_tone_of_most_records_is_of_all():
    """Its frequency is that of the longest record; a tone of fewer than most is theirs alone."""
    tones = (5.02, 20.0), (50.1, 30.0), (300.0,), (4.97,)
    assert common_tones(tones, (10.0, 1.0, 1.0, 10.0)) == pytest.approx((50.1,))


def test_hum_that_one_record_hides_is_a_nuisance_of_it_too():
    """It lay beside a line of a multisine there: χ²/ν was 3.6, after 31 s."""
    assert judged(BY_NAME["clean/below-light/multisine/hum 1 %"].trial(80))["class"] == "right"
