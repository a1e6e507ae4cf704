"""Small fleets as files: tables that are identified in a moment, broken ones, and ones that end their process."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

GOOD = """[sensor]
type = "{type}"
serial_number = "{serial}"
model = "accelerometer"
[response]
unit = "V"
[table]
file = "frf.csv"
frequency = 1
magnitude = 2
phase = 3
magnitude_uncertainty = 4
phase_uncertainty = 5
"""

#: How a calibration can be broken: folder → None, and what the message says.
BROKEN: dict[str, tuple[Callable[[Path], object], str]] = {
    "no-toml": (lambda f: (f / "c.toml").write_text("[sensor\nmodel ="), "not valid TOML"),
    "unknown-key": (lambda f: _edit(f, "phase =", "fase ="), "is not known here"),
    "no-data": (lambda f: (f / "frf.csv").unlink(), "cannot be read"),
    "empty-data": (lambda f: (f / "frf.csv").write_text(""), ""),
    "no-column": (lambda f: _edit(f, "magnitude = 2", 'magnitude = "m"'), "no column named"),
    "not-a-number": (lambda f: _data(f, lambda text: text.replace("1", "x", 40)), ""),
    "negative": (lambda f: _data(f, lambda text: text.replace("\n", "\n-", 3)), "above zero"),
    "table-and-records": (lambda f: _edit(f, "[table]", '[[records]]\nfile="a"\nexcitation="sine"\n[table]'), "either"),
    "no-model": (lambda f: _edit(f, '"accelerometer"', '"akzelerometer"'), "did you mean"),
    "not-utf8": (lambda f: (f / "c.toml").write_bytes(b"\xff\xfe[sensor]"), "UTF-8"),
}

#: Python runs this before all else where it is on the path: it ends processes of a fleet that open certain files,
#: and makes extras missing.
DEADLY = """
import os, signal, sys, time
class Missing:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("plotly", "typst", "dask", "distributed", "nicegui"):
            raise ImportError(name)
if "WITHOUT_EXTRAS" in os.environ:
    sys.meta_path.insert(0, Missing())
if any("vibrident.base.process" in argument for argument in sys.orig_argv):
    def hook(event, arguments):
        if event != "open" or not isinstance(arguments[0], str) or not arguments[0].endswith(".csv"):
            return
        if os.path.exists("segfault"):
            os.kill(os.getpid(), signal.SIGSEGV)
        if os.path.exists("exits"):
            os._exit(7)
        if os.path.exists("hungry"):
            bytearray(1 << 46)
        if os.path.exists("hangs"):
            open("begun", "w").close()
            time.sleep(1000)
        if os.path.exists("slow"):
            time.sleep(0.15)
    sys.addaudithook(hook)
"""


def good(folder: Path, number: int, type_: str = "A-100", spread: float = 0.01) -> Path:
    """A calibration by table of an accelerometer; return its file."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(number)
    gain = 0.01 * (1 + spread * rng.standard_normal())
    natural, damping = 5000 * (1 + spread * rng.standard_normal()), 0.3
    frequency = np.geomspace(50, 8000, 15)
    ratio = frequency / natural
    response = gain / (1 - ratio**2 + 2j * damping * ratio)
    noise = 1e-3 * (rng.standard_normal(15) + 1j * rng.standard_normal(15))
    response = response * (1 + noise)
    rows = zip(frequency, abs(response), np.degrees(np.angle(response)), abs(response) * 1e-3, strict=True)
    lines = [f"{f:.9g},{m:.9g},{p:.9g},{u:.4g},{math.degrees(1e-3):.4g}" for f, m, p, u in rows]
    (folder / "frf.csv").write_text("f,S,phase,u,u_phase\n" + "\n".join(lines) + "\n", encoding="utf-8")
    file = folder / "c.toml"
    file.write_text(GOOD.format(type=type_, serial=f"SN{number:04d}"), encoding="utf-8")
    return file


def fleet(folder: Path, count: int) -> Path:
    """So many good calibrations, each in a folder of its own."""
    for number in range(count):
        good(folder / f"s{number:03d}", number)
    return folder


def broken(folder: Path) -> Path:
    """One calibration broken in each way."""
    for number, (name, (spoil, _)) in enumerate(BROKEN.items()):
        good(folder / name, 500 + number)
        spoil(folder / name)
    return folder


def deadly(folder: Path, *ways: str) -> Path:
    """Calibrations that end their process, or keep it, where ``DEADLY`` is on the path; ``slow`` ones take long."""
    for number, way in enumerate(ways):
        good(folder / way, 900 + number)
        (folder / way / way.rpartition("-")[2]).touch()
    return folder


def _edit(folder: Path, old: str, new: str) -> None:
    file = folder / "c.toml"
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new, 1), encoding="utf-8")


def _data(folder: Path, change: Callable[[str], str]) -> None:
    file = folder / "frf.csv"
    file.write_text(change(file.read_text(encoding="utf-8")), encoding="utf-8")
