"""Heavy libraries stay behind their doors: what is loaded when, and that JAX has one way in."""

from __future__ import annotations

import subprocess
import sys

import pytest
from tests.support.exported import paper
from tests.support.extras import NEEDS, NEEDS_JAX, installed
from tests.support.sources import imports, modules

DOOR_TO_JAX = "vibrident.base.backend"
#: For arrays that are JAX's already: it may import JAX inside a function.
LAZY_JAX = "vibrident.physics.models.base"
BUILT_ON_JAX = {"equinox", "optax", "optimistix", "lineax"}


def run_python(code: str, *arguments: str) -> str:
    """Run code in a fresh interpreter; return what it prints."""
    command = [sys.executable, "-c", code, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_jax_is_imported_through_one_door():
    complaints = []
    for module in modules():
        for found in imports(module):
            library = found.target.split(".")[0]
            if library in {"jax", "jaxlib"} and module != DOOR_TO_JAX and not (module == LAZY_JAX and found.lazy):
                complaints.append(f"{module}, line {found.line}, imports {found.target}: take it from {DOOR_TO_JAX}")
            if library in BUILT_ON_JAX and not f"{module}.".startswith(NEEDS_JAX):
                complaints.append(f"{module}, line {found.line}, imports {found.target}, which is built on JAX")
    if complaints:
        pytest.fail("\n".join(complaints), pytrace=False)


#: In a process: what of these is loaded by now.
CHECK = """
import contextlib, importlib, io, sys
def check(what, names):
    found = [name for name in names.split() if name in sys.modules]
    print(what, "loads", *found) if found else None
"""
HELP = """
from vibrident.app.cli import main
for arguments, heavy in ([], "jax matplotlib sqlalchemy numpy"), (["identify"], "jax matplotlib pandas scipy"):
    sys.argv, said = ["vibrident", *arguments, "--help"], io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        main()
    assert "identify" in said.getvalue()
    check(" ".join(sys.argv), heavy)
"""
USE = """
import vibrident.data.io, vibrident.show.plots, vibrident.show.report, vibrident.show.terminal
check("importing", "jax matplotlib scipy pandas h5py soundfile rich")
from vibrident.export import export
result, folder = vibrident.Result.load(sys.argv[1]), sys.argv[2]
export(result, "csv", folder)
check("exporting tables", "jax matplotlib obspy control lxml pythonfmu")
vibrident.show.report.write(result, "pdf", folder + "/certificate.pdf")
check("a certificate", "jax scipy pandas plotly h5py")
import matplotlib
before = dict(matplotlib.rcParams.copy())
vibrident.show.plots.draw("sensitivity", result).canvas.draw()
assert dict(matplotlib.rcParams.copy()) == before
check("a picture", "jax matplotlib.pyplot")
export(result, "c", folder, rate_hz=51200.0)
check("exporting C", "jax obspy control lxml pythonfmu")
from vibrident.physics.simulation import simulate
simulate(samples=100)
for name in sys.argv[3:]:
    importlib.import_module(name)
    check(name, "jax")
"""


def test_the_package_loads_its_modules_lazily():
    light = ("vibrident.base.binding", "vibrident.base.version", "vibrident.export")
    assert {each.target for each in imports("vibrident") if each.target.startswith("vibrident")} <= set(light)


def test_help_loads_no_heavy_library():
    assert run_python(CHECK + HELP) == ""


@pytest.mark.needs("report")
@pytest.mark.needs("history")
def test_what_needs_no_heavy_library_loads_none(tmp_path):
    result = paper().save(tmp_path / "result.json")
    others = [module for module in modules() if not f"{module}.".startswith(NEEDS_JAX)]
    assert run_python(CHECK + USE, str(result), str(tmp_path), *others) == ""


@pytest.mark.skipif(installed("network"), reason="`make test-plain` runs it; here the test above loads them")
def test_every_module_loads_but_those_of_extras_that_are_missing():
    missing = tuple(prefix for extra, found in NEEDS.items() if not installed(extra) for prefix in found)
    others = [name for name in modules() if not f"{name}.".startswith(missing) and name != "vibrident.__main__"]
    assert run_python("import importlib, sys; [importlib.import_module(name) for name in sys.argv[1:]]", *others) == ""
