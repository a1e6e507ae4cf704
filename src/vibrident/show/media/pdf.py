"""Set documents as PDF by typst, from our template or from a laboratory's own."""

from __future__ import annotations

import base64
import datetime
import json
from collections.abc import Callable, Iterable
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from vibrident.base.errors import InputError
from vibrident.base.escaping import typst_data
from vibrident.base.extras import library
from vibrident.base.version import __version__
from vibrident.show.formulas import Mixed, Words, formulas
from vibrident.show.media import drawing
from vibrident.show.views import (
    Block,
    Document,
    Facts,
    Figure,
    Folded,
    Gallery,
    Sentence,
    Signatures,
    Table,
)

_TEMPLATE = Path(__file__).parent / "templates" / "document.typ"
#: Fonts with Chinese letters, by what systems call them: the first that is there is used.
_CHINESE = (
    *(
        "Noto Serif CJK SC",
        "Noto Serif SC",
        "Source Han Serif SC",
        "Songti SC",
        "SimSun",
        "Noto Sans CJK SC",
    ),
    *(
        "Noto Sans SC",
        "Source Han Sans SC",
        "PingFang SC",
        "Microsoft YaHei",
        "SimHei",
        "WenQuanYi Zen Hei",
    ),
)


def render(document: Document, template: Path | None = None, fonts: Iterable[Path] = ()) -> bytes:
    """Return a document as PDF; the same document gives the same file.

    ``template``: a typst file in place of ours, which finds the same data in
    ``sys.inputs.document``; ``fonts``: folders with further fonts.

    Raises:
        InputError: typst is not installed, no font has the document's letters, or the template
            fails.
    """
    typst = library(
        "typst", "report", "PDF needs typst, which is not installed.", "⟦report.form = 'pdf'⟧"
    )
    issued = document.letterhead
    day = None if issued is None else issued.date
    logo = b"" if issued is None else base64.b64decode(issued.logo)
    fields = {
        "title": document.title,
        "draft": document.draft,
        "language": document.language,
        "head": [_block(block) for block in document.head],
        "sections": [
            {"title": section.title, "blocks": [_block(b) for b in section.blocks]}
            for section in document.sections
        ],
        "letterhead": None if issued is None else {**asdict(issued), "logo": bool(logo)},
        "day": None if day is None else (day.year, day.month, day.day),
        "author": "vibrident" if issued is None or not issued.lines else issued.lines[0],
        "foot": f"Made with vibrident {__version__}." if issued is None else issued.foot,
    }
    keys = ("text", "base", "small", "kind")
    written = [dict(zip(keys, (text, *pieces), strict=True)) for text, pieces in formulas().items()]
    data = {**typst_data(_marked(fields)), "formulas": written}
    foreign = not _european(json.dumps(data, ensure_ascii=False, default=str))
    folder_names = [str(folder) for folder in fonts]
    families = (
        typst.Fonts(include_system_fonts=foreign, font_paths=folder_names).families()
        if foreign or folder_names
        else []
    )
    data["fonts"] = [name for name in _CHINESE if name in families][:1] if foreign else []
    if "zh" in (document.language, document.second_language) and not data["fonts"]:
        raise InputError(
            "No font with Chinese letters was found.",
            expected="one of " + ", ".join(_CHINESE),
            found="none of them on this machine",
            where="[certificate] language, second_language",
            remedy="install one, such as Noto Serif CJK, or name the folder that holds it: "
            "[certificate] fonts",
        )
    # No clock, and no fonts of this machine where typst's own has all the letters.
    noon = datetime.datetime.combine(
        day or datetime.date(2000, 1, 1), datetime.time(12), datetime.UTC
    )
    compiled = partial(
        typst.compile,
        {"main": (template or _TEMPLATE).read_bytes(), "logo": logo},
        root=str(_TEMPLATE.parent),  # typst reads nothing outside it
        format="pdf",
        font_paths=folder_names,
        sys_inputs={"document": json.dumps(data, ensure_ascii=False, default=str)},
        ignore_system_fonts=not foreign,
        timestamp=int(noon.timestamp()),
    )
    try:
        return _archivable(compiled) if day is not None else compiled()
    except RuntimeError as error:
        if template is None and not logo:
            raise
        raise InputError(
            "The certificate cannot be set with the laboratory's own template or logo.",
            expected="a typst file that makes a document, and a logo as SVG, PNG or JPEG",
            found=" ".join(str(getattr(error, "diagnostic", error)).split())[:300],
            where="[certificate] template, logo" if template is None else str(template),
            remedy="correct it, or leave it out",
        ) from error


def _archivable(compiled: Callable[..., bytes]) -> bytes:
    """Return a PDF/A-2b; a plain PDF where a letter has no font, which that standard forbids."""
    try:
        return compiled(pdf_standards=["a-2b"])
    except RuntimeError as error:
        if "PDF/A" not in str(error):
            raise
        return compiled()


def _block(block: Block) -> dict[str, Any]:
    kind = type(block).__name__
    if isinstance(block, Table):
        content = {
            name: getattr(block, name)
            for name in ("header", "rows", "right", "lead", "notes", "title")
        }
        return {"kind": kind, **content}
    if isinstance(block, Figure):
        return {"kind": kind, "svg": drawing.svg(block), "caption": block.caption}
    if isinstance(block, Sentence):
        return {
            "kind": kind,
            "lead": block.lead,
            "text": block.text,
            "doubt": block.kind == "doubt",
        }
    if isinstance(block, Facts | Signatures):
        rows = [{"label": label, "text": text} for label, text in block.rows]
        return {"kind": kind, "rows": rows, "title": getattr(block, "title", "")}
    if isinstance(block, Folded | Gallery):
        return {"kind": kind, "blocks": [_block(inner) for inner in block.blocks]}
    raise TypeError(f"A PDF has no {kind} yet.")


def _marked(value: Any) -> Any:
    """Return the text with our words apart from all others: formulas are set in them alone."""
    if isinstance(value, Words | Mixed):
        return {"words": str(value), "mixed": isinstance(value, Mixed)}
    if isinstance(value, dict):
        return {key: _marked(item) for key, item in value.items()}
    return [_marked(item) for item in value] if isinstance(value, (list, tuple)) else value


def _european(text: str) -> bool:
    """Return whether the font of typst has every letter: Latin, Greek, Cyrillic and signs."""
    return all(ord(letter) < 0x530 or 0x1E00 <= ord(letter) < 0x2C00 for letter in text)
