"""Tones of a residual beside those that are known."""

from __future__ import annotations

import pytest

from vibrident.fit.noise.tones import MAX_TONES, with_tones


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
