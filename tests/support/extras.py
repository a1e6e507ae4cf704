"""Tests on the plain install: which files are about what an extra brings, told by their own imports."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from tests.support.sources import ROOT

#: Extra → a library of it, by which it is seen to be installed.
LIBRARY = {
    "network": "jax",
    "fleet": "pyarrow",
    "history": "sqlalchemy",
    "report": "typst",
    "web": "nicegui",
    "parquet": "pyarrow",
}
LIBRARY |= {"excel": "openpyxl", "seismic": "obspy"}
#: The paper's modules that train networks, and those that use them.
PAPER_ON_JAX = (
    *("adam", "black_box", "claims", "figures", "free_weights", "methods", "page", "pinn", "reproduction", "sections"),
    *("settings", "studies", "tables", "training", "unrolled"),
)
#: All that is there for Adam, springs, learned residuals, sampling and the paper: what the names of modules begin with.
NEEDS_JAX = (
    "vibrident.base.backend.",
    "vibrident.physics.network.",
    "vibrident.physics.discretisation.forced.",
    "vibrident.physics.simulation.cubic.",
    "vibrident.fit.problem.cutting.",
    "vibrident.fit.problem.time_domain.",
    "vibrident.fit.start.harmonic_start.",
    "vibrident.fit.estimators.residual_candidate.",
    "vibrident.fit.estimators.residual_network.",
    *(f"vibrident.paper.{name}." for name in PAPER_ON_JAX),
)
NEEDS = {
    "network": NEEDS_JAX,
    "fleet": ("vibrident.lab.fleet.",),
    "history": ("vibrident.lab.history.", "vibrident.lab.issue."),
    "web": ("vibrident.app.web.",),
}


def installed(extra: str) -> bool:
    """Whether what an extra brings is there."""
    return find_spec(LIBRARY[extra]) is not None


@cache
def lacks(path: Path) -> bool:
    """Whether a file of tests imports what is not installed, by itself or through ``tests.support``."""
    return any(_absent(name) for name in _imported(path))


def _absent(name: str) -> bool:
    if name.startswith("tests.support."):
        return lacks(ROOT / Path(*name.split(".")[:3]).with_suffix(".py"))
    if name.startswith("vibrident."):
        return any(f"{name}.".startswith(prefixes) and not installed(extra) for extra, prefixes in NEEDS.items())
    return name.partition(".")[0] not in ("tests", "bench", "docsite") and find_spec(name.partition(".")[0]) is None


def _imported(path: Path) -> Iterator[str]:
    """Names that are imported when the file is loaded."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
