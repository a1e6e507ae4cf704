"""Documents as PDF, set by typst from the template beside this module."""

from __future__ import annotations

import datetime
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from vibrident.base.escaping import typst_data
from vibrident.base.extras import library
from vibrident.base.version import __version__
from vibrident.show.formulas import Words, formulas
from vibrident.show.media import drawing
from vibrident.show.views import Beside, Block, Document, Facts, Figure, Folded, Sentence, Signatures, Table

_TEMPLATES = Path(__file__).parent / "templates"


def render(document: Document) -> bytes:
    """A document as PDF; the same document gives the same file.

    Raises:
        InputError: typst is not installed.
    """
    typst = library("typst", "report", "PDF needs typst, which is not installed.", "--format pdf")
    issued = document.letterhead
    day = None if issued is None else issued.date
    fields = {
        "title": document.title,
        "head": [_block(block) for block in document.head],
        "sections": [{"title": part.title, "blocks": [_block(b) for b in part.blocks]} for part in document.sections],
        "letterhead": None if issued is None else asdict(issued),
        "day": None if day is None else (day.year, day.month, day.day),
        "foot": f"Made with vibrident {__version__}." if issued is None else issued.foot,
    }
    keys = ("text", "base", "small", "kind")
    written = [dict(zip(keys, (text, *parts), strict=True)) for text, parts in formulas().items()]
    content = json.dumps({**typst_data(_marked(fields)), "formulas": written}, ensure_ascii=False, default=str)
    # No clock, and no fonts of this machine where typst's own has all the letters.
    noon = datetime.datetime.combine(day or datetime.date(2000, 1, 1), datetime.time(12), datetime.UTC)
    return typst.compile(
        str(_TEMPLATES / "document.typ"),
        root=str(_TEMPLATES),
        format="pdf",
        sys_inputs={"document": content},
        ignore_system_fonts=_european(content),
        timestamp=int(noon.timestamp()),
    )


def _block(block: Block) -> dict[str, Any]:
    kind = type(block).__name__
    if isinstance(block, Table):
        parts = {name: getattr(block, name) for name in ("header", "rows", "right", "lead", "notes", "title")}
        return {"kind": kind, **parts}
    if isinstance(block, Figure):
        return {"kind": kind, "svg": drawing.svg(block), "caption": block.caption}
    if isinstance(block, Sentence):
        return {"kind": kind, "lead": block.lead, "text": block.text, "doubt": block.kind == "doubt"}
    if isinstance(block, Facts | Signatures):
        rows = [{"label": label, "text": text} for label, text in block.rows]
        return {"kind": kind, "rows": rows, "title": getattr(block, "title", "")}
    if isinstance(block, Folded | Beside):
        return {"kind": kind, "blocks": [_block(inner) for inner in block.blocks]}
    raise TypeError(f"A PDF has no {kind} yet.")


def _marked(value: Any) -> Any:
    """The same, with our words apart from all other text: formulas are set in them alone."""
    if isinstance(value, Words):
        return {"words": str(value)}
    if isinstance(value, dict):
        return {key: _marked(item) for key, item in value.items()}
    return [_marked(item) for item in value] if isinstance(value, (list, tuple)) else value


def _european(text: str) -> bool:
    """Whether the font that typst brings has every letter: Latin, Greek, Cyrillic, punctuation and signs."""
    return all(ord(letter) < 0x530 or 0x1E00 <= ord(letter) < 0x2C00 for letter in text)
