"""Escape text from files (names, units, remarks) for each medium; one function per medium.

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

MARK = "\N{REPLACEMENT CHARACTER}"  # in place of invisible characters
# invisible, but part of words in some scripts
_JOINERS = "\N{ZERO WIDTH NON-JOINER}\N{ZERO WIDTH JOINER}"
#: A spreadsheet takes a cell that begins with one of these for a formula.
_FORMULA = tuple("=+-@\uff1d\uff0b\uff0d\uff20")  # and their full-width forms
_MARKDOWN = re.compile(r"([\\`*_\[\]<>~$|])|(&)(?=[#\w])|(:)(?=//)|(?<=www)(\.)", re.IGNORECASE)
_MARKDOWN_START = re.compile(r"^(\s*)(?:([#+=-])|(\d+)([.)]))")
_MARKDOWN_NAMED = {"<": "&lt;", ">": "&gt;", "&": "&amp;"}


def one_line(text: object) -> str:
    """Return the text as one line of visible characters."""
    return _visible(" ".join(str(text).split()))


def lines(text: object) -> str:
    """Return the text as lines of visible characters."""
    return "\n".join(one_line(line) for line in str(text).splitlines())


def _visible(text: str) -> str:
    if text.isprintable():
        return text
    return "".join(
        c if c.isprintable() or c in _JOINERS or unicodedata.category(c) == "Zs" else MARK
        for c in text
    )


def c_comment(text: object) -> str:
    """Escape text for a comment in C: no end of it, no nested comment, trigraph or spliced line.

    The backslash goes first: its replacement may end a comment together with its neighbours.
    """
    line = _visible(" ".join(str(text).splitlines())).replace("\\", "/")
    line = re.sub(r"\*(?=/)", "* ", line)
    line = re.sub(r"/(?=\*)", "/ ", line)
    return re.sub(r"\?(?=\?)", "? ", line)


def python_docstring(text: object) -> str:
    """Escape text for a docstring or a comment in Python: no end of it, no escape."""
    return one_line(text).replace("\\", "/").replace('"', "'")


def sac_comment(text: object) -> str:
    """Escape text for a comment line of a SAC file: one line."""
    return one_line(text)


def xml_text(text: object) -> str:
    """Escape text for a library that writes XML and escapes markup: characters of XML 1.0 only."""
    return one_line(text)


def html(text: object) -> str:
    """Escape text for an element or an attribute of HTML."""
    return escape(one_line(text))


def plotly(text: object) -> str:
    """Escape text for names and labels of plotly, which interprets HTML and its own templates."""
    return escape(one_line(text), quote=False).replace("%{", "%&#123;")


def markdown(text: object) -> str:
    """Escape text for a cell, a heading or a part of a line of GitHub's Markdown."""
    return _MARKDOWN.sub(
        lambda match: _MARKDOWN_NAMED.get(match[0], f"\\{match[0]}"), one_line(text)
    )


def markdown_paragraph(text: object) -> str:
    """Escape text for a paragraph of Markdown: it begins no heading, list or rule either."""
    return _MARKDOWN_START.sub(lambda m: f"{m[1]}{m[3] or ''}\\{m[2] or m[4]}", markdown(text))


def typst_data(value: Any) -> Any:
    """Escape every text in nested mappings and lists, line by line, for the data of a document.

    Typst interprets no markup in data.
    """
    if isinstance(value, str):
        return lines(value)
    if isinstance(value, dict):
        return {key: typst_data(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [typst_data(item) for item in value]
    return value


def csv_cell(text: object) -> str:
    """Escape text for a cell that no spreadsheet takes for a formula."""
    line = one_line(text)
    return f"'{line}" if line.startswith(_FORMULA) else line


def terminal(text: object) -> str:
    """Escape text for a terminal: line ends and tabs, and no other control character."""
    return "\n".join(
        "\t".join(_visible(cell) for cell in line.split("\t")) for line in str(text).split("\n")
    )
