"""Sampling rates read from rounded time stamps."""

from __future__ import annotations

import numpy as np
import pytest

from vibrident import Record
from vibrident.data.screening.rates import MAX_SHIFT_SAMPLES, with_common_rates


def records_at(*rates_hz: float, samples: int = 1000) -> list[Record]:
    rng = np.random.default_rng(1)
    return [Record("", *rng.normal(size=(2, samples)), rate_hz, "random") for rate_hz in rates_hz]


def test_rates_that_differ_by_rounding_are_one_and_others_stay():
    step = MAX_SHIFT_SAMPLES / 1000
    records = with_common_rates(records_at(100.0, 100.0 * (1.0 + 0.4 * step), 101.0))
    assert [record.sampling_rate_hz for record in records] == [100.0, 100.0, 101.0]


@pytest.mark.parametrize("factor", [1.0, 1e-3, 1e6])
def test_no_sample_moves_by_more_than_the_rounding_in_any_unit_of_time(factor):
    """A chain of rates, each near the next, is not one rate."""
    step = MAX_SHIFT_SAMPLES / 1000
    rates_hz = factor * 100.0 * (1.0 + 0.7 * step * np.arange(10))
    common = np.array([r.sampling_rate_hz for r in with_common_rates(records_at(*rates_hz))])
    assert np.max(np.abs(common / rates_hz - 1.0)) * 1000 <= MAX_SHIFT_SAMPLES
    assert len(set(common)) == 5
