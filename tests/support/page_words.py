"""The words of the page: what its sources give to ``translate``, what they say past it, what they say of others."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

from tests.support.sources import modules, tree

TRANSLATING = ("translate", "translate_count", "phrase", "speak", "count", "known")
#: Calls whose texts are no words of the page: errors, notes for the server, names, styles, scripts.
SILENT = (
    *(
        "InputError",
        "StoppedError",
        "WorkerError",
        "VibridentError",
        "_form_error",
        "_unguarded_error",
        "_require",
        "_stopped_error",
    ),
    *("require", "note", "error", "props", "classes", "style", "run_javascript", "on", "getLogger"),
    *("mkdtemp", "compile", "open_columns", "position_of", "checked_laboratory", "certificate_section"),
    *("check_dates", "_refuse", "certificate_data", "require_finite", "add_body_html", "add_argument"),
)
_WORDS = re.compile(r"[A-Za-z]{2,} [A-Za-z]{2,}|^[A-Z][a-z]{2,}[.:]?$")
_SPOKEN = re.compile(r"aria-label=[\"']?[A-Za-z]|placeholder=[\"']?[A-Za-z]")


def _name(call: ast.Call) -> str:
    function = call.func
    return function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")


def _constants(node: ast.AST) -> Iterator[str]:
    """Yield the texts of an expression that can be what it is: of a choice, both."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    elif isinstance(node, ast.IfExp):
        yield from _constants(node.body)
        yield from _constants(node.orelse)


def _calls(*functions: str) -> Iterator[tuple[ast.Call, dict[str, set[str]]]]:
    """Yield each call of functions in a module of the page, with the texts of the module's names."""
    for module in _page():
        texts: dict[str, set[str]] = {}
        for node in ast.walk(tree(module)):
            for target, value in _assigned(node):
                texts.setdefault(target, set()).update(_constants(value))
        for node in ast.walk(tree(module)):
            if isinstance(node, ast.Call) and _name(node) in functions:
                yield node, texts


def shown_sentences() -> set[str]:
    """Return each sentence that a module of the page gives to ``translate``, directly or by a name."""
    sentences = set()
    for call, texts in _calls(*TRANSLATING):
        for argument in call.args:
            sentences |= set(_constants(argument))
            for part in ast.walk(argument):
                if isinstance(part, ast.Name):
                    sentences |= texts.get(part.id, set())
    return {text for text in sentences if re.search("[A-Za-z]{2}", text)}


def with_values() -> set[str]:
    """Return each sentence that a module gives to ``phrase`` with values, to be said when finished."""
    sentences = set()
    for call, texts in _calls("phrase"):
        if call.keywords:
            first = call.args[0]
            sentences |= texts.get(first.id, set()) if isinstance(first, ast.Name) else {*_constants(first)}
    return sentences


def _assigned(node: ast.AST) -> Iterator[tuple[str, ast.AST]]:
    if not isinstance(node, ast.Assign):
        return
    for target in node.targets:
        if isinstance(target, ast.Name):
            yield target.id, node.value
        elif isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
            for name, value in zip(target.elts, node.value.elts, strict=False):
                if isinstance(name, ast.Name):
                    yield name.id, value


def unsaid() -> list[str]:
    """Return each literal of a module of the page that reads like words and is not said."""
    sentences_shown, unlisted = shown_sentences(), []
    for module in _page():
        module_tree = tree(module)
        silent = {id(part) for call in ast.walk(module_tree) for part in _silent(call)}
        for node in ast.walk(module_tree):
            if not isinstance(node, ast.Constant) or not isinstance(node.value, str):
                continue
            text = re.sub(r"<[^>]*>?", "\n", node.value)
            aloud = _SPOKEN.search(node.value)
            if aloud or (id(node) not in silent and node.value not in sentences_shown and _reads(text)):
                unlisted.append(f"{module}, line {node.lineno}: {node.value[:60]!r}")
    return unlisted


def _reads(text: str) -> bool:
    return any(_WORDS.search(part.strip()) for part in text.split("\n"))


def _silent(node: ast.AST) -> Iterator[ast.AST]:
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        yield node.value  # a docstring
    if isinstance(node, ast.Call) and _name(node) in SILENT:
        yield from ast.walk(node)
    if isinstance(node, ast.Call) and _name(node) == "add_button":
        for style in node.args[2:]:  # after label and handler
            yield from ast.walk(style)


def _page() -> list[str]:
    return [module for module in modules() if module.startswith("vibrident.app.web")]
