"""Eleven rooms, one direction: which module may import which, read from the sources, lazy imports too."""

from __future__ import annotations

import ast
import graphlib
from functools import cache

import pytest
from tests.support.sources import SOURCES, Import, imports, modules

import vibrident

#: From the ground up. A module imports from rooms above its own or from its own; where a room lists its folders and
#: files, these have an order as well, and those joined by | do not know each other.
ROOMS = {
    "base": "",
    "data": "registry effects known interferometer records resampling screening io sources",
    "physics": "registry naming models discretisation network simulation",
    "result": "document earlier parts sensor estimates result loading|known",
    "fit": "registry information likelihood optimise response bins group problem noise start descent estimators decay "
    "uncertainty departures judge identification joint",
    "use": "",
    "show": "",
    "export": "",
    "lab": "many fleet|history issue fleets|histories|signatures",
    "paper": "",
    "app": "requirements workflow|doctor cli|web",
}


@cache
def inner_imports() -> list[tuple[str, Import]]:
    """Return each module with each of its imports of the package; the two doors import from everywhere."""
    return [
        (module, each)
        for module in modules()
        if module not in ("vibrident", "vibrident.__main__")
        for each in imports(module)
        if each.target.split(".")[0] == "vibrident"
    ]


def place(module: str) -> tuple[int, int, str]:
    """Of a room, of what is in it (-1 where there is no order), and the name of that."""
    _, room, inner = (*module.split("."), "")[:3]
    order = [part.split("|") for part in ROOMS[room].split()]
    known = [at for at, names in enumerate(order) if inner in names]
    assert known or not order or not inner, f"{module} has no place: add {inner!r} to ROOMS[{room!r}]"
    return list(ROOMS).index(room), known[0] if known else -1, inner


def offends(module: str, target: str) -> bool:
    """Whether the target comes after the module, or stands beside it."""
    (room, at, inner), (other_room, other_at, other) = place(module), place(target)
    if room != other_room or min(at, other_at) < 0:
        return other_room > room
    return other_at > at or (other_at == at and other != inner)


def test_imports_go_one_way():
    wrong = [
        f"{module}, line {each.line}, imports {each.target}"
        for module, each in inner_imports()
        if each.target == "vibrident" or offends(module, each.target)
    ]
    if wrong:
        pytest.fail("Against the order of the rooms:\n" + "\n".join(wrong), pytrace=False)


def test_no_files_import_each_other_in_a_circle():
    graph: dict[str, set[str]] = {}
    for module, each in inner_imports():
        graph.setdefault(module, set()).update({each.target} - {module})
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        pytest.fail("These modules import each other: " + " ← ".join(error.args[1]), pytrace=False)


def test_there_are_eleven_rooms_and_two_doors():
    assert {module.split(".")[1] for module in modules() if "." in module} == {*ROOMS, "__main__"}


def test_editors_know_the_public_names():
    """The stub names each from where the package loads it; its functions and methods then complete with their types."""
    stub = ast.parse((SOURCES / "vibrident" / "__init__.pyi").read_text(encoding="utf-8"))
    named = {
        alias.asname: each.module for each in stub.body if isinstance(each, ast.ImportFrom) for alias in each.names
    }
    assert named == {**vibrident._WHERE, "__version__": "vibrident.base.version"}
