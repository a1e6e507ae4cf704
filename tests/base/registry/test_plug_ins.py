"""The package of examples/plugin, installed, works everywhere; a broken one is named and harms nothing."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from tests.support.plug_ins import described, install
from tests.support.sources import ROOT

EXAMPLE = ROOT / "examples" / "plugin"

#: Entry points of a package that is broken in every way.
BROKEN = """\
[vibrident.exports]
nowhere = no_such_module:THING
csv = broken:THING

[vibrident.models]
number = broken:THING
misnamed = vibrident.physics.models.add_ons.delay:DELAY

[vibrident.estimators]
raising = broken.raising:THING
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    install(EXAMPLE, folder)
    return folder


def run(code: str, *sites: Path, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    path = os.pathsep.join([*map(str, sites), str(ROOT / "src"), str(ROOT)])
    return subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "PYTHONPATH": path, "COLUMNS": "300"},
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


CALIBRATION = """\
[sensor]
model = "convective"
[reference]
column = "a"
scale = 9.80665
unit = "g"
[response]
column = "v"
unit = "V"
[[records]]
file = "*.jsonc"
excitation = "sine"
"""

USED = """
import json, sys
from pathlib import Path
import numpy as np
import vibrident
from typer.testing import CliRunner
from vibrident.app.cli import app

rate, rng = 2000.0, np.random.default_rng(4)
t = np.arange(4000) / rate
for f in (5.0, 10.0, 20.0, 40.0, 80.0, 160.0, 320.0):
    h = 0.1 / (1 + 1j * f / 35.0)
    a = np.sin(2 * np.pi * f * t)
    v = np.imag(9.80665 * h * np.exp(2j * np.pi * f * t)) + 1e-4 * rng.standard_normal(t.size)
    text = json.dumps({"rate_hz": rate, "columns": {"a": a.tolist(), "v": v.tolist()}})
    Path(f"{f:03.0f}Hz.jsonc").write_text(text)
out = {}
for estimator in ("auto", "huber", "ipnn"):
    words = ["identify", "c.toml", "--estimator", estimator, "--out", estimator, "--no-pictures"]
    done = CliRunner().invoke(app, words, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    result = vibrident.Result.load(f"{estimator}/result.json")
    for name, true in {"sensitivity": 0.1, "cutoff_frequency": 35.0}.items():
        p = result.parameters[name]
        assert abs(p.value - true) < 5 * p.standard_uncertainty, (estimator, name, p)
    assert result.fit.adequate and not result.warnings, (estimator, result.warnings)
    out[estimator] = done.output
    took_part = {"convective", "json-columns"} | ({"huber"} if estimator == "huber" else set())
    assert result.provenance["plug_ins"] == dict.fromkeys(took_part, "vibrident-example 1.0"), result.provenance
words = ["identify", "c.toml", "--estimator", "huber", "--no-pictures", "--out", "set", "--set"]
wrong = {"limt=0.5": "did you mean 'limit'", "steps=9": "--steps", "limit": "NAME=VALUE"}
for setting, found in {"limit=0.5": "", **wrong}.items():
    done = CliRunner().invoke(app, [*words, setting], catch_exceptions=False)
    assert done.exit_code == (2 if found else 0) and (not found or found in done.output), done.output
one, other = (vibrident.Result.load(f"{name}/result.json").parameters["sensitivity"].value for name in ("huber", "set"))
assert one != other
assert "cut-off frequency" in out["auto"] and "thermal time constant" in out["auto"]
words = ["compare", "c.toml", "--out", "beside", "--estimators", "huber,ml"]
done = CliRunner().invoke(app, words, catch_exceptions=False)
assert done.exit_code == 0 and "huber" in done.output, done.output
done = CliRunner().invoke(app, ["report", "auto/result.json", "--format", "md"], catch_exceptions=False)
assert done.exit_code == 0, done.output
done = CliRunner().invoke(app, ["export", "auto/result.json", "--format", "octave"], catch_exceptions=False)
assert done.exit_code == 0 and "tf(" in Path("auto/sensor.m").read_text(), done.output
done = CliRunner().invoke(app, ["export", "auto/result.json", "--format", "c", "--rate", "2000"])
assert done.exit_code == 0, done.output
for command, word in (("identify", "huber"), ("identify", "convective"), ("export", "octave"), ("compare", "huber")):
    done = CliRunner().invoke(app, [command, "--help"])
    assert word in done.output, (command, word, done.output)
print("used")
"""

LISTED = """
from docsite.models import models
from vibrident.app.doctor import _plug_ins
from vibrident.fit.estimators import ranked
from vibrident.export.registry import EXPORTS
from vibrident.data.io.reader import by_ending
from vibrident.physics.models import CORES
from vibrident.physics.naming import in_words
from vibrident.app.web.session import ACCEPTED_ENDINGS
assert "convective" in CORES and "octave" in EXPORTS and ".jsonc" in by_ending() and ".jsonc" in ACCEPTED_ENDINGS
assert "huber" in [one.name for one in ranked()]
assert in_words("cutoff_frequency") == "cut-off frequency"
assert "`convective`" in models() and "`cutoff_frequency`" in models()
print(*(check.finding for check in _plug_ins()), sep="\\n")
"""


def test_a_package_adds_a_model_a_reader_an_export_and_an_estimator(site, tmp_path):
    (tmp_path / "c.toml").write_text(CALIBRATION, encoding="utf-8")
    done = run(USED, site, cwd=tmp_path)
    assert done.returncode == 0, done.stderr + done.stdout
    assert done.stdout.endswith("used\n")


def test_it_is_in_the_lists_the_documentation_and_the_doctors_words(site):
    done = run(LISTED, site)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == [
        f"{name} (vibrident.{group}) of vibrident-example 1.0"
        for group, name in (
            ("models", "convective"),
            ("estimators", "huber"),
            ("readers", "json-columns"),
            ("exports", "octave"),
        )
    ]


def test_a_broken_package_is_named_in_one_line_and_leaves_the_rest_working(site, tmp_path):
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "__init__.py").write_text("THING = 3\n", encoding="utf-8")
    (tmp_path / "broken" / "raising.py").write_text("raise RuntimeError('two\\nlines')\n", encoding="utf-8")
    described(tmp_path, "broken", "0.1", BROKEN)
    code = """
from vibrident.app.doctor import REGISTRIES
from vibrident.export.registry import EXPORTS
from vibrident.fit.registry import ESTIMATORS
from vibrident.physics.models import ADD_ONS, CORES, parse
from vibrident.base.errors import ModelError
assert parse("accelerometer+delay").name == "accelerometer+delay"
assert {"csv", "octave"} <= set(EXPORTS) and EXPORTS["csv"].title.startswith("tables")
assert "nowhere" not in EXPORTS and "convective" in CORES and "misnamed" not in ADD_ONS
assert "raising" not in set(ESTIMATORS)
try:
    parse("number")
except ModelError as error:
    assert "broken 0.1" in str(error), error
print(*sorted(p.line for r in REGISTRIES for p in r.plug_ins() if p.problem), sep="\\n")
"""
    done = run(code, site, tmp_path)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    for name, reason in {
        "csv": "taken",
        "nowhere": "No module named",
        "number": "found one of int",
        "misnamed": "the object 'delay'",
        "raising": "RuntimeError: two lines",
    }.items():
        (line,) = (line for line in lines if line.startswith(f"The plug-in {name} "))
        assert "of broken 0.1" in line
        assert reason in line
    assert len(lines) == 5
    assert sorted(done.stderr.splitlines()) == [line for line in lines if "taken" not in line]  # each once


#: A package whose model and estimator cannot be loaded, and whose departure can.
UNNAMED = """\
[vibrident.models]
unasked-model = unasked.broken:THING

[vibrident.estimators]
unasked-estimator = unasked.broken:THING

[vibrident.departures]
unasked-departure = unasked.departure:THING
"""
DEPARTURE = """
from vibrident.fit.departures.departure import Departure
class Nothing(Departure):
    name, code, pooled = "unasked-departure", "drift", False
    def columns(self, group, scale):
        return iter(())
    def sentence(self, candidate, score):
        return ""
THING = Nothing()
"""
COMPARED = """
import json, sys
from pathlib import Path
from typer.testing import CliRunner
from vibrident.app.cli import app
from vibrident.fit.registry import ESTIMATORS
from vibrident.physics.simulation import simulate
from vibrident.data.io.writer import write_calibration
sines = {"frequencies_hz": (100.0, 300.0, 800.0), "samples": 2000}
write_calibration(".", simulate("paper", response_noise=0.01, seed=1, **sines))
words = ["compare", "calibration.toml", "--models", "accelerometer,accelerometer+delay"]
done = CliRunner().invoke(app, words, catch_exceptions=False)
assert done.exit_code == 0, done.output
compared = json.loads(Path("vibrident-comparison/comparison.json").read_text())
assert "unasked" not in str(compared), compared
assert "unasked.broken" not in sys.modules
done = CliRunner().invoke(app, [*words, "--discretisations", "euler,zoh"], catch_exceptions=False)
assert done.exit_code == 0 and "unasked.broken" not in sys.modules, done.output
import vibrident
one = vibrident.Result.load("vibrident-comparison/ml-accelerometer.json")
assert one.provenance["plug_ins"] == {"unasked-departure": "unasked 2.0"}, one.provenance
assert "unasked-estimator" in ESTIMATORS.names()
print("compared")
"""


def test_compare_asks_no_plug_in_that_was_not_named(tmp_path):
    """Departures are tested in every fit, and are named in its provenance."""
    package = tmp_path / "site" / "unasked"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("", encoding="utf-8")
    (package / "broken.py").write_text("raise RuntimeError('asked')\n", encoding="utf-8")
    (package / "departure.py").write_text(DEPARTURE, encoding="utf-8")
    described(package.parent, "unasked", "2.0", UNNAMED)
    (tmp_path / "run").mkdir()
    done = run(COMPARED, package.parent, cwd=tmp_path / "run")
    assert done.returncode == 0, done.stderr + done.stdout
    assert done.stdout.endswith("compared\n")
    assert "asked" not in done.stderr


def test_nothing_is_loaded_before_it_is_asked_for(site):
    code = """
import sys
import vibrident
from vibrident.export.registry import EXPORTS
from vibrident.fit.registry import ESTIMATORS
assert "octave" in EXPORTS.names() and "huber" in ESTIMATORS
from vibrident.physics.models import parse
parse("accelerometer+delay")
assert not [name for name in sys.modules if name.startswith("vibrident_example")]
assert "numpy" in sys.modules
"""
    assert run(code, site).returncode == 0
    light = "import sys; from vibrident.physics.registry import MODELS; MODELS.names(); print('numpy' in sys.modules)"
    assert run(light, site).stdout == "False\n"
