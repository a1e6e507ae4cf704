"""Records that a known change of the response was moved to the reference of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from vibrident.data.records import Record, ResponseTable
from vibrident.fit.response.correction import table_without, with_reference_changed

RATE_HZ = 1000.0
BAND_HZ = (5.0, 300.0)
DELAY_S = 4e-5


def late(frequency_hz):
    """Return the change of log H by a delay."""
    return -2j * np.pi * frequency_hz * DELAY_S


def record(*, valid=None):
    """Return a record of tones within the band, none of which has whole periods."""
    time_s = np.arange(700) / RATE_HZ
    motion = sum(np.sin(2.0 * np.pi * hz * time_s + hz) for hz in (7.3, 61.7, 183.1))
    return Record("tones", motion, np.zeros(700), RATE_HZ, excitation="random", reference_valid=valid)


def delayed_motion():
    time_s = np.arange(700) / RATE_HZ - DELAY_S
    return sum(np.sin(2.0 * np.pi * hz * time_s + hz) for hz in (7.3, 61.7, 183.1))


def about_middle(error):
    """Return the size of an error without an offset, which no fit sees."""
    return np.abs(error - np.median(error))


def test_a_delay_moves_the_motion_and_its_ends_leak_little():
    changed = with_reference_changed(record(), late, BAND_HZ)
    error = about_middle(changed.reference - delayed_motion())
    moved = np.max(np.abs(record().reference - delayed_motion()))
    assert np.max(error[20:-20]) < 5e-3 * moved
    assert np.max(error) < 0.2 * moved


def test_the_opposite_change_undoes_it():
    there = with_reference_changed(record(), late, BAND_HZ)
    back = with_reference_changed(there, lambda hz: -late(hz), BAND_HZ)
    moved = np.max(np.abs(there.reference - record().reference))
    assert np.max(np.abs(back.reference - record().reference)[20:-20]) < 1e-2 * moved


def test_beyond_the_band_the_change_stays_as_at_its_end():
    def explosive(frequency_hz):
        return 1e-3 * (frequency_hz / BAND_HZ[1]) ** 40 + 0j

    changed = with_reference_changed(record(), explosive, BAND_HZ)
    assert np.max(np.abs(changed.reference)) < 1.01 * np.max(np.abs(record().reference))


def test_samples_that_are_not_valid_are_not_felt():
    valid = np.ones(700, dtype=bool)
    valid[300:303] = False
    spoilt = record(valid=valid)
    reference = spoilt.reference.copy()
    reference[300:303] = 1e6
    spoilt = replace(spoilt, reference=reference)
    changed = with_reference_changed(spoilt, late, BAND_HZ).reference
    far = np.r_[20:250, 353:680]
    assert np.max(about_middle(changed - delayed_motion())[far]) < 1e-3


@pytest.mark.parametrize("has_phase", [True, False])
def test_a_table_is_divided_by_the_change(has_phase):
    frequency_hz = np.array([10.0, 100.0])
    phase_rad = np.array([0.1, 0.2]) if has_phase else None
    table = ResponseTable(frequency_hz, np.array([2.0, 3.0]), phase_rad, np.array([0.02, 0.03]))
    changed = table_without(table, lambda hz: np.log(1.1) + late(hz))
    np.testing.assert_allclose(changed.magnitude, table.magnitude / 1.1)
    np.testing.assert_allclose(changed.magnitude_uncertainty / changed.magnitude, 0.01)
    if has_phase:
        turned = phase_rad + 2.0 * np.pi * frequency_hz * DELAY_S
        np.testing.assert_allclose(changed.phase_rad, turned)
    else:
        assert changed.phase_rad is None
