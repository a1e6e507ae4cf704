"""The clocks behind shocks are judged where the shocks are, however long the channels rest."""

from __future__ import annotations

import numpy as np
import pytest

from vibrident.data.records import Record
from vibrident.fit.response.clock_ratio import clock_offset
from vibrident.fit.response.clock_search import MAX_ORDER, ClockSearch
from vibrident.physics.simulation import sensor_named, simulate, with_noise

RATE_HZ = 51200.0


def shocks(rest_before: int, rest_behind: int) -> list[Record]:
    """Return two clean shocks of 2,000 samples with noisy rest around them."""
    motion = simulate(sensor_named("paper"), "shock", sampling_rate_hz=RATE_HZ, samples=2000, repeats=2, seed=3)
    noise = np.random.default_rng(1)
    records = []
    for record in with_noise(motion, response_noise=1e-3, seed=2).records:
        channels = []
        for channel in (record.reference, record.response):
            assert channel is not None
            rest = noise.standard_normal((2, max(rest_before, rest_behind)))
            rest *= 1e-3 * np.std(channel)
            parts = [rest[0, :rest_before] + channel[0], channel, rest[1, :rest_behind]]
            channels.append(np.concatenate(parts))
        records.append(Record(record.name, *channels, RATE_HZ, "shock"))
    return records


@pytest.mark.parametrize(("rest_before", "rest_behind"), [(0, 0), (1000, 0), (0, 14_000), (14_000, 14_000)])
def test_one_clock_explains_nine_tenths_wherever_the_shock_is(rest_before, rest_behind):
    records = shocks(rest_before, rest_behind)
    search = ClockSearch.from_records(records, MAX_ORDER, MAX_ORDER, delayed=True)
    assert search.unexplained(0.0, records[0].samples) < 0.1
    assert clock_offset(records) == 0.0


def test_rest_makes_no_valley_narrow():
    widths = []
    for rest in (0, 14_000):
        search = ClockSearch.from_records(shocks(rest, rest), MAX_ORDER, MAX_ORDER, delayed=True)
        widths.append(search.valley(2000 + 2 * rest))
    assert widths[1] > widths[0] / 3.0  # of fifteen times as many samples; the rest is noisy
