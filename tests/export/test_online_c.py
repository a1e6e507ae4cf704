"""The tracker in C: built with every warning an error, equal to Python's in all that it says, state for state."""

from __future__ import annotations

import shutil
import subprocess

import numpy as np
import pytest
from tests.support.exported import case as exported
from tests.support.online_c import STRICT, Compiled
from tests.support.random_record import RATE_HZ, TRUTH
from tests.support.sources import ROOT
from tests.support.tracked import answered, motion

from vibrident import Calibration, InputError, Result, identify
from vibrident.export import export
from vibrident.export.online import REACH, build_tracker
from vibrident.export.sensor import read_sensor
from vibrident.use.tracking.state import TrackerSettings

pytestmark = pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc")
NAMES = tuple(TRUTH)
SAMPLES = 60000


@pytest.fixture(scope="module", params=["accelerometer", "accelerometer+delay"])
def case(request, tmp_path_factory):
    """Result and folder with the sources; with a delay, the response is 2.3 samples late."""
    rng = np.random.default_rng(1)
    u = motion("random", 8000, rng)
    late = {**TRUTH, "delay": 2.3 / RATE_HZ}
    y = answered(u, late if "delay" in request.param else TRUTH, request.param) + 1e-3 * rng.normal(size=len(u))
    result = identify(Calibration.from_arrays(u, y, RATE_HZ, excitation="random", model=request.param))
    folder = tmp_path_factory.mktemp("online")
    export(result, "c", folder, rate_hz=RATE_HZ, online=True)
    return result, folder, request.param


def python(result: Result):
    return build_tracker(read_sensor(result, None), RATE_HZ, TrackerSettings())


def lost_by_inversion(tracker) -> float:
    """Part of u that rounding takes where R is inverted, m ε cond(R): an alarm that opens a parameter enlarges it."""
    root = tracker.knowledge.walked()[tracker.network.nuisances :, tracker.network.nuisances : -1]
    return len(root) * np.finfo(float).eps * float(np.linalg.cond(root))


def numbers(state: bytes):
    return np.frombuffer(state[16:-4])


CHANGES = {
    "none": {},
    "gain": {"sensitivity": 0.101},
    "dead": {"sensitivity": 1e-12},
    "polarity": {"sensitivity": -0.1},
    "resonance": {"natural_frequency": 1260.0},
    "damping": {"damping_ratio": 0.4},
    "noise": {"noise": 3e-3},
    "gap": {"gap": 1.0},
    "rest": {"rest": 1.0},
}


def samples(which: str, model: str):
    rng = np.random.default_rng(2)
    before = {**TRUTH, "delay": 2.3 / RATE_HZ} if "delay" in model else TRUTH
    after = {**before, **{name: v for name, v in CHANGES[which].items() if name in before}}
    u = motion("random", SAMPLES, rng)
    if which == "rest":
        u[SAMPLES // 3 : SAMPLES // 2] = 0.0
    half = np.arange(SAMPLES) < SAMPLES // 2
    noise = np.where(half, 1e-3, CHANGES[which].get("noise", 1e-3))
    y = np.where(half, answered(u, before, model), answered(u, after, model)) + noise * rng.normal(size=SAMPLES)
    if which == "gap":
        y[SAMPLES // 2 : SAMPLES // 2 + 30] = np.nan
    return u, y


@pytest.mark.parametrize("which", CHANGES)
def test_both_say_the_same(case, which):
    result, folder, model = case
    names = result.to_sensor().model.parameter_names
    one, other = python(result), Compiled(folder, len(names))
    u, y = samples(which, model)
    at = 0
    for cut in (700, 12345, SAMPLES // 2 + 500, SAMPLES // 2 + 3000, SAMPLES):
        one.feed(u[at:cut], y[at:cut])
        other.feed(u[at:cut].copy(), y[at:cut].copy())
        at = cut
        found, (value, uncertainty, excited, rms) = one.read(), other.read()
        assert value == pytest.approx(list(found.values.values()), rel=1e-9)
        assert uncertainty == pytest.approx(list(found.uncertainty.values()), rel=max(1e-9, lost_by_inversion(one)))
        assert tuple(name for name, e in zip(names, excited, strict=True) if e) == found.excited
        assert (rms if rms >= 0.0 else np.nan) == pytest.approx(found.innovation, rel=1e-9, nan_ok=True)
    ours, theirs = numbers(one.state.save()), numbers(other.save())
    assert ours.shape == theirs.shape
    at = 0
    for part in one.state.views:  # each of its own size
        size = float(np.nanmax(np.abs(part), initial=0.0))
        assert theirs[at : at + part.size] == pytest.approx(part.ravel(), rel=1e-9, abs=1e-9 * size, nan_ok=True)
        at += part.size
    assert (which == "none") <= (not one.alarms)
    for place, alarm in enumerate(one.alarms):
        parameter, numbers_of_it = other.alarm(place)
        assert [*names, "innovation"][parameter] == alarm.parameter
        stated = [alarm.time_s, alarm.detected_s, alarm.before, alarm.after, alarm.u]
        size = max(abs(alarm.before), abs(alarm.after))
        assert numbers_of_it == pytest.approx(stated, rel=1e-9, abs=1e-9 * size)


def test_a_state_travels_both_ways(case):
    result, folder, model = case
    u, y = samples("none", model)
    whole = python(result)
    whole.feed(u, y)
    wanted = list(whole.read().values.values())
    compiled = Compiled(folder, len(wanted))
    compiled.feed(u[:30001].copy(), y[:30001].copy())
    one = python(result)
    one.state.restore(compiled.save())
    one.feed(u[30001:], y[30001:])
    assert list(one.read().values.values()) == pytest.approx(wanted, rel=1e-9)
    half = python(result)
    half.feed(u[:20002], y[:20002])
    saved = half.state.save()
    compiled.start(0.0)
    assert compiled.restore(saved)
    compiled.feed(u[20002:].copy(), y[20002:].copy())
    assert compiled.read()[0] == pytest.approx(wanted, rel=1e-9)
    damaged = bytearray(saved)
    damaged[200] ^= 4
    assert not compiled.restore(bytes(damaged))
    assert not compiled.restore(saved[:-8])


def test_float_is_within_a_fifth_of_u_of_double(case):
    result, folder, model = case
    u, y = samples("none", model)
    ends = []
    for single in (False, True):
        compiled = Compiled(folder, len(result.to_sensor().values), single=single)
        compiled.feed(u, y)
        ends.append(compiled.read())
    assert np.all(np.abs(ends[1][0] - ends[0][0]) < 0.2 * ends[0][1])
    assert ends[1][1] == pytest.approx(ends[0][1], rel=0.01)


def test_the_corrector_gives_the_acceleration_back_with_the_parameters_of_the_moment(case):
    result, folder, model = case
    rng = np.random.default_rng(4)
    after = {**TRUTH, "sensitivity": 0.105, "natural_frequency": 1260.0}
    after |= {"delay": 2.3 / RATE_HZ} if "delay" in model else {}
    u, y = motion("random", SAMPLES, rng), None
    y = answered(u, after, model)
    compiled = Compiled(folder, len(result.to_sensor().values))
    part = slice(SAMPLES // 2, SAMPLES)

    def error():
        late = REACH + (2 if "delay" in model else 0)
        found = compiled.corrected(y[part].copy())[2 * REACH :]
        wanted = u[part][2 * REACH - late : SAMPLES // 2 - late]
        return np.sqrt(np.mean((found - wanted) ** 2) / np.mean(wanted**2))

    shock = np.zeros(2000)
    shock[1000:1040] = np.sin(np.pi * np.arange(40) / 40.0) ** 2

    def peak():
        return float(np.max(compiled.corrected(answered(shock, after, model))[2 * REACH :])) - 1.0

    fixed, fixed_peak = error(), peak()
    compiled.feed(u, y + 1e-3 * rng.normal(size=SAMPLES))
    assert fixed > 0.03
    assert error() < 2e-3
    assert abs(fixed_peak) > 0.03
    assert abs(peak()) < 0.005


def test_a_sensor_that_the_code_does_not_have_is_refused(tmp_path):
    result = exported("coil")
    with pytest.raises(InputError, match="cannot be exported as a tracker"):
        export(result, "c", tmp_path, rate_hz=RATE_HZ, online=True)


@pytest.mark.parametrize("case", ["accelerometer"], indirect=True)
def test_the_example_on_standard_input_says_what_changed(case, tmp_path):
    result, folder, model = case
    for name in ("sensor.h", "sensor.c"):
        shutil.copy(folder / name, tmp_path)
    shutil.copy(ROOT / "examples" / "online" / "main.c", tmp_path)
    subprocess.run([*STRICT, "-o", "track", "main.c", "sensor.c", "-lm"], cwd=tmp_path, check=True)
    u, y = samples("gain", model)
    text = "\n".join(f"{a!r} {b!r}" for a, b in zip(u.tolist(), y.tolist(), strict=True))
    said = subprocess.run(
        [tmp_path / "track"], input=text, capture_output=True, text=True, check=True
    ).stdout.splitlines()
    (alarm,) = [line for line in said if line.startswith("alarm")]
    one = python(result)
    one.feed(u, y)
    assert f"parameter 0 at {one.alarms[0].time_s:.6f} s" in alarm
    one.finish()
    assert float(said[-1].split()[1]) == pytest.approx(one.read().values["sensitivity"], rel=1e-8)
