"""The package's own sources: modules, and what they import."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SOURCES = ROOT / "src"


@dataclass(frozen=True)
class Import:
    """One import statement's target, as a full dotted name, and where it stands; lazy: in a function, or for types."""

    target: str
    line: int
    lazy: bool


@cache
def modules() -> dict[str, Path]:
    """Dotted name to file of every module; a package goes by its own name."""
    paths = {}
    for path in sorted((SOURCES / "vibrident").rglob("*.py")):
        parts = path.relative_to(SOURCES).with_suffix("").parts
        paths[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return paths


@cache
def source(module: str) -> str:
    """Return the text of a module."""
    return modules()[module].read_text(encoding="utf-8")


@cache
def tree(module: str) -> ast.Module:
    """Return the parsed source of a module."""
    return ast.parse(source(module))


@cache
def imports(module: str) -> tuple[Import, ...]:
    """Every import of a module, those inside functions and for type checking among them."""
    return tuple(_imports(module))


def _imports(module: str) -> Iterator[Import]:
    package = module if modules()[module].name == "__init__.py" else module.rpartition(".")[0]
    pending: list[tuple[ast.AST, bool]] = [(tree(module), False)]
    while pending:
        node, lazy = pending.pop()
        lazy = lazy or _runs_later(node)
        pending.extend((child, lazy) for child in ast.iter_child_nodes(node))
        if isinstance(node, ast.Import):
            yield from (Import(alias.name, node.lineno, lazy) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = package.split(".")[: len(package.split(".")) - node.level + 1]
                base = ".".join([*above, base] if base else above)
            for alias in node.names:
                target = f"{base}.{alias.name}"
                # ``from package import name`` means the submodule where there is one, else the package.
                yield Import(target if target in modules() else base, node.lineno, lazy)


def _runs_later(node: ast.AST) -> bool:
    if isinstance(node, ast.If):
        return isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
    return isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
