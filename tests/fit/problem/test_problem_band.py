"""The band of the motion in segments."""

from types import SimpleNamespace

import numpy as np

from vibrident.fit.problem.band import Band


def segments(*sizes):
    return SimpleNamespace(segments=[SimpleNamespace(record=record, samples=samples) for record, samples in sizes])


def test_tones_stay_at_their_frequencies_where_a_delay_divides_records_otherwise():
    band = Band(segments((0, 1000), (1, 500)), np.inf, ((50.0,), (25.0,)))
    assert band._tones_in(segments((0, 600), (0, 380), (1, 480))) == ((30.0,), (19.0,), (24.0,))
    assert band._tones_in(segments((0, 1000), (1, 500))) is band.tones
