"""The exported tracker as firmware: on a Cortex-M4F in qemu, and by cppcheck with its MISRA addon."""

from __future__ import annotations

import re
import shutil
import subprocess

import numpy as np
import pytest
from tests.support import cortex
from tests.support.exported import result
from tests.support.online_c import Compiled
from tests.support.random_record import RATE_HZ, TRUTH
from tests.support.sources import ROOT
from tests.support.tracked import answered, motion

from vibrident.export import export
from vibrident.export.online import build_tracker
from vibrident.export.sensor import read_sensor
from vibrident.use.tracking.state import TrackerSettings

SAMPLES = 40000


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """A sensor, its sources, and samples of single precision in whose middle its gain changes by 1 %."""
    folder = tmp_path_factory.mktemp("firmware")
    known = result("accelerometer", TRUTH, (20.0, 4000.0))
    export(known, "c", folder, rate_hz=RATE_HZ, online=True)
    rng = np.random.default_rng(2)
    u = motion("random", SAMPLES, rng)
    y = np.where(np.arange(SAMPLES) < SAMPLES // 2, answered(u), answered(u, {**TRUTH, "sensitivity": 0.101}))
    y += 1e-3 * rng.normal(size=SAMPLES)
    return known, folder, *(each.astype(np.float32).astype(float) for each in (u, y))


@pytest.mark.skipif(cortex.missing() is not None, reason=str(cortex.missing()))
def test_a_cortex_m4f_says_what_the_same_code_says_here(case):
    known, folder, u, y = case
    said = cortex.run(folder, u, y)
    here = Compiled(folder, len(TRUTH), single=True)
    here.feed(u, y)
    here.finish()
    value, uncertainty, *_ = here.read()
    found = np.array(said.parameters)
    # both round each sample alike; the mathematical functions of the two libraries differ in the last digit
    assert np.all(np.abs(found[:, 0] - value) < 1e-3 * uncertainty)
    assert found[:, 1] == pytest.approx(uncertainty, rel=1e-3)
    ((parameter, time_s, before, after),) = said.alarms
    place, numbers = here.alarm(0)
    assert place == parameter == 0
    assert [time_s, before, after] == pytest.approx(numbers[[0, 2, 3]].tolist(), rel=1e-6)
    assert abs(found[0, 0] - 0.101) < 4.0 * found[0, 1]
    one = build_tracker(read_sensor(known, None), RATE_HZ, TrackerSettings())
    one.state.restore(said.state)
    assert list(one.read().values.values()) == pytest.approx(found[:, 0].tolist(), rel=1e-8)
    assert 0 < said.instructions[0] < said.instructions[1]
    assert said.ram[1] < 65536  # the stack was painted so far


@pytest.mark.skipif(shutil.which("cppcheck") is None, reason="there is no cppcheck")
@pytest.mark.slow
def test_the_deviations_from_misra_are_those_of_the_study(case):
    """By what cppcheck's addon looks at; nothing is claimed of the other rules."""
    command = ["cppcheck", "--std=c99", "--addon=misra", "--quiet", "--template={id}", "sensor.c"]
    done = subprocess.run(command, cwd=case[1], capture_output=True, text=True, check=True)
    found = set(re.findall(r"misra-c2012-(\d+\.\d+)", done.stderr))
    text = (ROOT / "studies" / "misra.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"^\| (\d+\.\d+) \|", text, re.MULTILINE))
    assert found
    assert found <= listed
