"""The name of a model, estimator, reader or export stands in its own file, and nowhere else in the sources."""

from __future__ import annotations

import ast
from pathlib import Path

import vibrident
from vibrident.app.doctor import REGISTRIES
from vibrident.data.registry import READERS
from vibrident.physics.naming import parameter_names

SOURCES = Path(vibrident.__file__).parent
#: Users of the rest, which simulate and reproduce what they name; the truth behind a simulated spring is its own.
USERS = ("paper", "simulation")
#: Words that mean something else where they stand.
OTHERS = {
    "app/cli/commands/track.py": {"follow", "stdin"},  # options of these names
    "app/workflow/tracking.py": {"calibration-records"},  # the source where none is given
    "app/cli/commands/demo.py": {"ipnn"},  # shows the paper's network
    "app/cli/commands/simulate.py": {"delay"},  # of the optical channel
    "app/cli/options.py": {"cubic"},  # a simulated sensor
    "data/effects.py": {"clocks"},  # a kind of effect
    "data/known/mounting.py": {"damping_ratio"},  # of a coupling
    "fit/estimators/residual_network.py": {"ipnn"},  # the same estimator with a network beside it
    "fit/decay/estimate.py": {"ml"},  # maximum likelihood of free decays, which have no other estimator
    "data/records/basis.py": {"accelerometer"},  # the model of a file that names none
    "fit/identification.py": {"scipy"},  # the library, in the provenance
    "result/result.py": {"natural_frequency", "damping_ratio"},  # what free decays alone tell
}
#: Names so short or so common that they are words of programs; readers' names are for messages only.
COMMON = {
    "c",
    "change",
    "csv",
    "control",
    "delay",
    "dcc",
    "drift",
    "fmu",
    "gain",
    "mounting",
    "scipy",
    "sensitivity",
} | set(READERS.names())


def literals(file: Path) -> set[str]:
    """Strings of a module that are no docstrings and no part of annotations."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    passed = {id(n) for node in ast.walk(tree) if isinstance(node, ast.Expr) for n in ast.walk(node.value)}
    found = (n for n in ast.walk(tree) if isinstance(n, ast.Constant) and id(n) not in passed)
    return {n.value for n in found if isinstance(n.value, str)}


def own(name: str) -> str:
    return name.replace("-", "_") + ".py"


def test_names_stand_where_they_belong():
    added = {name for kind in REGISTRIES for name in kind.names()}
    parameters = set(parameter_names())
    complaints = []
    for file in SOURCES.rglob("*.py"):
        place = file.relative_to(SOURCES)
        if set(place.parts[:2]) & set(USERS):
            continue
        said = literals(file) - COMMON - OTHERS.get(place.as_posix(), set())
        complaints += [f"{place} names {name!r}: ask the object." for name in said & added if place.name != own(name)]
        if place.parts[:2] != ("physics", "models"):
            complaints += [f"{place} names the parameter {name!r}: ask the model." for name in said & parameters]
    assert not complaints, "\n".join(complaints)
