"""The source of a model made in Python, so that a result says what its formula was."""

from __future__ import annotations

import ast
import hashlib
import inspect
import json
import linecache
import numbers
import textwrap
from typing import Any

from vibrident.physics.models.base import ParameterSpec
from vibrident.physics.models.model import Model


def source_of(model: Model) -> dict[str, Any]:
    """Return name, formula, the constants in it and parameters of a model, and their SHA-256.

    The formula is empty where Python does not keep the source, as at its own prompt.
    """
    description = {
        "name": model.name,
        "formula": _formula(model.response),
        "constants": _constants(model.response),
        "parameters": {spec.name: _describe(spec) for spec in model.parameters},
    }
    text = json.dumps(description, sort_keys=True)
    return {**description, "sha256": hashlib.sha256(text.encode()).hexdigest()}


def _describe(spec: ParameterSpec) -> str:
    """Return what was stated of a parameter: ``H, start 0.001, from 1e-06 to 1``."""
    words = [spec.unit]
    if spec.start is not None:
        words.append(f"start {spec.start:g}")
    if spec.bounds is not None:
        words.append(f"from {spec.bounds[0]:g} to {spec.bounds[1]:g}")
    return ", ".join(words)


def _formula(response: Any) -> str:
    """Return the text of a function: of a lambda, nothing of what is around it."""
    code = getattr(response, "__code__", None)
    try:
        lines = linecache.getlines(code.co_filename) if code else []
        text = "".join(lines)
        nodes = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Lambda)]
    except SyntaxError:
        nodes = []
        text = ""
    positions = (
        []
        if code is None
        else [
            position for position in code.co_positions() if position[0] and position[2] is not None
        ]
    )
    for node in nodes:
        if code is not None and code.co_name == "<lambda>" and _ends_at(node.body, positions):
            return textwrap.dedent(ast.get_source_segment(text, node) or "")
    try:
        return textwrap.dedent(inspect.getsource(response)).strip()
    except (OSError, TypeError):
        return ""


def _ends_at(body: ast.expr, positions: list[Any]) -> bool:
    """Return whether an expression has the place of the instruction that reaches furthest."""
    ends = {
        (line, column, end_line, end_column) for line, end_line, column, end_column in positions
    }
    return (body.lineno, body.col_offset, body.end_lineno, body.end_col_offset) in ends


def _constants(response: Any) -> dict[str, float]:
    """Return the numbers of the surroundings that a function uses, by name."""
    try:
        around = inspect.getclosurevars(response)
    except (TypeError, ValueError):
        return {}
    names = {**around.globals, **around.nonlocals}
    return {
        name: float(value)
        for name, value in sorted(names.items())
        if isinstance(value, numbers.Real) and not isinstance(value, bool)
    }
