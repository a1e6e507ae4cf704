"""What nuisances leave of the noise of each bin: hum and edges take it from few bins."""

from __future__ import annotations

import numpy as np
import pytest

from vibrident.fit.bins.segments import shifted_lines, tone_bins
from vibrident.fit.group.network import Nuisances, combined

SAMPLES = 400
BINS = SAMPLES // 2


def nuisances():
    """Return columns of a drift and of a tone between two bins, in noise that falls steeply."""
    shifted = shifted_lines(SAMPLES, slice(0, BINS))
    shifted = np.where(shifted == 0.0, 1.0, shifted)
    tone = tone_bins([11.4], SAMPLES, slice(0, BINS))
    columns = np.concatenate([((1.0 + shifted) / shifted)[None], tone])
    weight = np.maximum(np.arange(BINS), 1.0)[None] ** 2
    weight[:, 0] = 0.0
    return Nuisances.in_weight(columns[None], weight)


def test_each_column_takes_one_number():
    columns = nuisances()
    assert 2.0 * np.sum(columns.leverage()) == pytest.approx(columns.columns.shape[1])


@pytest.mark.draws(400, 4000)
def test_noise_is_less_by_the_leverage(draws):
    columns = nuisances()
    rng = np.random.default_rng(3)
    deviation = 1.0 / np.sqrt(np.maximum(columns.weight, 1.0))
    noise = rng.normal(size=(draws, BINS)) + 1j * rng.normal(size=(draws, BINS))
    noise *= deviation
    fitted = combined(columns.amounts(noise[:, None]), columns.columns)[:, 0]
    power = np.mean(np.abs(noise - fitted) ** 2 / deviation**2, axis=0)[1:]
    expected = 2.0 * (1.0 - columns.leverage())[0, 1:]
    assert np.max(np.abs(power - expected)) < 5.0 * np.sqrt(4.0 / draws)
    assert np.min(expected) < 0.5
