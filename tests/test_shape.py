"""The size of the pieces, and what each says of itself."""

from __future__ import annotations

import ast

import pytest
from tests.support.sources import ROOT, imports, modules, tree

#: Size is counted in nodes of the syntax tree: a dense file is not a small one.
MAX_NODES_A_MODULE = 4000
MAX_NODES_A_FUNCTION = 1000


def fail_if_any(complaints: list[str]) -> None:
    if complaints:
        pytest.fail("\n".join(complaints), pytrace=False)


def nodes_of(definition: ast.AST) -> int:
    """Return the count of nodes of a syntax tree, docstrings left out."""
    documented = ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
    count = 0
    for node in ast.walk(definition):
        count += 1
        if isinstance(node, documented) and ast.get_docstring(node) is not None:
            count -= 2
    return count


def test_modules_and_functions_stay_readable():
    complaints = []
    for module in modules():
        size = nodes_of(tree(module))
        if size > MAX_NODES_A_MODULE:
            complaints.append(f"{module} has {size} nodes, more than {MAX_NODES_A_MODULE}: split it.")
        for node in ast.walk(tree(module)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                size = nodes_of(node)
                if size > MAX_NODES_A_FUNCTION:
                    complaints.append(
                        f"{module}.{node.name} has {size} nodes, more than {MAX_NODES_A_FUNCTION}: split it."
                    )
    fail_if_any(complaints)


def test_every_module_says_what_it_is():
    fail_if_any([f"{module} has no docstring." for module in modules() if not ast.get_docstring(tree(module))])


def test_nothing_of_the_package_imports_benchmarks_or_tests():
    fail_if_any(
        [
            f"{module}, line {found.line}, imports {found.target}."
            for module in modules()
            for found in imports(module)
            if found.target.split(".")[0] in ("bench", "tests", "docsite", "examples")
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
