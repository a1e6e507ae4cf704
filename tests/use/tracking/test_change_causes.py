"""A change that no parameter explains has its cause named, once: a spring that bends, a second mode."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from tests.support.random_record import RATE_HZ, TRUTH
from tests.support.tracked import answered, motion, tracker

from vibrident.data.sources.source import Chunk
from vibrident.use.tracking.causes import Cause
from vibrident.use.tracking.effects import CarriedEffects
from vibrident.use.tracking.session import TrackingSession
from vibrident.use.tracking.state import Alarm

SAMPLES, NOISE = 40000, 1e-3


def said(u, responses, levels, rng):
    """Alarms of a session that takes these responses, one after another."""
    one = tracker(None, u=1e-3)
    count = one.network.parameters
    no_effects = CarriedEffects((), np.zeros((0, count)), np.eye(count), np.zeros(count), (), np.zeros((0, count)))
    session = TrackingSession(one, 4096, {}, Cause(None, "", dict(TRUTH)), no_effects)
    for level, y in zip(levels, responses, strict=True):
        session.take(Chunk(level * u, y + NOISE * rng.normal(size=SAMPLES)))
    session.finish()
    return session


def bent(u, level, gain=1.0):
    """Response of a spring that softens by 5 % of the force at the largest response of level 1, to first order."""
    y = answered(u)
    most = np.max(np.abs(y))
    softer = answered((y / most) ** 3 * most / TRUTH["sensitivity"])
    return gain * (level * y + level**3 * 0.05 * softer)


@pytest.mark.slow
def test_a_second_mode_is_named_with_its_frequency(rng):
    u = motion("random", SAMPLES, rng)
    mode = {"mode2_frequency": 2600.0, "mode2_damping": 0.03, "mode2_gain": 0.01}
    loose = answered(u, {**TRUTH, **mode}, "accelerometer+mode2")
    session = said(u, [answered(u), loose, loose, loose], [1.0] * 4, rng)
    (alarm,) = session.alarms
    assert "second mode at 2600 Hz" in alarm.what
    assert session.cause.code == "lack_of_fit"
    assert session.cause.values["mode2_frequency"] == pytest.approx(2600.0, rel=0.005)
    assert abs(alarm.time_s - SAMPLES / RATE_HZ) < 1024 / RATE_HZ


def test_a_spring_that_bends_is_one_alarm_and_a_change_beside_it_another(rng):
    u = motion("random", SAMPLES, rng)
    levels = [1 / 3, 1.0, 1.0, 1 / 3, 1.0, 1.0]
    session = said(u, [bent(u, level) for level in levels], levels, rng)
    (alarm,) = session.alarms
    assert alarm.what.startswith("nonlinear: the response is bent as by a spring")
    for name, value in TRUTH.items():
        assert session.cause.values[name] == pytest.approx(value, rel=0.005)
    session = said(u, [*(bent(u, level) for level in levels), bent(u, 1.0, 1.02)], [*levels, 1.0], rng)
    first, *others = session.alarms  # in other noise
    (same, size), (named, known) = (re.split(r"(?<=, )(?=[\d.]+ %)", each.what) for each in (first, alarm))
    assert same == named
    assert float(size.split(" %")[0]) == pytest.approx(float(known.split(" %")[0]), rel=0.02)
    assert size.split(" %")[1] == known.split(" %")[1]
    assert [other.what for other in others] == ["gain"]


def test_a_change_of_a_parameter_keeps_its_name(rng):
    u = motion("random", SAMPLES, rng)
    softer = answered(u, {**TRUTH, "natural_frequency": 0.995 * TRUTH["natural_frequency"]})
    session = said(u, [answered(u), softer, answered(u)], [1.0] * 3, rng)
    assert [alarm.what for alarm in session.alarms] == ["natural frequency"] * 2
    assert session.cause.code is None


def test_a_parameter_on_its_way_to_what_it_is_without_the_cause_has_not_changed():
    """Half the motion leaves a quarter of what a spring that bends does: so much of it is no change of the sensor."""
    spring = Cause("nonlinear", "", {"sensitivity": 0.1})
    for after, left in ((0.102, True), (0.0998, True), (0.0996, False), (0.1082, True), (0.1084, False)):
        alarm = Alarm(0.0, 0.0, "sensitivity", 0.108, after, 1e-4, "gain")
        assert spring.ends_with(alarm) == left, after
        assert not replace(spring, code=None).ends_with(alarm)


def high_passed(u, y):
    """As by a high-pass of 5 Hz."""
    hz = np.fft.rfftfreq(SAMPLES, 1.0 / RATE_HZ)
    return np.fft.irfft(np.fft.rfft(y) * (1j * hz / (1j * hz + 5.0)), SAMPLES)


CAUSES = {
    "stiffer on one side": lambda u, y: y + 0.03 * answered(y**2 / np.max(np.abs(y)) / TRUTH["sensitivity"]),
    "a cube of the motion": lambda u, y: y - 0.03 * y**3 / np.max(np.abs(y)) ** 2,
    "high-pass": high_passed,
}


@pytest.mark.parametrize("words", CAUSES)
@pytest.mark.quick("stiffer on one side", "a cube of the motion")
def test_what_the_engine_finds_is_the_cause(words, rng):
    u = motion("random", SAMPLES, rng)
    after = CAUSES[words](u, answered(u))
    session = said(u, [answered(u), after, after], [1.0] * 3, rng)
    said_of = [alarm.what for alarm in session.alarms]
    assert len(said_of) == 1, said_of
    assert words in said_of[0]
