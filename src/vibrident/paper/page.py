"""The page in Markdown and in HTML that needs no other file; tables between a document's marks."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from vibrident.base.errors import InputError
from vibrident.paper.figures import draw_all
from vibrident.paper.reproduction import Reproduction
from vibrident.paper.tables import all_tables
from vibrident.show.media import html, markdown
from vibrident.show.views import Document, Figure, Sentence, Table, document, section

TITLE = (
    "An IPNN-Based Parameter Identification Method for a Vibration Sensor Sensitivity Model, "
    "reproduced"
)
_SOURCE = (
    "Li, Liu, Cai, Yao, Pan, Yang. Mathematics 2025, 13(22), 3609. Every table and figure of the "
    "paper from this package, the paper's numbers in italics beside ours; studies/paper.md "
    "explains them. The paper's data are private: section 5 is rerun on a simulated "
    "interferometer, and on measured records of another sensor where they are at hand; each table "
    "says which."
)


def write(run: Reproduction, folder: Path) -> list[Table]:
    """Write ``paper.md``, ``paper.html``, ``paper.json`` and the pictures; return the tables."""
    tables = all_tables(run)
    pictures = draw_all(run, folder)
    page = content(tables, pictures)
    links = {picture.name: f"{picture.name}.png" for picture in pictures}
    (folder / "paper.md").write_text(markdown.render(page, links), encoding="utf-8")
    (folder / "paper.html").write_text(html.render(page), encoding="utf-8")
    text = json.dumps(run.document(), indent=1, ensure_ascii=False)
    (folder / "paper.json").write_text(text + "\n", encoding="utf-8")
    return tables


def content(tables: Sequence[Table], pictures: Sequence[Figure]) -> Document:
    """Return the page: a section a table, and the figures."""
    sections = [section(table.name, table.title, replace(table, title="")) for table in tables]
    return document(
        TITLE, (Sentence(_SOURCE),), [*sections, section("figures", "Figures", *pictures)]
    )


def filled(text: str, tables: Sequence[Table], where: str) -> str:
    """Return a document with this run's tables between its marks.

    These are ``<!-- reproduce:begin NAME -->`` and ``<!-- reproduce:end NAME -->``. Marks of tables
    that this run has not made stay unchanged.

    Raises:
        InputError: the document has no marks.
    """
    count = 0
    for table in tables:
        begin = f"<!-- reproduce:begin {table.name} -->"
        end = f"<!-- reproduce:end {table.name} -->"
        pattern = re.compile(re.escape(begin) + ".*?" + re.escape(end), re.DOTALL)
        block = f"{begin}\n{markdown.markdown_table(replace(table, title=''))}\n{end}"
        text, replaced = pattern.subn(lambda _, block=block: block, text)
        count += replaced
    if not count:
        raise InputError(
            "The document has no place for the tables.",
            expected="marks such as "
            "<!-- reproduce:begin table4 --> … <!-- reproduce:end table4 -->",
            found="none of them",
            where=where,
            remedy="give a document with such marks, for example studies/paper.md",
        )
    return text
