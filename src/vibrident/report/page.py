"""Pieces of an HTML page, and the page: one file that needs nothing from outside, and may not ask for it."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from vibrident import __version__
from vibrident.errors import InputError
from vibrident.escaping import html
from vibrident.report import tables
from vibrident.report.tables import Table

_TEMPLATES = Path(__file__).parent / "templates"
#: The browser itself refuses whatever is not in the file.
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; connect-src 'none'"
)
#: The few formulas among the words.
_FORMULAS = {
    "e^{jωt}": "e<sup>jωt</sup>",
    "ν_eff": "ν<sub>eff</sub>",
    "E_n": "E<sub>n</sub>",
    "U_first": "U<sub>first</sub>",
}


@dataclass
class Page:
    """A page in the making: sections in order, and the figures that they show."""

    title: str
    sections: list[tuple[str, str, str]] = field(default_factory=list)
    figures: dict[str, Any] = field(default_factory=dict)
    head: str = ""

    def add(self, name: str, title: str, *parts: str | None) -> None:
        """Add a section; none where all its parts are empty."""
        body = "\n".join(part for part in parts if part)
        if body:
            self.sections.append((name, title, body))

    def figure(self, name: str, content: Any, caption: str, choices: Sequence[str] = ()) -> str:
        """A chart with its caption, or a choice of charts; nothing where there is no content."""
        if not content:
            return ""
        self.figures[name] = content[0] if isinstance(content, list) and len(content) == 1 else content
        options = "".join(f"<option>{text(choice)}</option>" for choice in choices)
        chosen = f'<select aria-label="record">{options}</select>' if len(choices) > 1 else ""
        label = html(caption)
        plot = f'<div class="plot" data-figure="{name}" role="img" aria-label="{label}"></div>'
        return f"<figure>{chosen}{plot}<figcaption>{formulas(text(caption))}</figcaption></figure>"

    def html(self) -> str:
        """The whole file.

        Raises:
            InputError: plotly, whose script the page embeds, is not installed.
        """
        links = "".join(f'<a href="#{name}">{text(title)}</a>' for name, title, _ in self.sections)
        body = "\n".join(
            f'<section id="{name}"><h2>{formulas(text(title))}</h2>\n{part}</section>'
            for name, title, part in self.sections
        )
        data = json.dumps(self.figures, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
        script = _plotly() if self.figures else ""
        own = (_TEMPLATES / "page.js").read_text(encoding="utf-8") if self.figures else ""
        return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{_POLICY}">
<meta name="generator" content="vibrident {__version__}">
<title>{text(self.title)}</title>
<link rel="icon" href="data:,">
<style>
{(_TEMPLATES / "page.css").read_text(encoding="utf-8")}</style>
</head>
<body>
<header><h1>{text(self.title)}</h1>
{self.head}</header>
<nav aria-label="sections"><div>{links}</div></nav>
<main>
{body}
</main>
<footer>Made by vibrident {__version__}. This file holds all that it shows and loads nothing.</footer>
<script type="application/json" id="figures">{data.replace("<", chr(92) + "u003c")}</script>
<script>{script}</script>
<script>
{own}</script>
</body>
</html>
"""


@cache
def _plotly() -> str:
    spec = importlib.util.find_spec("plotly")
    if spec is None or not spec.submodule_search_locations:
        raise InputError(
            "The HTML report needs plotly, which is not installed.",
            expected="the package plotly",
            found="none",
            where="--format html",
            remedy="pip install 'vibrident[report]'",
        )
    # What plotly.offline.get_plotlyjs() reads, without loading plotly for it.
    folder = Path(next(iter(spec.submodule_search_locations)))
    return (folder / "package_data" / "plotly.min.js").read_text(encoding="utf-8").replace("</script", "<\\/script")


def text(words: object) -> str:
    """Text of others as text, on one line."""
    return html(words)


def formulas(escaped: str) -> str:
    """Set the few formulas of our own words."""
    for plain, set_in_type in _FORMULAS.items():
        escaped = escaped.replace(plain, set_in_type)
    return escaped


def paragraphs(words: Iterable[str], kind: str = "") -> str:
    """Each text a paragraph."""
    mark = f' class="{kind}"' if kind else ""
    return "\n".join(f"<p{mark}>{formulas(text(part))}</p>" for part in words)


def table(content: Table | None) -> str:
    """A table with its paragraphs; nothing for none."""
    if content is None:
        return ""
    head = "".join(_cell("th", cell, j in content.right) for j, cell in enumerate(content.header))
    rows = []
    for i, row in enumerate(content.rows):
        cells = "".join(_cell("td", cell, j in content.right) for j, cell in enumerate(row))
        following = content.rows[i + 1] if i + 1 < len(content.rows) else row
        belongs = bool(row) and following is not row and following[0] == ""  # a line of the same entry follows
        rows.append(f"<tr{' class=more' if belongs else ''}>{cells}</tr>")
    body = f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{"".join(rows)}</tbody></table></div>'
    return "\n".join((paragraphs(content.lead), body, paragraphs(content.notes, "note")))


def _cell(kind: str, content: str, number: bool) -> str:
    word = " " not in content and len(content) <= 24  # a date, say, which browsers break at its hyphens
    mark = " class=n" if number else " class=w" if word else ""
    return f"<{kind}{mark}>{formulas(text(content))}</{kind}>"


def pairs(rows: Iterable[tuple[str, str | None]]) -> str:
    """Names and texts; None is a blank to fill."""
    lines = (
        f'<tr><th scope="row">{text(name)}</th><td>{BLANK if content is None else formulas(text(content))}</td></tr>'
        for name, content in rows
    )
    return f'<div class="scroll"><table>{"".join(lines)}</table></div>'


BLANK = '<span class="blank" title="not stated">&nbsp;</span>'


def folded(summary: str, content: str) -> str:
    """Content behind a line to open it; nothing for nothing."""
    return f"<details><summary>{text(summary)}</summary>\n{content}</details>" if content else ""


def tree(values: Any) -> str:
    """Nested settings: a list of alike mappings as a table, everything else as a list."""
    if isinstance(values, (list, tuple)) and _alike(values):
        header = tuple(dict.fromkeys(str(key) for row in values for key in row))
        rows = tuple(tuple(tables.leaf(row.get(key, "")) for key in header) for row in values)
        return table(Table(tuple(name.replace("_", " ") for name in header), rows))
    if isinstance(values, Mapping) and len(values) > 1 and _alike(list(values.values())):
        return tree([{"": str(key).replace("_", " "), **row} for key, row in values.items()])
    lines = []
    for key, value in values.items() if isinstance(values, Mapping) else enumerate(values, 1):
        name = text(str(key).replace("_", " "))
        if isinstance(value, (Mapping, list, tuple)) and value:
            plain = isinstance(value, (list, tuple)) and not any(isinstance(v, (Mapping, list, tuple)) for v in value)
            content = text(", ".join(tables.leaf(v) for v in value)) if plain else tree(value)
        else:
            content = text(tables.leaf(value))
        lines.append(f"<li>{name}: {content}</li>")
    return f'<ul class="tree">{"".join(lines)}</ul>'


def _alike(values: Sequence[Any]) -> bool:
    """Whether these are mappings of plain values that share most of their keys."""
    if not values or not all(isinstance(value, Mapping) and value for value in values):
        return False
    if any(isinstance(item, (Mapping, list, tuple)) and item for value in values for item in value.values()):
        return False
    keys = [set(value) for value in values]
    return len(set.intersection(*keys)) * 2 >= len(set.union(*keys))
