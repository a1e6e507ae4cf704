"""The page: Markdown, and HTML that needs no other file; and tables put between the marks of a document."""

from __future__ import annotations

import base64
import html
import json
import re
from collections.abc import Sequence
from pathlib import Path

from vibrident.errors import InputError
from vibrident.paper.figures import Picture, draw_all
from vibrident.paper.reproduction import Reproduction
from vibrident.paper.tables import Table, all_tables

TITLE = "An IPNN-Based Parameter Identification Method for a Vibration Sensor Sensitivity Model, reproduced"
_SOURCE = (
    "Li, Liu, Cai, Yao, Pan, Yang. Mathematics 2025, 13(22), 3609. Every table and figure of the paper from this "
    "package, the paper's numbers in italics beside ours; docs/paper.md explains them. The paper's data are private: "
    "section 5 is rerun on a simulated interferometer, and on measured records of another sensor where they are at "
    "hand; each table says which."
)
_STYLE = (
    "body{font:15px/1.5 system-ui,sans-serif;max-width:1060px;margin:2em auto;padding:0 1em;color:#1b1b1b}"
    "h1{font-size:1.5em}h2{font-size:1.15em;margin-top:2em}table{border-collapse:collapse;font-size:.82em;"
    "font-variant-numeric:tabular-nums;display:block;overflow-x:auto}td,th{border-bottom:1px solid #ddd;"
    "padding:.3em .6em;text-align:left;vertical-align:top}th{border-bottom:2px solid #888}"
    "img{max-width:100%;height:auto}.note,figcaption{font-size:.85em;color:#444}figure{margin:2em 0}"
)


def write(run: Reproduction, folder: Path) -> list[Table]:
    """Write ``paper.md``, ``paper.html``, ``paper.json`` and the pictures; return the tables."""
    tables, pictures = all_tables(run), draw_all(run, folder)
    (folder / "paper.md").write_text(markdown(tables, pictures), encoding="utf-8")
    (folder / "paper.html").write_text(html_page(tables, pictures, folder), encoding="utf-8")
    document = json.dumps(run.document(), indent=1, ensure_ascii=False)
    (folder / "paper.json").write_text(document + "\n", encoding="utf-8")
    return tables


def markdown(tables: Sequence[Table], pictures: Sequence[Picture]) -> str:
    """The page as Markdown; pictures are files beside it."""
    parts = [f"# {TITLE}", _SOURCE]
    parts += [f"## {table.title}\n\n{markdown_table(table)}" for table in tables]
    parts.append("## Figures")
    parts += [f"![{picture.name}]({picture.name}.png)\n\n{picture.caption}" for picture in pictures]
    return "\n\n".join(parts) + "\n"


def markdown_table(table: Table) -> str:
    """A table with the note below it."""
    lines = ["| " + " | ".join(table.head) + " |", "|" + "---|" * len(table.head)]
    lines += ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in table.rows]
    return "\n".join(lines) + (f"\n\n{table.note}" if table.note else "")


def html_page(tables: Sequence[Table], pictures: Sequence[Picture], folder: Path) -> str:
    """The page as one HTML file, pictures inside."""
    body = [f"<h1>{_marked(TITLE)}</h1><p>{_marked(_SOURCE)}</p>"]
    for table in tables:
        head = "".join(f"<th>{_marked(cell)}</th>" for cell in table.head)
        rows = "".join("<tr>" + "".join(f"<td>{_marked(c)}</td>" for c in row) + "</tr>" for row in table.rows)
        note = f'<p class="note">{_marked(table.note)}</p>' if table.note else ""
        body.append(f"<h2>{_marked(table.title)}</h2><table><tr>{head}</tr>{rows}</table>{note}")
    for picture in pictures:
        data = base64.b64encode((folder / f"{picture.name}.png").read_bytes()).decode()
        image = f'<img alt="{html.escape(picture.name)}" src="data:image/png;base64,{data}">'
        body.append(f"<figure>{image}<figcaption>{_marked(picture.caption)}</figcaption></figure>")
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{_marked(TITLE)}</title>'
        f'<meta name="viewport" content="width=device-width"><style>{_STYLE}</style></head><body>'
        + "\n".join(body)
        + "</body></html>\n"
    )


def _marked(text: str) -> str:
    """Escaped text with Markdown's bold and italics."""
    text = re.sub(r"\*\*(.+?)\*\*", r"<b>\1</b>", html.escape(text))
    return re.sub(r"\*(.+?)\*", r"<i>\1</i>", text)


def filled(text: str, tables: Sequence[Table], where: str) -> str:
    """A document with this run's tables between its marks ``<!-- reproduce:begin NAME -->`` and ``end``.

    Marks of tables that this run has not made stay unchanged.

    Raises:
        InputError: the document has no marks.
    """
    count = 0
    for table in tables:
        begin, end = f"<!-- reproduce:begin {table.name} -->", f"<!-- reproduce:end {table.name} -->"
        pattern = re.compile(re.escape(begin) + ".*?" + re.escape(end), re.DOTALL)
        block = f"{begin}\n{markdown_table(table)}\n{end}"
        text, found = pattern.subn(lambda _, block=block: block, text)
        count += found
    if not count:
        raise InputError(
            "The document has no place for the tables.",
            expected="marks such as <!-- reproduce:begin table4 --> … <!-- reproduce:end table4 -->",
            found="none of them",
            where=where,
            remedy="give a document with marks, docs/paper.md say",
        )
    return text
