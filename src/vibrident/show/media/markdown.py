"""Documents as Markdown with GitHub's tables."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

from vibrident.base.escaping import markdown, markdown_paragraph
from vibrident.show.formulas import marked, typeset
from vibrident.show.views import (
    Block,
    Cards,
    Document,
    Doubt,
    Facts,
    Figure,
    Folded,
    Gallery,
    Sentence,
    Signatures,
    Table,
)

_BAR = re.compile(r"(?<!\\)\|")


def render(document: Document, pictures: Mapping[str, str] | None = None) -> str:
    """Return the text, ending in a line end.

    ``pictures``: name of a figure to its link; figures without one are left out.
    """
    linked = pictures or {}
    blocks = [f"# {cell(document.title)}", *_blocks(document.head, linked)]
    for section in document.sections:
        if body := _blocks(section.blocks, linked):
            blocks += [f"## {cell(section.title)}", *body]
    return "\n\n".join(blocks) + "\n"


def links(names: Iterable[str], folder: str | os.PathLike[str]) -> dict[str, str]:
    """Return figure name → link to its file in the report's folder; SVG before PNG."""
    files = [Path(folder) / f"{name}.{suffix}" for suffix in ("png", "svg") for name in names]
    return {file.stem: quote(file.name) for file in files if file.is_file()}


def table(header: Sequence[str], rows: Iterable[Sequence[str]], right: Iterable[int] = ()) -> str:
    """Return a table of Markdown cells; a bar within a cell stays one."""
    numbers = set(right)
    rule = ["---:" if i in numbers else "---" for i in range(len(header))]
    lines = ([_BAR.sub(r"\\|", text) for text in row] for row in (header, rule, *rows))
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def cell(text: str) -> str:
    """Return the text of a table's cell."""
    return typeset(text, markdown, marked)


def _paragraph(text: str) -> str:
    return typeset(text, markdown_paragraph, marked)


def _blocks(blocks: Iterable[Block], pictures: Mapping[str, str]) -> list[str]:
    return [text for block in blocks if (text := _block(block, pictures))]


def _block(block: Block, pictures: Mapping[str, str]) -> str:
    if isinstance(block, Sentence):
        lead = f"**{cell(block.lead)}** " if block.lead else ""
        return lead + (cell(block.text) if lead else _paragraph(block.text))
    if isinstance(block, Facts | Signatures):
        return table(
            ("", ""),
            [(cell(name), "" if text is None else cell(text)) for name, text in block.rows],
        )
    if isinstance(block, Cards):
        return "\n".join(
            f"- {cell(card.label)}: **{cell(card.value)}**, {cell(card.below)}"
            for card in block.cards
        )
    if isinstance(block, Doubt):
        return _doubt(block)
    if isinstance(block, Folded | Gallery):
        return "\n\n".join(_blocks(block.blocks, pictures))
    if isinstance(block, Figure):
        link = pictures.get(block.name)
        return f"![{cell(block.title)}](<{link}>)\n\n*{cell(block.caption)}*" if link else ""
    return markdown_table(block)


def markdown_table(block: Table) -> str:
    """Return a table with its title and paragraphs."""
    rows = []
    for i, row in enumerate(block.rows):
        if i in block.groups:
            rows.append((cell(block.groups[i]), *("" for _ in row[1:])))
        rows.append(
            tuple(f"*{cell(text)}*" if text and i in block.quoted else cell(text) for text in row)
        )
    body = table([cell(text) for text in block.header], rows, block.right)
    title = f"### {cell(block.title)}" if block.title else ""
    blocks = (title, *map(_paragraph, block.lead), body, *map(_paragraph, block.notes))
    return "\n\n".join(filter(None, blocks))


def _doubt(doubt: Doubt) -> str:
    title = f"### {cell(doubt.title[:1].upper() + doubt.title[1:])} (`{doubt.code}`)"
    messages = "\n>\n".join(f"> {_paragraph(message)}" for message in doubt.messages)
    return "\n\n".join((title, messages, doubt.meaning, f"**What to do:** {doubt.action}"))
