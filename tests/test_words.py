"""Words of the sources: names that say what they hold, docstrings that stand alone."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator

import pytest
from tests.support.sources import ROOT, modules, tree

#: Names that a reader must look up: a variable, argument or function says what it holds or does.
RIDDLES = frozenset(
    [
        *("asked", "beside", "comes", "each", "found", "given", "goes", "holds", "it", "kept", "left"),
        *("made", "one", "other", "others", "own", "rest", "said", "seen", "some", "stands"),
        *("taken", "them", "these", "thing", "things", "those", "told", "which", "whole"),
    ]
)
#: First words of docstrings that only make sense beside the name that they explain.
FRAGMENT_OPENINGS = frozenset(
    [
        *("As", "At", "By", "For", "From", "How", "In", "Of", "One", "That", "These", "Those"),
        *("To", "What", "When", "Where", "Whether", "Which", "Who", "With"),
    ]
)
#: Openings of constants' names that do not say which bound they are of which quantity.
VAGUE_BOUNDS = ("MOST_", "LEAST_")
MAX_LINE_LENGTH = 100
#: Riddles that users know: an input error says what was expected and what was found.
KNOWN_TO_USERS = {("vibrident.base.errors", "found")}

Definition = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


def names_of(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
        yield node.id
    elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Store):
        yield node.attr
    elif isinstance(node, ast.arg):
        yield node.arg
    elif isinstance(node, Definition):
        yield node.name


def complaints_about(module: str, node: ast.AST) -> Iterator[str]:
    for name in names_of(node):
        if name.strip("_").lower() in RIDDLES and (module, name) not in KNOWN_TO_USERS:
            yield f"{name} does not say what it holds"
        if name.lstrip("_").startswith(VAGUE_BOUNDS):
            yield f"{name}: MAX_ or MIN_, the quantity and its unit"
    if isinstance(node, Definition | ast.Module):
        opening = (ast.get_docstring(node) or "Return").split()[0].strip(",.:;")
        if opening in FRAGMENT_OPENINGS:
            yield f"a docstring that opens with {opening} does not stand alone"
    if isinstance(node, ast.Assign):
        pair = isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple)
        if pair:
            yield "two assignments in a line"


def test_no_name_and_no_docstring_is_a_riddle():
    complaints = []
    for module, path in modules().items():
        for node in ast.walk(tree(module)):
            line = getattr(node, "lineno", 1)
            complaints += [f"{path}:{line}: {text}" for text in complaints_about(module, node)]
        for number, text in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            if len(text) > MAX_LINE_LENGTH:
                complaints.append(f"{path}:{number}: {len(text)} characters")
    if complaints:
        pytest.fail("\n".join(complaints), pytrace=False)


def test_no_name_beside_the_sources_is_a_riddle():
    complaints = []
    for folder in ("bench", "docsite", "examples", "release", "tests/support"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            if "envs" in path.parts:  # of the packages that the benchmarks compare with
                continue
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                for name in names_of(node):
                    if name.strip("_").lower() in RIDDLES:
                        place = f"{path.relative_to(ROOT)}:{node.lineno}"
                        complaints.append(f"{place}: {name} does not say what it holds")
    assert complaints == [], "\n".join(complaints)


def test_a_class_name_stands_for_one_class():
    classes = defaultdict(list)
    for module in modules():
        for node in ast.walk(tree(module)):
            if isinstance(node, ast.ClassDef):
                classes[node.name].append(f"{module}:{node.lineno}")
    assert {name: lines for name, lines in classes.items() if len(lines) > 1} == {}
