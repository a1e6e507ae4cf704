"""Stated systematic effects are in the points, in the verdict, and in the deviations as far as no parameter follows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import vibrident
from vibrident.data.records import Calibration, ResponseTable, SystematicEffect
from vibrident.physics.models import parse
from vibrident.physics.simulation import simulate

MODEL = parse("accelerometer")
TRUTH = {"sensitivity": 0.104, "natural_frequency": 652.1, "damping_ratio": 0.182}
F = np.geomspace(20.0, 1500.0, 20)
NOISE = 1e-4
TIMING = SystematicEffect("skew of the recorder", "timing", 2e-6)
GAIN = SystematicEffect("amplifier", "gain", 1.5e-3)


def table(*effects, shift_u=0.0, change=0.0, seed=1, noise=NOISE, reference_u=0.0):
    """A table with noise, a real timing shift of so many u, and ``change`` of log H on top."""
    noises = noise * np.random.default_rng(seed).normal(size=(2, F.size))
    response = np.asarray(MODEL.frequency_response(TRUTH, F)) * np.exp(noises[0] + 1j * noises[1] + change)
    response = response * np.exp(-2j * np.pi * F * shift_u * TIMING.standard_uncertainty)
    u = np.full(F.size, noise)
    made = ResponseTable(F, np.abs(response), np.angle(response), u * np.abs(response), u)
    return Calibration(table=made, effects=effects, reference_standard_uncertainty=reference_u)


def identified(calibration):
    return vibrident.identify(calibration, estimator="ml")


def test_a_shift_of_two_u_is_within_what_was_stated_and_one_of_six_is_not():
    found = identified(table(TIMING, shift_u=2.0))
    assert found.fit.adequate
    assert found.warning_codes == ()
    assert found.fit.chi2_reduced < 2.0
    (seen,) = found.settings["systematic_effects_seen"]
    assert seen["amount_in_u"] == pytest.approx(2.0, abs=0.05)
    far = identified(table(TIMING, shift_u=6.0))
    assert not far.fit.adequate
    (message,) = [w.message for w in far.warnings if w.code == "lack_of_fit"]
    assert "skew of the recorder (timing) of 12 µs, 6 times the stated standard uncertainty of 2 µs" in message


def test_parameters_stay_within_the_budget_of_a_shift_of_two_u():
    result = identified(table(TIMING, shift_u=2.0))
    for name, true in TRUTH.items():
        parameter = result.parameters[name]
        assert abs(parameter.value - true) < 3.0 * parameter.standard_uncertainty


@pytest.mark.parametrize("size", [8.0, -8.0])
def test_a_misfit_of_another_shape_is_seen_as_if_no_effect_were_stated(size):
    bump = size * NOISE * np.exp(-(np.log(F / 400.0) ** 2) / 0.05)
    assert not identified(table(TIMING, GAIN, change=bump)).fit.adequate
    assert not identified(table(change=bump)).fit.adequate
    assert identified(table(TIMING, GAIN)).fit.adequate


def test_what_the_parameters_follow_changes_nothing():
    plain, stated = (identified(table(*effects, change=3e-3)) for effects in ((), (GAIN,)))
    assert stated.fit.chi2_reduced == pytest.approx(plain.fit.chi2_reduced, rel=1e-6)
    np.testing.assert_array_equal(stated.measured.deviation_percent, plain.measured.deviation_percent)
    for field in ("deviation_uncertainty_percent", "deviation_phase_uncertainty_deg"):
        assert getattr(stated.measured, field) == pytest.approx(getattr(plain.measured, field), rel=1e-4)


def test_a_point_states_noise_and_effects_and_each_by_itself():
    measured = identified(table(GAIN, TIMING, reference_u=1e-3)).measured
    size = np.array(measured.magnitude)
    assert np.array(measured.magnitude_noise) / size == pytest.approx(NOISE, rel=1e-3)
    assert np.array(measured.magnitude_uncertainty) / size == pytest.approx(np.hypot(NOISE, np.hypot(1.5e-3, 1e-3)))
    turned = np.hypot(NOISE, 2.0 * np.pi * F * TIMING.standard_uncertainty)
    assert np.deg2rad(measured.phase_deg_uncertainty) == pytest.approx(turned)
    assert np.deg2rad(measured.phase_deg_noise) == pytest.approx(NOISE)


def test_the_stated_phase_uncertainty_of_a_table_is_that_of_its_points():
    made = table()
    stated = replace(made.table, phase_uncertainty_rad=np.full(F.size, 7e-4))
    measured = identified(replace(made, table=stated)).measured
    assert np.deg2rad(measured.phase_deg_uncertainty) == pytest.approx(7e-4)


@pytest.mark.draws(25, 60)
def test_deviations_scatter_by_their_own_uncertainty_with_effects_drawn_at_random(draws):
    """E_n of model and point with what is common to both: neither U of the two would do."""
    rng = np.random.default_rng(5)
    ratios = []
    for seed in range(draws):
        a, gain = rng.normal(size=2)
        drawn = table(TIMING, GAIN, shift_u=a, change=GAIN.standard_uncertainty * gain, seed=seed)
        measured = identified(drawn).measured
        ratios.append(np.array(measured.deviation_percent) / np.array(measured.deviation_uncertainty_percent))
        phase = np.array(measured.deviation_phase_deg) / np.array(measured.deviation_phase_uncertainty_deg)
        ratios.append(phase)
    numbers = 2 * draws  # that are independent: a gain and a shift of each table
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(1.0, abs=3.0 / np.sqrt(2 * numbers))


@pytest.mark.parametrize("estimator", ["ml", "ipnn"])
def test_the_same_holds_of_records(estimator):
    clean = simulate(
        "paper", "sine", frequencies_hz=list(F[2::3]), samples=2000, sampling_rate_hz=20_000.0, start="steady", seed=3,
        response_noise=0.01,
    )  # fmt: skip
    records = []
    for record in clean.records:
        turn = 2.0 * np.pi * record.frequency_hz
        basis = np.stack([np.cos(turn * record.time_s), np.sin(turn * record.time_s)], axis=1)
        amplitude, *_ = np.linalg.lstsq(basis, record.response, rcond=None)
        late = complex(amplitude[0], -amplitude[1]) * (np.exp(-2j * turn * TIMING.standard_uncertainty) - 1.0)
        records.append(replace(record, response=record.response + np.real(late * np.exp(1j * turn * record.time_s))))
    result = vibrident.identify(replace(clean, records=tuple(records), effects=(TIMING,)), estimator=estimator)
    assert result.fit.adequate
    assert result.warning_codes == ()
    assert result.settings["uncertainty_covers"] == "noise; skew of the recorder (timing)"
    plain = vibrident.identify(replace(clean, records=tuple(records)), estimator=estimator)
    assert not plain.fit.adequate


@pytest.mark.slow
def test_false_alarms_are_as_rare_as_the_verdict_says():
    rng = np.random.default_rng(6)
    rejections = 0
    for seed in range(1000):
        a, gain = rng.normal(size=2)
        calibration = table(TIMING, GAIN, shift_u=a, change=GAIN.standard_uncertainty * gain, seed=seed)
        rejections += not identified(calibration).fit.adequate
    assert rejections <= 7  # two tests of 1e-3 each: 2 in 1000 expected
