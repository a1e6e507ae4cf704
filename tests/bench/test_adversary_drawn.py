"""The simulators of the drawn groups against an integrator or the sum that they abbreviate."""

from __future__ import annotations

import numpy as np
import pytest
from bench.adversary import groups, motions, unlike
from bench.adversary.cases import CASES, GROUPS
from bench.adversary.clocks import at_steps
from bench.adversary.draws import COLOURS, MOTIONS, draw_motions, draw_setting
from bench.adversary.friction import rubbed
from bench.adversary.held import KINDS, held_response, joined_response, stairs
from bench.adversary.noise import added, rms
from bench.adversary.physics import TAU, Motion, Sensor
from scipy.integrate import solve_ivp

CORE = {"sensitivity": 2.0, "natural_frequency": 12.0, "damping_ratio": 0.05}
RATE = 200.0


def integrate(slope, time_s, breaks=()):
    """State at the times, restarted where the right-hand side jumps."""
    state, begin, values = np.zeros(2), time_s[0], []
    for end in (*breaks, np.inf):
        within = time_s[(time_s >= begin) & (time_s < end)]
        stop = end if np.isfinite(end) else time_s[-1]
        stops = np.append(within, stop) if np.isfinite(end) else within
        way = solve_ivp(slope, (begin, stop), state, "DOP853", stops, rtol=1e-10, atol=1e-12)
        values.append(way.y[:, : within.size])
        state, begin = way.y[:, -1], stop
    return np.concatenate(values, axis=1)


def test_a_motion_seen_later_is_the_same_motion(rng):
    motion = motions.random((5.0, 60.0), 1.0, 800, RATE, rng)
    t = np.arange(800) / RATE
    later = motion.later(137 / RATE).acceleration(t)
    assert np.allclose(later[:600], motion.acceleration(t)[137:737], atol=1e-10)


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("quantity", ["velocity", "displacement"])
def test_the_reference_is_the_integral_of_the_acceleration(motion, quantity, rng):
    given, _ = draw_setting("accelerometer", quantity, rng, places=("in",))
    move = draw_motions(motion, given, rng, (1, 1000))[0]
    spectrum = 1j * TAU * move.frequency_hz
    order = {"velocity": 1, "displacement": 2}[quantity]
    t = np.arange(1000) / given.rate
    derivative = Motion(move.frequency_hz, move.amplitude / spectrum**order)
    expected = Motion(move.frequency_hz, derivative.amplitude * spectrum**order).acceleration(t)
    assert np.allclose(expected, move.acceleration(t), atol=1e-9 * rms(expected))
    assert np.allclose(derivative.acceleration(t), move.reference(t, quantity))
    if "running" in motion:
        assert rms(move.acceleration(t)[:50]) > 1e-3 * rms(move.acceleration(t))


@pytest.mark.parametrize("error", [1e-6, -4e-2])
def test_samples_of_another_clock_are_the_sum_of_the_tones(error, rng):
    motion = motions.random((5.0, 60.0), 1.0, 900, RATE, rng)
    step = (1.0 + error) / RATE
    expected = np.real(np.exp(2j * np.pi * np.outer(np.arange(900) * step, motion.frequency_hz)) @ motion.amplitude)
    assert np.allclose(at_steps(motion, step, 900), expected, atol=1e-10)


@pytest.mark.parametrize("respond", [held_response, joined_response])
@pytest.mark.parametrize("name", ["accelerometer", "velocity-pickup"])
def test_the_response_to_a_held_or_joined_input_is_what_an_integrator_finds(name, respond, rng):
    gain = "generator_constant" if name == "velocity-pickup" else "sensitivity"
    p = {gain: -3.0, "natural_frequency": 12.0, "damping_ratio": 1.4}
    w, d = TAU * p["natural_frequency"], p["damping_ratio"]
    levels, t = stairs("staircase", 200, 25, 16.0, rng), np.arange(200) / RATE

    def slope(now, state):
        x, v = state
        if respond is joined_response:
            level = np.interp(now, t, levels)
        else:
            level = levels[min(int(now * RATE + 1e-9), 199)]
        return [v, level - w * w * x - 2.0 * d * w * v]

    x, v = integrate(slope, t, breaks=[(k * 25 - ahead) / RATE for k in range(1, 8) for ahead in (1, 0)])
    expected = -3.0 * (v if name == "velocity-pickup" else w * w * x)
    response = respond(Sensor(name, p), levels, RATE)
    assert np.max(np.abs(response - expected)) < 1e-6 * np.max(np.abs(expected))


@pytest.mark.parametrize("kind", KINDS)
def test_stairs_keep_their_levels(kind, rng):
    levels = stairs(kind, 500, 10, 40.0, rng)
    changes = np.flatnonzero(np.diff(levels))
    assert levels.shape == (500,)
    assert 1 <= changes.size <= 50


def test_without_friction_the_rubbed_sensor_is_linear_and_with_it_an_integrator_agrees(rng):
    sensor, t = Sensor("accelerometer", CORE), np.arange(400) / RATE
    motion = motions.multisine(np.array([3.0, 7.7, 14.0]), 1.0, rng)
    linear = rubbed([motion], sensor, 0.0, 1600, RATE)[0]
    exact = motion.response(sensor, np.arange(1600) / RATE)
    assert rms((linear - exact)[-200:]) < 2e-3 * rms(exact)  # the transient of the start dies out

    part, begin = 0.05, -100 / RATE
    w, d = TAU * CORE["natural_frequency"], CORE["damping_ratio"]
    force = part * np.std(motion.acceleration(np.arange(401) / RATE))

    def slope(now, state):
        x, v = state
        push = float(motion.acceleration(np.array([now]))[0])
        return [v, push - w * w * x - 2.0 * d * w * v - force * np.tanh(v / 1e-5)]

    way = solve_ivp(slope, (begin, t[-1]), [0.0, 0.0], "LSODA", t, rtol=1e-8, atol=1e-12)
    expected = CORE["sensitivity"] * w * w * way.y[0]
    rubbing = rubbed([motion], sensor, part, 400, RATE)[0]
    change = rms(expected - motion.response(sensor, t))
    assert rms(rubbing - expected) < 0.02 * change


@pytest.mark.parametrize("colour", COLOURS)
def test_coloured_noise_has_its_level_and_slope(colour, rng):
    size = 2**15
    noise = added(np.ones(size), 0.1, colour, rng) - 1.0
    assert rms(noise - noise.mean()) == pytest.approx(0.1)
    if colour in ("pink", "brown"):
        power = np.abs(np.fft.rfft(noise * np.hanning(size))) ** 2
        k = np.arange(power.size)
        octaves = [np.mean(power[(k >= low) & (k < 2 * low)]) for low in (64, 4096)]
        slope = np.log(octaves[0] / octaves[1]) / np.log(64.0)
        assert slope == pytest.approx({"pink": 1.0, "brown": 2.0}[colour], abs=0.15)


def test_two_motions_are_summed_with_their_share(rng):
    one, other = (motions.random((5.0, 60.0), 3.0, 4000, RATE, rng) for _ in range(2))
    both = unlike._sum(one, other, 0.3)
    t = np.arange(4000) / RATE
    seen = both.acceleration(t)
    share = np.corrcoef(seen, one.acceleration(t))[0, 1]
    assert share == pytest.approx(0.3, abs=0.1)


def test_every_drawn_group_makes_its_trials():
    for name in ("quantities", "noises", "clocks", "held", "joined", "wild", "unlike", "steady"):
        cases = [case for case in CASES if case.name.startswith(f"{name}/")]
        trial = cases[0].trial(34)
        again = cases[0].trial(34)
        assert trial.drawn == again.drawn
        records = trial.calibration().records
        assert np.array_equal(records[0].response, again.calibration().records[0].response)
        assert trial.cause or name in ("quantities", "noises")
    assert set(GROUPS) >= {"long", "friction"}


def test_the_sums_of_groups_count_classes_and_runaways():
    line = {"name": "held/a", "class": "right", "cpu": 1.0}
    wrong = {"name": "held/b", "class": "silent-wrong", "cpu": 2.5, "runaway": ["sensitivity"]}
    head, row = groups.sums([line, wrong])
    counts = dict(zip(head, row, strict=True))
    assert (counts["cases"], counts["right"], counts["silent-wrong"]) == ("2", "1", "1")
    assert (counts["runaway"], counts["longest"]) == ("1", "2.5")


def test_kept_figures_stand_at_the_end_of_the_page_once(tmp_path, monkeypatch):
    page = tmp_path / "adversary.md"
    page.write_text("# Page\n\nText.\n", encoding="utf-8")
    monkeypatch.setattr(groups, "PAGE", page)
    monkeypatch.setattr(groups, "RESULTS", tmp_path)
    wrong = {"class": "silent-wrong", "cpu": 2.5, "codes": [], "says": [], "z": {"delay": 9.0}}
    for run in (34, 35):
        groups.keep("before", run, [{"name": "held/b", "run": run, **wrong}])
        groups.keep("before", run, [{"name": "wild/a", "run": run, **wrong, "class": "right"}])
    text = page.read_text(encoding="utf-8")
    assert text.startswith("# Page\n\nText.\n\n## Drawn groups: before\n")
    assert text.count("## Drawn groups") == 1
    assert text.count("`held/b` --run 35: delay 9 u; said nothing") == 1
    assert "run 34" not in text
