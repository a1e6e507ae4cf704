"""What holds of a tracker: it is least squares over all samples, whatever the units and the cuts, and it covers."""

from __future__ import annotations

import numpy as np
import pytest
from tests.support.random_record import RATE_HZ, TRUTH
from tests.support.tracked import ACCELEROMETER, answered, fed, motion, record, tracker

from vibrident import Calibration, InputError, identify
from vibrident.use.tracking.network import LinearisedCell, SensorNetwork
from vibrident.use.tracking.tracker import Tracker

NAMES = tuple(TRUTH)


def relative(values):
    return np.array([values[name] / TRUTH[name] for name in NAMES])


@pytest.mark.draws(5, 100)
@pytest.mark.parametrize("kind", ["random", "multisine", "sweep"])
@pytest.mark.quick("few-random", "few-sweep")
def test_it_scatters_as_a_batch_does_and_covers(kind, draws):
    """The same samples by `identify`: scatter over both, and z within what the number of draws allows at 1e-4."""
    tracked, batch, u = [], [], []
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        samples = record(kind, 8000, rng)
        found = fed(tracker(rng), *samples).read()
        calibration = Calibration.from_arrays(*samples, RATE_HZ, excitation=kind, model="accelerometer")
        result = identify(calibration)
        tracked.append(relative(found.values) - 1.0)
        u.append(relative(found.uncertainty))
        batch.append(relative({name: result.parameters[name].value for name in NAMES}) - 1.0)
    # the two differ by less than what the scatter of either is: |difference| of 0.46 sd adds a tenth to it at most
    apart = np.std(np.array(tracked) - np.array(batch), axis=0) / np.mean(u, axis=0)
    assert np.all(apart < 0.46), apart
    z = np.array(tracked) / np.array(u)
    from scipy.stats import chi2

    low, high = chi2.ppf([1e-4 / 6, 1 - 1e-4 / 6], draws)
    assert np.all(np.sum(z**2, axis=0) > low)
    assert np.all(np.sum(z**2, axis=0) < high)


def test_the_cell_and_its_sensitivities_are_those_of_a_plain_recursion(rng):
    network = SensorNetwork.from_start_values(ACCELEROMETER, TRUTH, "acceleration", 1.0 / RATE_HZ)
    inputs = rng.normal(size=(53, network.terms))
    state = rng.normal(size=12)

    def plain(coordinates):
        w, _ = network.weights(coordinates)
        x, out = state[:2].copy(), []
        for c in inputs:
            out.append(w.output @ x + w.feedthrough @ c)
            x = w.transition @ x + w.drive @ c
        return np.array(out)

    start = state.copy()
    start[2:8] = 0.0
    out, _ = LinearisedCell.at_point(network, np.ones(3)).run(start, inputs)
    assert out[:, 0] == pytest.approx(plain(np.ones(3)), rel=1e-12)
    step = 1e-6
    for place in range(3):
        ahead, behind = (plain(np.ones(3) + sign * step * np.eye(3)[place]) for sign in (1.0, -1.0))
        assert out[:, 3 + place] == pytest.approx((ahead - behind) / (2 * step), rel=1e-6, abs=1e-7)


@pytest.mark.parametrize("cuts", [lambda n: list(range(1, n, 997)), lambda n: [*range(1, 600), 12345]])
def test_it_does_not_matter_where_a_record_is_cut(cuts):
    ends = []
    for chosen in (lambda n: [], cuts):
        rng = np.random.default_rng(5)
        samples = record("random", 20000, rng)
        ends.append(fed(tracker(rng), *samples, chosen))
    assert ends[0].state.root == pytest.approx(ends[1].state.root, rel=1e-9, abs=1e-9)
    assert relative(ends[0].read().values) == pytest.approx(relative(ends[1].read().values), rel=1e-13)


def test_units_change_nothing_but_the_numbers():
    rng = np.random.default_rng(7)
    u, y = record("random", 12000, rng)
    covariance = np.diag([(0.05 * value) ** 2 for value in TRUTH.values()])
    plain = fed(tracker(None), u, y).read()
    scaled = {**TRUTH, "sensitivity": 0.1 * 1e6 / 9.80665}
    factor = np.array([1e6 / 9.80665, 1.0, 1.0])
    other = fed(Tracker(ACCELEROMETER, scaled, covariance * np.outer(factor, factor), RATE_HZ), 9.80665 * u, 1e6 * y)
    found = other.read()
    for name, times in zip(NAMES, factor, strict=True):
        assert found.values[name] / times == pytest.approx(plain.values[name], rel=1e-11)
        assert found.uncertainty[name] / times == pytest.approx(plain.uncertainty[name], rel=1e-9)


@pytest.mark.parametrize("what", ["rest", "dead reference", "tone"])
def test_what_does_not_excite_moves_nothing(what, rng):
    n = 60000
    noise = 1e-3 * rng.normal(size=n)
    u, y = {
        "rest": lambda: (np.zeros(n), noise),
        "dead reference": lambda: (np.full(n, 3.3), record("random", n, rng)[1]),
        "tone": lambda: record("tone", n, rng),
    }[what]()
    one = tracker(None, u=1e-3)
    one.feed(u[: n // 2], y[: n // 2])
    one.read()
    one.feed(u[n // 2 :], y[n // 2 :])
    found = one.read()
    assert found.excited == ()
    assert not one.alarms
    assert np.all(np.abs(relative(found.values) - 1.0) < 3.0 * relative(found.uncertainty))
    if what != "tone":
        assert relative(found.values) == pytest.approx(np.ones(3), rel=1e-12)
        assert relative(found.uncertainty) == pytest.approx(1e-3, rel=1e-4)


def test_a_gap_restarts_the_state_and_keeps_the_parameters(rng):
    u, y = record("random", 40000, rng)
    y[20000:20050] = np.nan
    one = fed(tracker(rng), u, y)
    found = one.read()
    assert one.knowledge.time_s == pytest.approx((40000 - 40) / RATE_HZ, abs=1e-9)
    assert not one.alarms
    assert np.all(np.abs(relative(found.values) - 1.0) < 4.0 * relative(found.uncertainty))


def test_coloured_noise_is_covered():
    from scipy.signal import lfilter

    z = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        u, y = record("random", 12000, rng, noise=0.0)
        noise = lfilter([1.0], [1.0, -0.95], rng.normal(size=2 * len(y)))[len(y) :]
        found = fed(tracker(rng), u, y + 0.01 * np.std(y) * noise / np.std(noise)).read()
        z.append((relative(found.values) - 1.0) / relative(found.uncertainty))
    from scipy.stats import chi2

    low, high = chi2.ppf([1e-4 / 6, 1 - 1e-4 / 6], 30)
    assert np.all(np.sum(np.array(z) ** 2, axis=0) > low)
    assert np.all(np.sum(np.array(z) ** 2, axis=0) < high)


def test_a_saved_state_goes_on_as_if_nothing_had_happened(rng):
    u, y = record("random", 20000, rng)
    whole = fed(tracker(None), u, y)
    half = tracker(None)
    half.feed(u[:7777], y[:7777])
    resumed = tracker(None)
    resumed.state.restore(half.state.save())
    resumed.feed(u[7777:], y[7777:])
    resumed.finish()
    assert resumed.read().values == pytest.approx(whole.read().values, rel=1e-13)
    damaged = bytearray(half.state.save())
    damaged[100] ^= 1
    with pytest.raises(InputError, match="cannot be used"):
        resumed.state.restore(bytes(damaged))


CHANGES = {
    "gain": ({"sensitivity": 0.101}, "sensitivity", "gain"),
    "polarity": ({"sensitivity": -0.1}, "sensitivity", "polarity"),
    "dead": ({"sensitivity": 1e-12}, "sensitivity", "dead channel"),
    "resonance": ({"natural_frequency": 1260.0}, "natural_frequency", "natural frequency"),
    "damping": ({"damping_ratio": 0.4}, "damping_ratio", "damping ratio"),
}


@pytest.mark.parametrize("which", CHANGES)
def test_a_change_is_found_timed_and_named(which, rng):
    values, parameter, what = CHANGES[which]
    after = {**TRUTH, **values}
    n = 40000
    u = motion("random", n, rng)
    y = np.where(np.arange(n) < n // 2, answered(u), answered(u, after)) + 0.001 * rng.normal(size=n)
    one = fed(tracker(None, u=1e-3), u, y)
    assert [(alarm.parameter, alarm.what) for alarm in one.alarms] == [(parameter, what)]
    (alarm,) = one.alarms
    information = np.mean((answered(u, after) - answered(u)) ** 2) / 2.0 / 0.001**2  # of a sample
    bound = max(1.0, np.log(86400.0 / 0.01 * RATE_HZ) / information)  # Lorden 1971
    assert 0.0 < (alarm.detected_s - 1.0) * RATE_HZ < 4.0 * bound
    assert abs(alarm.time_s - 1.0) * RATE_HZ < 4.0 * bound
    assert abs(alarm.after - after[parameter]) < 5.0 * alarm.u
    found = one.read()
    assert abs(found.values[parameter] - after[parameter]) < 5.0 * found.uncertainty[parameter]


@pytest.mark.parametrize("size", [10.0, 1000.0])
def test_a_spike_passes_and_takes_nothing_of_what_is_known(size, rng):
    u, y = record("random", 60000, rng)
    plain = fed(tracker(None, u=1e-3), u, y).read()
    y[30000] += size * 0.01 * np.std(y)
    one = fed(tracker(None, u=1e-3), u, y)
    assert [alarm.what for alarm in one.alarms] == ["a disturbance that has passed"]
    assert one.alarms[0].detected_s == pytest.approx(30001 / RATE_HZ, abs=1e-9)
    found = one.read()
    assert relative(found.uncertainty) == pytest.approx(relative(plain.uncertainty), rel=0.05)
    assert np.all(np.abs(relative(found.values) - relative(plain.values)) < relative(plain.uncertainty))


def test_a_change_is_said_to_be_under_way_until_it_has_a_name(rng):
    u = motion("random", 40000, rng)
    y = np.where(np.arange(40000) < 20000, answered(u), answered(u, {**TRUTH, "sensitivity": 0.11}))
    y += 0.001 * rng.normal(size=40000)
    one = tracker(None, u=1e-3)
    one.feed(u[:20100], y[:20100])
    seen = one.changing
    assert seen is not None
    assert not one.alarms
    one.feed(u[20100:], y[20100:])
    assert one.changing is None
    assert (one.alarms[0].time_s, one.alarms[0].detected_s) == seen


def test_a_small_change_waits_for_its_name(rng):
    """Of 0.1 %: a block tells it to a third."""
    n = 1_000_000
    u = motion("random", n, rng)
    y = np.where(np.arange(n) < n // 2, answered(u), answered(u, {**TRUTH, "sensitivity": 0.1001}))
    one = fed(tracker(None, u=1e-3), u, y + 0.01 * np.std(y) * rng.normal(size=n))
    assert [alarm.what for alarm in one.alarms] == ["gain"]
    assert abs(one.alarms[0].after - 0.1001) < 4.0 * one.alarms[0].u


def test_a_second_mode_is_told_by_the_innovation(rng):
    n = 40000
    u = motion("random", n, rng)
    mode = {"mode2_frequency": 2600.0, "mode2_damping": 0.03, "mode2_gain": 0.01}
    y = np.where(np.arange(n) < n // 2, answered(u), answered(u, {**TRUTH, **mode}, "accelerometer+mode2"))
    one = fed(tracker(None, u=1e-3), u, y + 0.001 * rng.normal(size=n))
    first = next(alarm for alarm in one.alarms if alarm.parameter == "innovation")
    assert abs(first.time_s - n / 2 / RATE_HZ) < 1024 / RATE_HZ
    assert first.after - first.before > 5.0 * first.u


def test_the_random_walk_begins_with_the_first_sample_whatever_the_clock_says(rng):
    u, y = record("random", 20000, rng)
    ends = []
    for start_s in (0.0, 1.4e9):
        one = tracker(None, u=1e-3)
        one.begin(start_s)
        ends.append(fed(one, u, y).read())
    assert relative(ends[1].uncertainty) == pytest.approx(relative(ends[0].uncertainty), rel=1e-6)
    assert relative(ends[1].values) == pytest.approx(relative(ends[0].values), rel=1e-9)
