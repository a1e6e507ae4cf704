"""What needs no compiler loads none: JAX and its companions, and SciPy's slow parts, stay unloaded."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest
from tests.support.extras import installed
from tests.support.shell import printed

RANDOM = ("--rate", "12800", "--samples", "2000", "--response-noise", "0.01", "--seed", "8")
#: Run in a process of its own: every command in turn; what one of them loads is named.
WATCH = """
import contextlib, io, json, sys
from vibrident.app.cli import app
HEAVY = ("jax", "equinox", "optimistix", "optax", "scipy.stats", "scipy.signal", "scipy.optimize")
HEAVY += tuple(sys.argv[1:])
for arguments in json.load(sys.stdin):
    said = io.StringIO()
    try:
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            app(arguments)
    except SystemExit as done:
        assert not done.code, (arguments, said.getvalue())
    loaded = [name for name in HEAVY if name in sys.modules]
    if loaded:
        print(" ".join(arguments[:1]), "loads", ", ".join(loaded))
        break
"""


def loaded(commands: list[list[str]], *more: str) -> str:
    """What the first command that loads any of it, or of ``more``, loads."""
    done = subprocess.run(
        [sys.executable, "-c", WATCH, *more],
        input=json.dumps(commands),
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_linear_sensor_is_identified_without_a_compiler(made, tmp_path):
    printed("simulate", "--out", tmp_path / "random", "--excitation", "random", *RANDOM)
    sines, motion = str(made / "calibration.toml"), str(tmp_path / "random" / "calibration.toml")
    out = ["--out", str(tmp_path / "out"), "--no-pictures"]
    commands = [
        *(["identify", sines, "--estimator", name, *out] for name in ("ml", "ipnn", "lsm")),
        ["identify", motion, "--model", "accelerometer+delay", *out],
    ]
    assert loaded(commands, "scipy", "pandas", "matplotlib") == ""
    commands = [
        ["identify", sines, motion, *out],
        ["compare", sines, "--out", str(tmp_path / "compared")],
    ]
    assert loaded(commands) == ""


@pytest.mark.needs("report")
def test_what_is_done_with_a_linear_sensors_result_loads_no_compiler(made, identified, tmp_path):
    result, calibration = str(identified), str(made / "calibration.toml")
    commands = [
        ["inspect", calibration],
        ["predict", result, calibration, "--out", str(tmp_path / "predicted")],
        ["correct", result, calibration, "--out", str(tmp_path / "corrected")],
        ["plan", "--from", result, "--best", "4", "--out", str(tmp_path / "plan")],
        ["compare", result, result, "--out", str(tmp_path / "compared")],
        *(["report", result, "--out", str(tmp_path / "report"), "--format", kind] for kind in ("html", "md")),
        ["export", result, "--out", str(tmp_path / "export"), "--format", "csv"],
    ]
    assert loaded(commands) == ""


@pytest.mark.skipif(installed("network"), reason="JAX is installed; `make test-plain` runs it")
@pytest.mark.parametrize(
    "more",
    [
        ("--model", "accelerometer+cubic"),
        ("--estimator", "ipnn", "--optimiser", "adam"),
        ("--estimator", "ipnn", "--residual"),
    ],
)
def test_without_jax_one_sentence_says_what_to_install(run, made, tmp_path, more):
    done = run("identify", made / "calibration.toml", "--out", tmp_path / "out", *more)
    assert (done.exit_code, done.stdout) == (2, "")
    assert "need JAX, which is not installed" in done.stderr
    assert "pip install 'vibrident[network]'" in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("stated", "expected"), [({}, "1"), ({"OPENBLAS_NUM_THREADS": "3"}, "3")])
def test_the_command_line_computes_in_one_thread_unless_told_otherwise(stated, expected):
    """Said before NumPy is loaded, which reads it: threads of small matrices wait for each other."""
    code = """
import os, sys
from vibrident.app import cli
cli.app = lambda **_: print(os.environ["OPENBLAS_NUM_THREADS"], "numpy" in sys.modules)
cli.main()
"""
    others = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env=others | stated, capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.split() == [expected, "False"]
