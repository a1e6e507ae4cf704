"""Find the fonts to draw with, and the characters that they have."""

from __future__ import annotations

from typing import TYPE_CHECKING

from vibrident.show.formulas import in_a_line

if TYPE_CHECKING:
    pass


def printable(text: str) -> str:
    """Return one line in which each character that the fonts lack is a □."""
    glyphs = drawing_fonts()[1]
    return "".join(c if ord(c) in glyphs else "□" for c in " ".join(in_a_line(text).split()))


_FONTS: list[tuple[list[str], set[int]]] = []


def drawing_fonts() -> tuple[list[str], set[int]]:
    """Return families to draw with, DejaVu Sans first, and the characters that they have."""
    if not _FONTS:
        from matplotlib.font_manager import fontManager
        from matplotlib.ft2font import FT2Font

        preferred = (
            "DejaVu Sans",
            "Noto Sans CJK SC",
            "Noto Sans CJK JP",
            "Microsoft YaHei",
            "PingFang SC",
            "SimHei",
        )
        files = {
            font.name: font.fname
            for font in reversed(fontManager.ttflist)
            if font.name in preferred
        }
        families = [name for name in preferred if name in files]
        _FONTS.append(
            (families, {code for name in families for code in FT2Font(files[name]).get_charmap()})
        )
    return _FONTS[0]


def split_lines(text: str) -> list[str]:
    """Split a text into printable lines."""
    return [printable(line) for line in text.split("\n", 2)] if text else []
