"""Long records are identified in memory that grows with little more than what must be held of them."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

#: Bytes a sample. What must be held (reference and response, in the records and in the network's chunks) is 40; most of
#: the rest are the Jacobian's columns and their transforms, for the covariance. Measured 130 to 170.
MOST_GROWTH = 250
SAMPLES = 600_000
CLEAR = Path("/proc/self/clear_refs")

CHILD = """
import json, sys
from pathlib import Path
import vibrident
from vibrident.base.memory import give_back
from vibrident.physics.simulation import simulate, with_noise

def peak():
    text = Path("/proc/self/status").read_text()
    return 1024 * int(text.split("VmHWM:")[1].split()[0])

def calibration(n, records):
    clean = simulate("paper", "random", samples=n, repeats=records, start="steady", seed=7)
    return with_noise(clean, response_noise=0.01, seed=7)

peaks = []
for size in sys.argv[1:]:
    data = calibration(*map(int, size.split("x")))
    vibrident.identify(data, "accelerometer", "ipnn")  # compiles
    give_back()
    Path("/proc/self/clear_refs").write_text("5")  # the peak counts from here
    vibrident.identify(data, "accelerometer", "ipnn")
    peaks.append(peak())
print(json.dumps(peaks))
"""


@pytest.mark.skipif(not CLEAR.exists(), reason="the system does not tell the peak of a part of a process's life")
@pytest.mark.slow
@pytest.mark.parametrize(("first", "second"), [(f"{SAMPLES}x1", f"{2 * SAMPLES}x1"), (f"{SAMPLES}x1", f"{SAMPLES}x2")])
def test_memory_grows_by_little_a_sample(first, second):
    """From N to 2 N samples, of one record or of two, the peak of resident memory grows by so many bytes a sample."""
    command = [sys.executable, "-c", CHILD, first, second]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    small, large = json.loads(done.stdout)
    assert (large - small) / SAMPLES < MOST_GROWTH
