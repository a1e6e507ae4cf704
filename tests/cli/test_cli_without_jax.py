"""What needs no compiler loads none: JAX and its companions, and SciPy's slow parts, stay unloaded."""

from __future__ import annotations

import json
import subprocess
import sys

#: Run in a process of its own: every command in turn; what one of them loads is named.
WATCH = """
import contextlib, io, json, sys
from vibrident.cli import app
HEAVY = ("jax", "equinox", "optimistix", "optax", "numpyro", "scipy.stats", "scipy.signal", "scipy.optimize")
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


def test_what_is_done_with_a_linear_sensors_result_loads_no_compiler(made, identified, tmp_path):
    result, calibration = str(identified), str(made / "calibration.toml")
    commands = [
        ["inspect", calibration],
        ["predict", result, calibration, "--out", str(tmp_path / "predicted")],
        ["correct", result, calibration, "--out", str(tmp_path / "corrected")],
        ["plan", "--from", result, "--best", "4", "--out", str(tmp_path / "plan")],
        ["compare", result, result, "--out", str(tmp_path / "compared")],
        *(["report", result, "--out", str(tmp_path / "report"), "--format", kind] for kind in ("html", "md")),
        *(
            ["export", result, "--out", str(tmp_path / "export"), "--format", kind]
            for kind in ("csv", "scipy", "sacpz")
        ),
    ]
    done = subprocess.run(
        [sys.executable, "-c", WATCH],
        input=json.dumps(commands),
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""
