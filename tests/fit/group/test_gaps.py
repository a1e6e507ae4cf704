"""Samples that are left out are unknown numbers: what rings in a narrow resonance does not leak from their place."""

import numpy as np
import pytest

import vibrident
from vibrident.data.records import Calibration, Record
from vibrident.fit.group.gaps import RowFilling

RATE_HZ, SAMPLES = 8000.0, 24000


@pytest.mark.parametrize("samples", [200, 201])
def test_filled_rows_have_nothing_in_common_with_an_impulse_in_a_gap(samples, rng):
    """It is the projection in the weights of the bins: done twice, it changes nothing."""
    used = np.ones(samples, dtype=bool)
    used[[3, 50, 51, 52, samples - 1]] = False
    weight = rng.uniform(0.1, 10.0, samples // 2 + 1)
    fill = RowFilling.in_weight(used, weight)
    rows = np.fft.rfft(rng.standard_normal((4, samples)) * used)
    filled = fill(rows)
    impulses = np.fft.rfft(np.eye(samples)[~used])
    products = np.real((filled * weight) @ impulses.conj().T)
    assert np.max(np.abs(products)) < 1e-10 * np.max(np.abs(filled))
    np.testing.assert_allclose(fill(filled), filled, atol=1e-10)
    np.testing.assert_allclose(np.fft.irfft(filled, samples)[:, used], np.fft.irfft(rows, samples)[:, used], atol=1e-12)


def test_gaps_of_a_segment_of_no_weight_stay_zero(rng):
    """A record that counts nowhere, in the noise that was read, has nothing to be filled by."""
    used = np.arange(40) != 7
    rows = np.fft.rfft(rng.standard_normal((2, 40)) * used)
    np.testing.assert_array_equal(RowFilling.in_weight(used, np.zeros(21))(rows), rows)


def sharp(gap):
    """A resonance of damping 0.005, of which the reference's noise of 1 % rings far above the response's."""
    rng = np.random.default_rng(40)
    hz = np.fft.rfftfreq(2 * SAMPLES, 1.0 / RATE_HZ)
    lines = np.fft.rfft(rng.standard_normal(2 * SAMPLES)) * ((hz > 40.0) & (hz < 1500.0))
    ratio = hz / 900.0
    reference = np.fft.irfft(lines)[:SAMPLES]
    response = np.fft.irfft(lines * 0.1 / (1.0 - ratio**2 + 0.01j * ratio))[:SAMPLES]
    reference = reference + 0.01 * np.std(reference) * rng.standard_normal(SAMPLES)
    response = response + 1e-4 * np.std(response) * rng.standard_normal(SAMPLES)
    record = Record("random", reference, response, RATE_HZ, "random")
    left_out = np.zeros(SAMPLES, dtype=bool)
    for begin, end in gap:
        left_out[begin:end] = True
    if left_out.any():
        record = record.without_response(left_out, "a burst")
    return vibrident.identify(Calibration(records=(record,), model="accelerometer"))


@pytest.mark.parametrize("gap", [[(9000, 9003)], [(4000, 4028), (9000, 9028), (15000, 15028)], [(9000, 9108)]])
def test_a_gap_costs_what_it_leaves_out(gap):
    """Three samples moved the damping ratio by 12 u, and made u two times smaller: their hole was noise in all bins."""
    whole, with_gap = sharp([]), sharp(gap)
    for name in ("sensitivity", "natural_frequency", "damping_ratio"):
        before, after = whole.parameters[name], with_gap.parameters[name]
        assert abs(after.value - before.value) < before.standard_uncertainty
        assert after.standard_uncertainty == pytest.approx(before.standard_uncertainty, rel=0.1)
    assert set(with_gap.warning_codes) <= {"dead_channel"}
