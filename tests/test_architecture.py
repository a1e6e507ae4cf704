"""The order of the modules, the doors to heavy libraries, and the size of the pieces, read from the sources."""

from __future__ import annotations

import ast
import graphlib
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest
from tests.support.exported import paper

import vibrident

ROOT = Path(__file__).resolve().parents[1]
SOURCES = ROOT / "src"

#: From the ground up; a module imports from layers above it in this list or from its own folder, and nothing else.
LAYERS = (
    "errors",
    "brief",
    "extras",
    "registry",
    "warning_kinds",
    "memory",
    "parcel",
    "process",
    "sandbox",
    "effects",
    "interferometer",
    "records",
    "information",
    "tails",
    "result",
    "nominal",
    "escaping",
    "naming",
    "io",
    "measure",
    "backend",
    "models",
    "sensor",
    "decay",
    "discretize",
    "lines",
    "network",
    "simulation",
    "problem",
    "estimators",
    "uncertainty",
    "judge",
    "identification",
    "batched",
    "many",
    "joint",
    "validation",
    "prediction",
    "correction",
    "planning",
    "comparison",
    "doctor",
    "present",
    "plots",
    "report",
    "export",
    "terminal",
    "history",
    "fleet",
    "paper",
    "workflow",
    "cli",
    "web",
    "__main__",
)
#: Methods for Python's users that show what later layers make of an object, imported when one is called: no part of the
#: package calls them.
CONVENIENCES = {
    "vibrident.result.result": ("sensor", "terminal", "plots"),
    "vibrident.sensor": ("export",),
}
#: Users of the rest side by side: neither imports from the other.
SIBLINGS = (("cli", "web"), ("paper", "workflow"), ("paper", "web"))
#: What only a command that asks for it imports.
BESIDE = {"paper": ("cli",)}

#: Layers whose modules load no JAX.
NO_JAX = (
    "errors",
    "brief",
    "extras",
    "registry",
    "memory",
    "parcel",
    "process",
    "sandbox",
    "effects",
    "interferometer",
    "records",
    "information",
    "tails",
    "result",
    "nominal",
    "escaping",
    "naming",
    "io",
    "measure",
    "models",
    "sensor",
    "lines",
    "decay",
    "comparison",
    "present",
    "plots",
    "report",
    "export",
    "terminal",
    "history",
    "fleet",
)
DOOR_TO_JAX = "vibrident.backend"
#: For arrays that are JAX's already: it may import JAX inside a function.
LAZY_JAX = "vibrident.models.base"
BUILT_ON_JAX = {"equinox", "optax", "optimistix", "lineax"}
MAY_BUILD_ON_JAX = ("network", "problem", "estimators", "uncertainty", "paper")

MOST_LINES_A_MODULE = 400


def test_no_function_of_the_package_has_the_name_of_a_module():
    """Importing ``vibrident.identify`` as a module would replace the function ``vibrident.identify``."""
    modules = {path.stem for path in (SOURCES / "vibrident").iterdir()}
    assert not modules & set(vibrident.__all__)


MOST_LINES_A_FUNCTION = 80


@dataclass(frozen=True)
class Import:
    """One import statement's target, as a full dotted name, and where it stands; lazy: in a function, or for types."""

    target: str
    line: int
    lazy: bool


@cache
def modules() -> dict[str, Path]:
    """Dotted name to file of every module; a package goes by its own name."""
    found = {}
    for path in sorted((SOURCES / "vibrident").rglob("*.py")):
        parts = path.relative_to(SOURCES).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@cache
def tree(module: str) -> ast.Module:
    return ast.parse(modules()[module].read_text(encoding="utf-8"))


def layer(module: str) -> str:
    """First name below the package; empty for the package itself."""
    return module.split(".")[1] if "." in module else ""


@cache
def imports(module: str) -> tuple[Import, ...]:
    """Every import of a module, those inside functions and for type checking among them."""
    return tuple(_imports(module))


def _imports(module: str) -> Iterator[Import]:
    package = module if modules()[module].name == "__init__.py" else module.rpartition(".")[0]
    left: list[tuple[ast.AST, bool]] = [(tree(module), False)]
    while left:
        node, lazy = left.pop()
        lazy = lazy or _runs_later(node)
        left.extend((child, lazy) for child in ast.iter_child_nodes(node))
        if isinstance(node, ast.Import):
            yield from (Import(alias.name, node.lineno, lazy) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*above, base] if base else above)
            for alias in node.names:
                whole = f"{base}.{alias.name}"
                # ``from package import name`` means the submodule where there is one, else the package.
                yield Import(whole if whole in modules() or base == "vibrident" else base, node.lineno, lazy)


def _runs_later(node: ast.AST) -> bool:
    if isinstance(node, ast.If):
        return isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
    return isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)


def own_imports(module: str) -> Iterator[Import]:
    return (found for found in imports(module) if found.target.split(".")[0] == "vibrident")


def convenience(module: str, found: Import) -> bool:
    return found.lazy and layer(found.target) in CONVENIENCES.get(module, ())


def names(*layers: str) -> list[str]:
    return [module for module in modules() if layer(module) in layers]


def fail_if_any(complaints: list[str]) -> None:
    if complaints:
        pytest.fail("\n".join(complaints), pytrace=False)


def run_python(code: str, *arguments: str) -> str:
    """Run code in a fresh interpreter; return what it prints."""
    command = [sys.executable, "-c", code, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_every_module_has_a_layer():
    fail_if_any(
        [
            f"{module} has no place in the order of the modules: add {layer(module)!r} to LAYERS where it belongs."
            for module in modules()
            if layer(module) and layer(module) not in LAYERS
        ]
    )


def test_modules_import_from_the_layers_above_them_only():
    complaints = []
    for module in modules():
        own = layer(module)
        if own not in LAYERS:
            continue
        for found in own_imports(module):
            other = layer(found.target)
            if found.target in ("vibrident", "vibrident.__version__") or other == own or convenience(module, found):
                continue
            if other not in LAYERS:
                complaints.append(
                    f"{module}, line {found.line}, imports {found.target}: the package's front door is for users; "
                    "import from the module where the name is defined."
                )
            elif LAYERS.index(other) > LAYERS.index(own):
                complaints.append(
                    f"{module}, line {found.line}, imports {found.target}, but {other!r} comes after {own!r} in the "
                    "order of the modules."
                )
    fail_if_any(complaints)


def test_siblings_do_not_know_each_other():
    complaints = []
    for module in modules():
        for found in own_imports(module):
            own, other = layer(module), layer(found.target)
            if (own, other) in SIBLINGS or (other, own) in SIBLINGS:
                complaints.append(
                    f"{module}, line {found.line}, imports {found.target}: {own} and {other} are siblings."
                )
            if other in BESIDE and own not in (other, *BESIDE[other]):
                complaints.append(f"{module}, line {found.line}, imports {found.target}, which nothing but it needs.")
    fail_if_any(complaints)


def test_nothing_of_the_package_imports_benchmarks_or_tests():
    fail_if_any(
        [
            f"{module}, line {found.line}, imports {found.target}."
            for module in modules()
            for found in imports(module)
            if found.target.split(".")[0] in ("bench", "tests", "docsite", "examples")
        ]
    )


def test_the_package_loads_its_modules_lazily():
    fail_if_any(
        [
            f"vibrident/__init__.py, line {found.line}, imports {found.target} at once: name it in __getattr__."
            for found in own_imports("vibrident")
            if not found.lazy and layer(found.target) not in ("errors", "effects", "records", "result")
        ]
    )


def test_no_import_goes_in_a_circle():
    graph = {
        module: {found.target for found in own_imports(module) if not convenience(module, found)} - {module}
        for module in modules()
    }
    del graph["vibrident"]
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        pytest.fail("These modules import each other: " + " ← ".join(error.args[1]), pytrace=False)


def test_jax_is_imported_through_one_door():
    complaints = []
    for module in modules():
        if module == DOOR_TO_JAX:
            continue
        for found in imports(module):
            library = found.target.split(".")[0]
            if library in {"jax", "jaxlib"} and not (module == LAZY_JAX and found.lazy):
                complaints.append(
                    f"{module}, line {found.line}, imports {found.target}: "
                    f"take jax, jnp and lax from {DOOR_TO_JAX}, which sets float64 and checks the arithmetic."
                )
            if library in BUILT_ON_JAX and layer(module) not in MAY_BUILD_ON_JAX:
                complaints.append(
                    f"{module}, line {found.line}, imports {found.target}, which belongs in "
                    f"{', '.join(MAY_BUILD_ON_JAX)} only."
                )
    fail_if_any(complaints)


#: In a process: what of these is loaded by now.
CHECK = """
import contextlib, importlib, io, sys
def check(what, names):
    found = [name for name in names.split() if name in sys.modules]
    print(what, "loads", *found) if found else None
"""
HELP = """
from vibrident.cli import main
for arguments, heavy in ([], "jax matplotlib sqlalchemy numpy"), (["identify"], "jax matplotlib pandas scipy"):
    sys.argv, said = ["vibrident", *arguments, "--help"], io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        main()
    assert "identify" in said.getvalue()
    check(" ".join(sys.argv), heavy)
"""
USE = """
import vibrident.io, vibrident.plots, vibrident.report, vibrident.terminal
check("importing", "jax matplotlib scipy pandas h5py soundfile rich")
from vibrident.export import export
result, folder = vibrident.Result.load(sys.argv[1]), sys.argv[2]
export(result, "csv", folder)
check("exporting tables", "jax matplotlib obspy control lxml pythonfmu")
vibrident.report.write(result, "pdf", folder + "/certificate.pdf")
check("a certificate", "jax scipy pandas plotly h5py")
import matplotlib
before = dict(matplotlib.rcParams.copy())
vibrident.plots.draw("sensitivity", result).canvas.draw()
assert dict(matplotlib.rcParams.copy()) == before
check("a picture", "jax matplotlib.pyplot")
export(result, "c", folder, rate_hz=51200.0)
check("exporting C", "jax obspy control lxml pythonfmu")
from vibrident.simulation import simulate
simulate(samples=100)
for name in ("vibrident.simulation", *sys.argv[3:]):
    importlib.import_module(name)
    check(name, "jax")
"""


def test_help_loads_no_heavy_library():
    assert run_python(CHECK + HELP) == ""


def test_what_needs_no_heavy_library_loads_none(tmp_path):
    result = paper().save(tmp_path / "result.json")
    assert run_python(CHECK + USE, str(result), str(tmp_path), *names(*NO_JAX)) == ""


def test_modules_and_functions_stay_readable():
    complaints = []
    for module, path in modules().items():
        lines = len(path.read_text(encoding="utf-8").splitlines())
        if lines > MOST_LINES_A_MODULE:
            complaints.append(f"{module} has {lines} lines, more than {MOST_LINES_A_MODULE}: split it.")
        for node in ast.walk(tree(module)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                length = (node.end_lineno or node.lineno) - node.lineno + 1
                if length > MOST_LINES_A_FUNCTION:
                    complaints.append(
                        f"{module}.{node.name} has {length} lines, more than {MOST_LINES_A_FUNCTION}: split it."
                    )
    fail_if_any(complaints)


def test_every_public_module_says_what_it_is():
    fail_if_any(
        [
            f"{module} has no docstring."
            for module in modules()
            if not module.rpartition(".")[2].startswith("_") and not ast.get_docstring(tree(module))
        ]
    )


def test_tests_share_by_the_support_folder_only():
    tests = [path for path in (ROOT / "tests").rglob("*.py") if "support" not in path.relative_to(ROOT).parts]
    names = {path.stem for path in tests}
    for path in tests:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            named = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            named += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for name in named:
                ours = name.split(".")[0] in names or name.startswith("tests.")
                assert not ours or name.startswith("tests.support"), f"{path}: import of {name}"
