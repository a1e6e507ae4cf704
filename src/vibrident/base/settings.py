"""Name settings in messages by markers, which each surface prints in its own words.

A text holds ``⟦export.rate_hz⟧``, or ``⟦export.rate_hz = HZ⟧`` with a value as Python writes it (a
placeholder in capitals). The first part is the command, the last the keyword of its function. Four
names are no settings: ``⟦command = identify⟧`` is a command, ``⟦install = vibrident[dcc]⟧`` a
package to install (or several, by blanks), ``⟦here⟧`` the place where settings are given, and
``⟦environment.NAME⟧`` a variable. ``⟦--rate⟧``, an option, occurs in messages of the command line
alone.

Texts are rendered last: between processes they travel with their markers.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable
from contextlib import suppress

#: Name and value → the word of a surface; None leaves the marker as it is.
Word = Callable[[str, str], str | None]

MARKER = re.compile(r"⟦(--[a-z][a-z-]*|[a-z]+(?:\.\w+)*)(?: = ([^⟧]*))?⟧")

#: Settings that a function of their own takes in Python.
_FUNCTIONS = {"export.certificate": "vibrident.show.issue.issued"}


def rendered(text: str, word: Word) -> str:
    """Return a text with the words of a surface in place of its markers."""

    def replacement(marker: re.Match[str]) -> str:
        rendered_word = word(marker[1], marker[2] or "")
        return marker[0] if rendered_word is None else rendered_word

    return MARKER.sub(replacement, text) if "⟦" in text else text


def python_word(name: str, value: str) -> str | None:
    """Return Python's word for a setting: the keyword, as ``rate_hz`` or ``rate_hz=HZ``."""
    special = {
        "here": "arguments",
        "command": f"`vibrident {value}`",
        "install": " ".join(("pip install", *(f"'{package}'" for package in value.split()))),
    }
    if name.startswith("--"):
        return f"{name} {value}".rstrip()
    if "." not in name:
        return special.get(name)
    if name in _FUNCTIONS:
        return _FUNCTIONS[name]
    keyword = name.rpartition(".")[2]
    return f"{keyword}={value}" if value else keyword


def plain(value: str) -> str:
    """Return a value as a form or a shell takes it: no quotes, lists by commas, pairs by colons."""
    with suppress(ValueError, SyntaxError):
        literal = ast.literal_eval(value)
        if isinstance(literal, str):
            return literal
    joint = ":" if value.startswith("(") else ","
    items = value.strip("()[]").replace("'", "").replace('"', "").split(",")
    return joint.join(item.strip() for item in items)
