"""Text of others (names, units, remarks) made harmless for each medium that it is written to: one function a medium.

Serial numbers, column names and customers' texts come from files that anybody may have written.
Whatever they hold, a program's code, a page's markup and a terminal's state must not depend on it.
Every character that cannot be seen (controls, escape sequences, marks that turn the direction of
writing) gets a visible mark in its place.
"""

from __future__ import annotations

import re
import unicodedata
from html import escape
from typing import Any

MARK = "\N{REPLACEMENT CHARACTER}"  # in place of what cannot be seen
_JOINERS = (
    "\N{ZERO WIDTH NON-JOINER}\N{ZERO WIDTH JOINER}"  # unseen, but part of words in some scripts
)
#: A spreadsheet takes a cell that begins so for a formula.
_FORMULA = tuple("=+-@\uff1d\uff0b\uff0d\uff20")  # and their full-width forms
_MARKDOWN = re.compile(r"([\\`*_\[\]<>~$|])|(&)(?=[#\w])|(:)(?=//)|(?<=www)(\.)", re.IGNORECASE)
_MARKDOWN_START = re.compile(r"^(\s*)(?:([#+=-])|(\d+)([.)]))")
_MARKDOWN_NAMED = {"<": "&lt;", ">": "&gt;", "&": "&amp;"}


def one_line(text: object) -> str:
    """Return one line of characters that can be seen."""
    return _seen(" ".join(str(text).split()))


def lines(text: object) -> str:
    """Return the same, line by line."""
    return "\n".join(one_line(line) for line in str(text).splitlines())


def _seen(text: str) -> str:
    if text.isprintable():
        return text
    return "".join(
        c if c.isprintable() or c in _JOINERS or unicodedata.category(c) == "Zs" else MARK
        for c in text
    )


def c_comment(text: object) -> str:
    """For a comment in C: no end of it, no beginning of another, no trigraph, no spliced line.

    The backslash goes first: what it becomes may end a comment together with its neighbours.
    """
    line = _seen(" ".join(str(text).splitlines())).replace("\\", "/")
    line = re.sub(r"\*(?=/)", "* ", line)
    line = re.sub(r"/(?=\*)", "/ ", line)
    return re.sub(r"\?(?=\?)", "? ", line)


def python_docstring(text: object) -> str:
    """For a docstring or a comment in Python: no end of it, no escape."""
    return one_line(text).replace("\\", "/").replace('"', "'")


def sac_comment(text: object) -> str:
    """For a comment line of a SAC file: one line."""
    return one_line(text)


def xml_text(text: object) -> str:
    """For a library that writes XML and escapes markup: characters that XML 1.0 allows."""
    return one_line(text)


def html(text: object) -> str:
    """For text or an attribute of HTML."""
    return escape(one_line(text))


def plotly(text: object) -> str:
    """For names and labels of plotly, which takes some HTML in them, links among it, and its own templates."""
    return escape(one_line(text), quote=False).replace("%{", "%&#123;")


def markdown(text: object) -> str:
    """For a table's cell, a heading or a part of a line of Markdown, with GitHub's extensions."""
    return _MARKDOWN.sub(
        lambda found: _MARKDOWN_NAMED.get(found[0], f"\\{found[0]}"), one_line(text)
    )


def markdown_paragraph(text: object) -> str:
    """For a paragraph of Markdown: it does not begin a heading, a list or a rule either."""
    return _MARKDOWN_START.sub(lambda m: f"{m[1]}{m[3] or ''}\\{m[2] or m[4]}", markdown(text))


def typst_data(value: Any) -> Any:
    """For a document's data: every text in nested mappings and lists, line by line; typst takes no markup from data."""
    if isinstance(value, str):
        return lines(value)
    if isinstance(value, dict):
        return {key: typst_data(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [typst_data(item) for item in value]
    return value


def csv_cell(text: object) -> str:
    """For a cell with text: a spreadsheet takes it for no formula."""
    line = one_line(text)
    return f"'{line}" if line.startswith(_FORMULA) else line


def terminal(text: object) -> str:
    """For a terminal: line ends and tabs, and no other control."""
    return "\n".join(
        "\t".join(_seen(part) for part in line.split("\t")) for line in str(text).split("\n")
    )
