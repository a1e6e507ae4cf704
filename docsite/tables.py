"""Markdown tables, and templates with one place for a table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from vibrident.show.media import markdown

_PAGES = Path(__file__).parent / "pages"
_PLACE = "<!-- table -->"


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table; a bar within a cell stays one."""
    return markdown.table(heads, rows)


def page(name: str, content: str) -> str:
    """Return the template of this name with the content in its place."""
    template = (_PAGES / name).read_text(encoding="utf-8")
    if template.count(_PLACE) != 1:
        raise ValueError(f"{name} needs {_PLACE} once")
    return template.replace(_PLACE, content)
