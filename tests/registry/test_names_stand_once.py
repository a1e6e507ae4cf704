"""The name of a model, estimator, reader or export stands in its own file, and nowhere else in the sources."""

from __future__ import annotations

import ast
from pathlib import Path

from vibrident import registry
from vibrident.naming import parameter_names

SOURCES = Path(registry.__file__).parent
#: Users of the rest, which simulate and reproduce what they name; the truth behind a simulated spring is its own.
USERS = ("paper", "simulation")
#: Words that mean something else where they stand.
OTHERS = {
    "cli/commands/demo.py": {"ipnn"},  # shows the paper's network
    "cli/commands/simulate.py": {"delay"},  # of the optical channel
    "cli/options.py": {"cubic"},  # a simulated sensor
    "estimators/network_settings.py": {"ipnn"},  # where the same estimator is told of
    "estimators/residual_network.py": {"ipnn"},  # the same estimator with a network beside it
    "decay/document.py": {"ml"},  # maximum likelihood of free decays, which have no other estimator
    "records/basis.py": {"accelerometer"},  # the model of a file that names none
    "identification.py": {"scipy"},  # the library, in the provenance
    "result/result.py": {"natural_frequency", "damping_ratio"},  # what free decays alone tell
    "cli/commands/plan.py": {"natural_frequency", "damping_ratio", "sensitivity", "generator_constant"},  # options
}
#: Names so short or so common that they are words of programs; readers' names are for messages only.
COMMON = {"c", "csv", "control", "delay", "dcc", "fmu", "scipy", "sensitivity"} | set(registry.READERS.names())


def literals(file: Path) -> set[str]:
    """Strings of a module that are no docstrings and no part of annotations."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    passed = {id(n) for node in ast.walk(tree) if isinstance(node, ast.Expr) for n in ast.walk(node.value)}
    found = (n for n in ast.walk(tree) if isinstance(n, ast.Constant) and id(n) not in passed)
    return {n.value for n in found if isinstance(n.value, str)}


def own(name: str) -> str:
    return name.replace("-", "_") + ".py"


def test_names_stand_where_they_belong():
    added = {name for kind in registry.REGISTRIES for name in kind.names()}
    parameters = set(parameter_names())
    complaints = []
    for file in SOURCES.rglob("*.py"):
        place = file.relative_to(SOURCES)
        if place.parts[0] in USERS:
            continue
        said = literals(file) - COMMON - OTHERS.get(place.as_posix(), set())
        complaints += [f"{place} names {name!r}: ask the object." for name in said & added if place.name != own(name)]
        if place.parts[0] != "models":
            complaints += [f"{place} names the parameter {name!r}: ask the model." for name in said & parameters]
    assert not complaints, "\n".join(complaints)
