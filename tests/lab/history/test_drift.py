"""Laws of agreement, drift and control charts. The long study of coverage is bench/history.py."""

from __future__ import annotations

import datetime
import json
from dataclasses import replace

import numpy as np
import pytest
from bench.history import KINDS, measured
from tests.support.joint_sensors import table

import vibrident
from vibrident.base.errors import InputError
from vibrident.data.effects import SystematicEffect
from vibrident.lab.history import control
from vibrident.lab.history.drift import SensorDrift
from vibrident.lab.history.due import Tolerance, due, risk
from vibrident.lab.history.life import Entry, Event, agreement, life
from vibrident.lab.history.result_rows import rows_of


def series(years, values, u=0.001, shared=0.0):
    """A drift of one series, with noise and an error in common."""
    n = len(years)
    covariance = u**2 * np.eye(n) + shared**2
    return SensorDrift(np.array(years, float), np.array(values, float), covariance, np.zeros(n, int))


def entries(values, u=0.001, shared=0.0, first=2010, step=1):
    """Calibrations every ``step`` years, with an error in common by one source."""
    return [
        Entry(
            i + 1,
            datetime.date(first + step * i, 1, 1),
            value,
            float(np.hypot(u, shared)),
            "V",
            shared={"gain|reference|0.005|": shared} if shared else {},
            data_files=json.dumps([str(i)]),
        )
        for i, value in enumerate(values)
    ]


def test_sensors_that_share_a_reference_agree_in_95_percent_by_the_correlated_en_alone(rng):
    pairs, noise, reference = 4000, 0.001, 0.005
    common = reference * rng.normal(size=pairs)
    one, other = 1 + common + noise * rng.normal(size=(2, pairs))
    found = [agreement(*entries(pair, noise, reference)) for pair in zip(one, other, strict=True)]
    correlated = np.mean([abs(a.correlated) <= 1 for a in found])
    ordinary = np.mean([abs(a.ordinary) <= 1 for a in found])
    assert correlated == pytest.approx(0.9545, abs=0.012)
    assert ordinary > 0.999
    assert found[0].correlation == pytest.approx(25 / 26)


def test_what_is_shared_cancels_in_drift_and_stays_in_the_value():
    values = [1.0, 1.002, 1.003, 1.006]
    alone, sharing = (series(range(4), values, shared=shared) for shared in (0.0, 0.01))
    assert sharing.rate().value == pytest.approx(alone.rate().value, rel=1e-6)
    assert sharing.rate().u == pytest.approx(alone.rate().u, rel=1e-6)
    apart, together = alone.sensitivity(4.0), sharing.sensitivity(4.0)
    assert together.mean == pytest.approx(apart.mean, rel=1e-9)
    assert together.u > 0.0099
    reading = sharing.reading(4.0, np.full(4, 0.01**2), float(np.hypot(0.001, 0.01)))
    assert reading.u == pytest.approx(alone.reading(4.0, np.zeros(4), 0.001).u, rel=1e-6)


def test_the_unit_of_value_and_time_does_not_matter():
    years, values = [0.0, 1.1, 2.0, 3.7], np.array([1.0, 1.002, 1.001, 1.006])
    plain = series(years, values)
    other = SensorDrift(365 * plain.time, 1e3 * values, 1e6 * plain.covariance, plain.group)
    assert other.probability == pytest.approx(plain.probability)
    assert other.sensitivity(365 * 5).interval_95 == pytest.approx(
        [1e3 * end for end in plain.sensitivity(5).interval_95], rel=1e-9
    )


def test_with_noise_alone_the_line_is_that_of_generalised_least_squares():
    """Where the line is certain, rate and u are the textbook's: u² = u² / Σ(t − t̄)²."""
    years = np.arange(12.0)
    straight = 1 + 0.01 * years + 0.001 * np.array([1, -1, 0, 1, -1, 0, 0, 1, -1, 0, 1, -1])
    drift = series(years, straight)
    line = drift._variances[3] == 0
    weight = drift.weight[line] / drift.weight[line].sum()
    exact = np.polynomial.polynomial.polyfit(years, straight, 1)[1]
    rate = drift.rate()
    assert np.sum(weight * rate.mean[: line.sum()]) == pytest.approx(exact, rel=1e-3)
    least = 0.001 / np.sqrt(np.sum((years - years.mean()) ** 2))
    assert np.sum(weight * rate.deviation[: line.sum()]) == pytest.approx(least, rel=0.01)
    assert drift.probability["random walk"] < 1e-3


def test_more_nodes_give_the_same_prediction(monkeypatch):
    from vibrident.lab.history import drift as module

    values = [1.0, 1.002, 1.001, 1.006, 1.004]
    before = series(range(5), values).sensitivity(6.0).interval_95
    monkeypatch.setattr(module, "GRID_NODES", 31)
    after = series(range(5), values).sensitivity(6.0).interval_95
    assert before == pytest.approx(after, abs=0.1 * (after[1] - after[0]) / 4)


def test_the_interval_of_a_stable_sensor_comes_to_that_of_its_noise(rng):
    """It was a third wider than its noise demands after eight calibrations, as no hypothesis said that it is still."""
    for count, most in ((8, 1.2), (12, 1.12)):
        lives = [series(range(count), 1 + 0.001 * rng.normal(size=count)) for _ in range(40)]
        u = np.median([one.reading(count, np.zeros(count), 0.001).u for one in lives])
        assert 1.0 < u / (0.001 * np.sqrt(1 + 1 / count)) < most
        assert np.median([one.probability["still"] for one in lives]) > 0.5
    assert series(range(8), 1 + 0.003 * np.arange(8)).probability["still"] < 1e-6


def test_predictions_cover():
    """Of 500 lives with drift, random walk, a jump at a repair and noise: the next calibration, and the sensor."""
    found = measured(KINDS[0], 500, 0)
    assert 0.93 <= found["reading"] <= 0.97
    assert 0.93 <= found["sensor"] <= 0.97


def test_a_repair_begins_a_new_series_only_where_the_value_stepped():
    values = [1.0, 1.001, 0.999, 1.0, 1.02, 1.021, 1.019]
    repaired = [Event(1, "repaired", datetime.date(2013, 6, 1))]
    stepped = life(entries(values), repaired)
    assert [(item.index, "repaired" in item.why) for item in stepped.breaks] == [(4, True)]
    assert stepped.drift.sensitivity(7.0).value == pytest.approx(1.02, abs=2e-3)
    steady = life(entries([1.0, 1.001, 0.999, 1.0, 1.001, 1.0, 0.999]), repaired)
    assert steady.breaks == ()
    untold = life(entries(values), [])
    assert [(item.index, "no event" in item.why) for item in untold.breaks] == [(4, True)]


def test_steps_that_nobody_told_of_are_rarely_found_where_there_are_none(rng):
    found = 0
    for number in range(300):
        walk = 0.0 if number % 2 else 0.002
        values = 1 + np.cumsum(walk * rng.normal(size=6)) + 0.001 * rng.normal(size=6)
        found += bool(life(entries(values), []).breaks)
    assert found <= 2  # stated: 1 in 1000


def test_calibrations_that_do_not_count_are_left_out_with_the_reason():
    made = entries([1.0, 1.1, 1.0, 1.0, 1.0, 1.0])
    made[1] = made[1]._replace(standing="recalled")
    made[2] = made[2]._replace(u=None)
    made[3] = made[3]._replace(data_files='["same"]', standing="approved")
    made[4] = made[4]._replace(data_files='["same", "more"]')
    made[0] = made[0]._replace(unit="C")
    found = life(made, [])
    assert [entry.id for entry in found.entries] == [4, 6]
    assert [reason for _, reason in found.left_out] == [
        "in C",
        "recalled",
        "no uncertainty",
        "the same data as calibration 4",
    ]


def test_a_single_calibration_tells_no_drift():
    found = life(entries([1.0]), [])
    assert found.drift is None
    told = due(found, Tolerance(0.01), 2.0, datetime.date(2010, 2, 1))
    assert (told.date, told.by_interval) == (None, datetime.date(2012, 1, 1))
    assert "alone" in told.why


def test_two_calibrations_of_one_day_are_one_date():
    """The interval in force is between dates, and the staircase looks at the calibration of an earlier date."""
    made = [*entries([1.0, 1.009], step=2), *entries([1.0, 1.0, 1.0], step=2)[1:2]]
    made[2] = made[2]._replace(id=9, value=1.0089, data_files='["other"]')
    told = due(life(made, []), Tolerance(0.01), None, datetime.date(2012, 2, 1))
    assert (told.interval_years, told.staircase_years) == (2.0, 0.7 * 2.0)
    alone = due(life(made[1:], []), Tolerance(0.01), None, datetime.date(2012, 2, 1))
    assert (alone.interval_years, alone.staircase_years, alone.why) == (1.0, None, "no series has two dates")


def test_a_sensor_is_due_when_its_risk_reaches_5_percent():
    drifting = life(entries(1 + 0.002 * np.arange(8), 0.0005), [])
    told = due(drifting, Tolerance(0.01), None, datetime.date(2017, 6, 1))
    before, after = (told.date - datetime.timedelta(days=3), told.date + datetime.timedelta(days=3))
    assert risk(drifting, Tolerance(0.01), before) < 0.05 < risk(drifting, Tolerance(0.01), after)
    assert datetime.date(2020, 1, 1) < told.date < datetime.date(2022, 1, 1)  # 1 % at 0.2 % a year is five years
    assert told.interval_years == 1.0
    assert told.staircase_years == 1.25  # found within 0.8 of the tolerance
    nominal = Tolerance(0.01, 1000.0, f"m{drifting.entries[-1].unit}")
    in_milli = due(drifting, nominal, None, datetime.date(2017, 6, 1))
    assert in_milli == due(drifting, Tolerance(0.01, 1.0), None, datetime.date(2017, 6, 1))
    with pytest.raises(InputError, match="measures something else"):
        Tolerance(0.01, 1.0, "m/s").limits(drifting)
    tight = due(drifting, Tolerance(0.0004), None, datetime.date(2017, 6, 1))
    assert tight.staircase_years == 0.7
    assert tight.date == drifting.entries[-1].date  # at once: U alone is as large


def test_limits_of_the_control_charts_are_those_of_the_literature():
    """Run lengths of Montgomery, Introduction to Statistical Quality Control, tables 9.3 and 9.11."""
    assert control.cusum_run_length(5.0) / 2 == pytest.approx(465, abs=1)
    assert control.cusum_run_length(4.0) / 2 == pytest.approx(168, abs=1)
    assert control.ewma_run_length(2.998) == pytest.approx(500, abs=1)


def test_control_charts_give_false_alarms_as_stated(rng):
    """Of stable sensors, whatever their calibrations share: 1 % over 20 comparisons."""
    lives, alarms, shared = 3000, np.zeros(2), 0.005
    u = 0.001 * (1 + rng.random(control.LIFE + 1))
    covariance = np.diag(u**2) + shared**2 * (1 + 0.1 * np.eye(u.size)[0][:, None]) * (1 + 0.1 * np.eye(u.size)[0])
    errors = rng.multivariate_normal(np.zeros(u.size), covariance, size=lives)
    restart = np.arange(control.LIFE) == 0
    for row in errors:
        residuals = control.recursive_residuals(1 + row, covariance)
        alarms += [bool(chart.alarm) for chart in control.charts(residuals, restart)]
    assert alarms / lives == pytest.approx([control.FALSE_ALARM] * 2, abs=0.006)


def test_control_charts_find_a_change():
    values = 1 + 0.001 * np.array([0, 1, -1, 0, 3, 4, 3, 4])
    residuals = control.recursive_residuals(values, 1e-6 * np.eye(8))
    assert all(chart.alarm for chart in control.charts(residuals, np.arange(7) == 0))


def test_identified_calibrations_share_their_reference():
    """From the calibration file's ``standard_uncertainty`` to E_n: the whole way."""
    made = []
    for seed in (1, 2):
        given = replace(
            table(seed),
            reference_standard_uncertainty=0.005,
            effects=(
                SystematicEffect("amplifier 12", "gain", 0.002),
                SystematicEffect("mount", "mounting", 0.01, 1000.0),
            ),
            sensor={"serial_number": "4711"},
        )
        rows = rows_of(vibrident.identify(given, estimator="ml"), date=datetime.date(2020 + seed, 1, 1))
        row = rows.parameters[0]
        assert row["name"] == "reference_sensitivity"
        shared = json.loads(row["shared"])
        assert sorted(shared.values()) == pytest.approx([0.002 * row["value"], 0.005 * row["value"]])
        made.append(Entry(seed, rows.calibration["date"], row["value"], row["standard_uncertainty"], "V", None, shared))
    found = agreement(made[1], made[0])
    assert found.correlation > 0.6
    assert abs(found.correlated) > abs(found.ordinary)
    own = [np.sqrt(e.u**2 - sum(u**2 for u in e.shared.values())) for e in made]
    assert found.correlated == pytest.approx((made[1].value - made[0].value) / (2 * np.hypot(*own)), rel=0.02)
