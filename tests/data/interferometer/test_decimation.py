"""Fewer samples: the amplitude stays, the delay is known, nothing folds."""

from __future__ import annotations

import numpy as np
import pytest

from vibrident.data.interferometer import decimation
from vibrident.data.interferometer.setting import Gap


def decimated(values, factor, block):
    blocks = (values[s : s + block] for s in range(0, len(values), block))
    return decimation.decimated(blocks, len(values), factor)


@pytest.mark.parametrize("factor", [3, 25])
def test_pass_band_is_flat_and_the_delay_exact(factor):
    samples = 120 * decimation.HALF * factor // 20
    index = np.arange(samples)
    for cycles in (0.0, 0.05, 0.39):
        found = decimated(1.0 + np.cos(2.0 * np.pi * cycles / factor * index + 0.3), factor, 777)
        at = decimation.lost_at_an_end(factor) + factor * np.arange(len(found))
        assert np.max(np.abs(found - 1.0 - np.cos(2.0 * np.pi * cycles / factor * at + 0.3))) < 1e-6
        assert len(found) == decimation.decimated_length(samples, factor)


def test_what_would_fold_is_held_back():
    index = np.arange(20_000)
    found = decimated(np.cos(2.0 * np.pi * 0.93 / 10 * index), 10, 5000)  # would fold to 0.07
    assert np.max(np.abs(found)) < 1e-6


def test_other_instants_are_met():
    index = np.arange(4000)
    values = np.cos(2.0 * np.pi * 0.39 / 3.3 * index + 0.3)
    at = np.arange(200.0, 3700.0, 3.3)
    expected = np.cos(2.0 * np.pi * 0.39 / 3.3 * at + 0.3)
    assert np.max(np.abs(decimation.at_positions(values, at, 3.3) - expected)) < 1e-6


def test_outputs_whose_filter_touches_a_gap_are_spoilt():
    factor, samples, gap = 5, 3000, (1500, 1510)
    values = np.zeros(samples)
    clean = decimated(values, factor, 1000)
    values[gap[0] : gap[1]] = 1.0
    touched = np.abs(decimated(values, factor, 1000) - clean) > 0.0
    spoilt = decimation.spoilt_outputs([Gap(*gap, jump=False)], samples, factor)[: len(touched)]
    assert np.all(spoilt[touched])
    assert spoilt.sum() <= 2 * decimation.HALF + 4
