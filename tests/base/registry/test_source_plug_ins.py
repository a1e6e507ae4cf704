"""The sources of examples/sources: samples of a stand-in for each driver give what the same samples of a file give."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from tests.support.plug_ins import install
from tests.support.random_record import RATE_HZ, TRUTH
from tests.support.sources import ROOT
from tests.support.tracked import answered, motion

from vibrident import Calibration, identify

SAMPLES, PIECE = 40000, 2000
CALIBRATION = """[sensor]
model = "accelerometer"
[reference]
column = 2
scale = 8.0
[response]
column = 1
[sampling]
rate_hz = 20000.0
[[records]]
file = "record.csv"
excitation = "random"
"""
SOUND_CARD = """
import numpy as np
class PortAudioError(Exception): pass
class InputStream:
    def __init__(self, samplerate, device, channels, dtype):
        if device == "none": raise ValueError("No input device matching 'none'")
        assert (device, channels, dtype) == (3, 2, "float32")
        self.samplerate, self.rest, self.reads = samplerate, np.load("samples.npy").astype(np.float32), 0
    def __enter__(self): return self
    def __exit__(self, *_): pass
    def read(self, frames):
        if not len(self.rest): raise KeyboardInterrupt
        if self.reads == 2:  # the second piece is lost
            self.rest = self.rest[frames:]
        taken, self.rest, self.reads = self.rest[:frames], self.rest[frames:], self.reads + 1
        return taken, self.reads == 3
"""
DAQ = {
    "__init__": """
import types
import numpy as np
from nidaqmx.errors import Error
class Task:
    def __init__(self):
        self.places, self.rest = [], np.load("samples.npy").T
        self.ai_channels = self.timing = self
        self.in_stream = self
    def add_ai_voltage_chan(self, name):
        device, place = name.split("/ai")
        if device != "Dev7": raise Error("Device identifier is invalid.\\nStatus Code: -200220")
        self.places.append(int(place))
    def cfg_samp_clk_timing(self, rate, sample_mode, samps_per_chan): self.samp_clk_rate = rate
    def start(self): pass
    def close(self): pass
    def __enter__(self): return self
    def __exit__(self, *_): pass
""",
    "errors": "class Error(Exception): pass\n",
    "constants": "class AcquisitionType: CONTINUOUS = 10123\n",
    "stream_readers": """
class AnalogMultiChannelReader:
    def __init__(self, task): self.task = task
    def read_many_sample(self, data, number_of_samples_per_channel, timeout):
        if not self.task.rest.size: raise KeyboardInterrupt
        data[:] = self.task.rest[self.task.places, :number_of_samples_per_channel]
        self.task.rest = self.task.rest[:, number_of_samples_per_channel:]
""",
}


@pytest.fixture(scope="module")
def case(tmp_path_factory):
    """A result, a calibration file, samples whose gain changes by 1 %, the plug-ins and the stand-ins."""
    folder, site = tmp_path_factory.mktemp("devices"), tmp_path_factory.mktemp("site")
    rng = np.random.default_rng(1)
    u = motion("random", 8000, rng)
    y = answered(u) + 1e-3 * rng.normal(size=len(u))
    identify(Calibration.from_arrays(u, y, RATE_HZ, excitation="random")).save(folder / "result.json")
    u = motion("random", SAMPLES, rng)
    y = np.where(np.arange(SAMPLES) < SAMPLES // 2, answered(u), answered(u, {**TRUTH, "sensitivity": 0.101}))
    samples = np.column_stack([y + 1e-3 * rng.normal(size=SAMPLES), u / 8.0]).astype(np.float32)
    np.save(folder / "samples.npy", samples)
    np.savetxt(folder / "record.csv", samples, delimiter=",", fmt="%.9g")
    (folder / "cal.toml").write_text(CALIBRATION)
    install(ROOT / "examples" / "sources", site)
    (site / "sounddevice.py").write_text(SOUND_CARD)
    (site / "nidaqmx").mkdir()
    for name, text in DAQ.items():
        (site / "nidaqmx" / f"{name}.py").write_text(text)
    return folder, site


#: Several commands in one process, which loads all that they need once: the exit code of each and what it says.
TRACK = """
import json, sys
from typer.testing import CliRunner
from vibrident.app.cli import app
for words in json.load(sys.stdin):
    done = CliRunner().invoke(app, ["track", "result.json", *words, "--no-pictures"])
    print(json.dumps([done.exit_code, done.stderr + (repr(done.exception) if done.exit_code == 1 else "")]))
"""


def track(case, *commands):
    """Exit code and standard error of each command."""
    folder, site = case
    path = os.pathsep.join([str(site), str(ROOT / "src")])
    done = subprocess.run(
        [sys.executable, "-c", TRACK],
        input=json.dumps(commands),
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    return [tuple(json.loads(line)) for line in done.stdout.splitlines()]


def told(case, name):
    return json.loads((case[0] / name / "track.json").read_text())


@pytest.fixture(scope="module")
def tracked(case):
    """What became of the file, of each device, and of commands that cannot be followed."""
    named = CALIBRATION.replace("column = 2", 'column = "x"').replace("column = 1", 'column = "y"')
    (case[0] / "named.toml").write_text(named)
    commands = {
        "file": ("cal.toml",),
        **{source: ("cal.toml", "--source", source) for source in ("sound-card=3", "ni-daqmx=Dev7")},
        **{source: ("cal.toml", "--source", source) for source in ("sound-card=none", "ni-daqmx=Dev1")},
        "named": ("named.toml", "--source", "sound-card=3"),
    }
    done = track(case, *([*words, "--out", name] for name, words in commands.items()))
    return dict(zip(commands, done, strict=True))


@pytest.mark.parametrize("source", ["sound-card=3", "ni-daqmx=Dev7"])
def test_a_device_is_tracked_as_a_file_is(case, tracked, source):
    assert tracked["file"][0] == 0, tracked["file"]
    assert tracked[source][0] == 0, tracked[source]
    found, wanted = told(case, source), told(case, "file")
    lost = PIECE if source.startswith("sound-card") else 0  # an overflow, after which a new run begins
    assert found["samples"]["taken"] == SAMPLES - lost
    (alarm,) = found["alarms"]
    assert (alarm["parameter"], alarm["what"]) == ("sensitivity", "gain")
    assert abs(alarm["time_s"] + lost / RATE_HZ - 1.0) < 1024 / RATE_HZ  # a block
    for each, value in found["parameters"].items():
        apart = value["value"] - wanted["parameters"][each]["value"]
        assert abs(apart) < (1.0 if lost else 1e-6) * value["standard_uncertainty"]


@pytest.mark.parametrize(
    ("source", "said"),
    [("sound-card=none", "cannot be opened"), ("ni-daqmx=Dev1", "Device identifier is invalid.")],
)
def test_a_device_that_is_not_there_is_one_message(tracked, source, said):
    code, message = tracked[source]
    assert code == 2
    assert said in message
    assert "Traceback" not in message


def test_a_missing_library_is_one_message(case, tmp_path):
    install(ROOT / "examples" / "sources", tmp_path / "site")
    for name in ("sounddevice", "nidaqmx"):
        (tmp_path / "site" / f"{name}.py").write_text(f"raise ImportError('no module named {name}')")
    commands = (["cal.toml", "--source", source, "--out", "absent"] for source in ("sound-card", "ni-daqmx"))
    for code, message in track((case[0], tmp_path / "site"), *commands):
        assert code == 2
        assert "There is no" in message
        assert "pip install" in message


def test_channels_are_numbers(tracked):
    code, message = tracked["named"]
    assert code == 2
    assert "Channels of a device have no names" in message
