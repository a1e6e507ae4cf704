"""Certificate and documents as PDF, set by typst from the templates beside this module."""

from __future__ import annotations

import datetime
import importlib.util
import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from vibrident import __version__
from vibrident.errors import InputError
from vibrident.escaping import typst_data
from vibrident.present import certificate as content
from vibrident.present import drawing, figures
from vibrident.present.formulas import formulas
from vibrident.present.history import date_of
from vibrident.present.views import Block, Document, Facts, Figure, Folded, Gallery, Sentence, Table
from vibrident.result import Result

_TEMPLATES = Path(__file__).parent / "templates"
#: Data files listed in a certificate; the result lists them all.
MOST_FILES = 30


def certificate(result: Result) -> bytes:
    """A calibration certificate as PDF, from the result alone.

    Raises:
        InputError: typst is not installed.
    """
    _require_typst()
    made = content.certificate(result)
    fields = {**asdict(made), **{name: _table(getattr(made, name)) for name in ("instruments", "parameters", "files")}}
    fields["sensitivity"] = None if made.sensitivity is None else _table(made.sensitivity)
    files = fields["files"]
    if len(files["rows"]) > MOST_FILES:
        files["notes"] = [f"and {len(files['rows']) - MOST_FILES} more, listed in result.json"]
        files["rows"] = files["rows"][:MOST_FILES]
    day = date_of(result)
    curve = figures.sensitivity(result) if len(result.response.frequency_hz) > 1 else None
    more = {
        "adequate": result.fit.adequate,
        "curve": None if curve is None else drawing.svg(curve),
        "day": None if day is None else (day.year, day.month, day.day),
    }
    return _set("certificate.typ", {**fields, **more}, day)


def render(document: Document) -> bytes:
    """A document as PDF.

    Raises:
        InputError: typst is not installed.
    """
    _require_typst()
    blocks = [_block(block) for block in document.head]
    sections = [{"title": part.title, "blocks": [_block(b) for b in part.blocks]} for part in document.sections]
    made_by = f"vibrident {__version__}"
    return _set(
        "document.typ", {"title": document.title, "head": blocks, "sections": sections, "made_by": made_by}, None
    )


def _block(block: Block) -> dict[str, Any]:
    if isinstance(block, Table):
        return {"kind": "table", **_table(block)}
    if isinstance(block, Figure):
        return {"kind": "figure", "svg": drawing.svg(block), "caption": block.caption}
    if isinstance(block, Sentence):
        return {"kind": "sentence", "lead": block.lead, "text": block.text}
    if isinstance(block, Facts):
        return {"kind": "facts", "rows": [{"label": label, "text": text} for label, text in block.rows]}
    if isinstance(block, Folded | Gallery):
        inner = block.blocks if isinstance(block, Folded) else block.figures
        return {"kind": "blocks", "blocks": [_block(one) for one in inner]}
    raise TypeError(f"A PDF has no {type(block).__name__} yet.")


def _table(table: Table) -> dict[str, Any]:
    parts = {name: list(getattr(table, name)) for name in ("header", "rows", "right", "lead", "notes")}
    return {**parts, "title": table.title}


def _require_typst() -> None:
    if importlib.util.find_spec("typst") is None:
        raise InputError(
            "PDF needs typst, which is not installed.",
            expected="the package typst",
            found="none",
            where="--format pdf",
            remedy="pip install 'vibrident[report]'",
        )


def _set(template: str, fields: Mapping[str, Any], day: datetime.date | None) -> bytes:
    import typst

    keys = ("text", "base", "small", "kind")
    written = [dict(zip(keys, (text, *parts), strict=True)) for text, parts in formulas().items()]
    document = json.dumps({**typst_data(dict(fields)), "formulas": written}, ensure_ascii=False)
    # The same result gives the same file: no clock, and no fonts of this machine where ours have all the letters.
    noon = datetime.datetime.combine(day or datetime.date(2000, 1, 1), datetime.time(12), datetime.UTC)
    return typst.compile(
        str(_TEMPLATES / template),
        root=str(_TEMPLATES),
        format="pdf",
        sys_inputs={"document": document},
        ignore_system_fonts=_european(document),
        timestamp=int(noon.timestamp()),
    )


def _european(text: str) -> bool:
    """Whether the font that typst brings has every letter: Latin, Greek, Cyrillic, punctuation and signs."""
    return all(ord(letter) < 0x530 or 0x1E00 <= ord(letter) < 0x2C00 for letter in text)
