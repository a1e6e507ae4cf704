"""The bytes of a text file as its parsers take them: no UTF-16, no Ctrl-Z, plain spellings of numbers.

An ordinary file is read from the disk as it is. Only one in UTF-16, with an end mark or with empty rows at its end is
kept in memory; so is one with numbers in another spelling, which the quick parsers refuse and :meth:`PlainText.respell`
then rewrites.
"""

from __future__ import annotations

import codecs
import io
import re
from pathlib import Path
from typing import BinaryIO

#: Stands for one or more blanks or tabs as the delimiter.
BLANKS = " "
TAIL_BYTES = 1 << 14  # at the end of a file, in which its last row is sought
_END_MARK = b"\x1a"  # Ctrl-Z, of CP/M and MS-DOS
_SEPARATORS = b',;\t "\r'
_WIDE_SHARE = 0.75  # of the bytes at odd or at even places that are zero in UTF-16 of numbers
_BLOCK_BYTES = 1 << 20
#: What instruments write for a value beyond their range, in lower case.
OVERFLOWS = (
    *(
        "ovld",
        "ovl",
        "ol",
        "o.l",
        "o.l.",
        "overload",
        "over load",
        "overflow",
        "over",
        "over range",
    ),
    *("overrange", "over-range", "overscale", "underflow", "under range", "underrange", "under"),
    *("burn out", "burnout", "burn-out", "clip", "clipped", "1.#ind", "1.#qnan", "#div/0!", "#nv"),
    *("#n/v", "#value!", "#num!", "invalid", "---", "--"),
)
_REPEATED = r"\+{3,}|-{3,}|\*{3,}|#{3,}"
_WORDS = "|".join(re.escape(word).replace(r"\ ", " +") for word in OVERFLOWS)
#: Minus sign, en dash, figure dash, and the en dash of Windows-1252 as it is decoded here.
_MINUS = "\u2212\u2013\u2012\udc96\x96"


class PlainText:
    """The content of a text file as plain bytes; :attr:`encoding` is that of the file."""

    def __init__(self, path: Path) -> None:
        """Look at both ends of the file. OSError where it cannot be read."""
        self._path = path
        self._content: bytes | None = None
        with path.open("rb") as stream:
            head = stream.read(TAIL_BYTES)
            size = stream.seek(0, 2)
            stream.seek(max(0, size - TAIL_BYTES))
            tail = stream.read()
        self.wide = _wide_encoding(head)  # "utf-16" and its relatives; "" for others
        self._is_odd = bool(self.wide) or len(_without_end(tail)) < len(tail)

    def open(self) -> BinaryIO:
        """Open the content as a stream of bytes."""
        if not self._is_odd:
            return self._path.open("rb")
        if self._content is None:
            self._content = _without_end(self._decoded())
        return io.BytesIO(self._content)

    def respell(self, delimiter: str, decimal: str) -> bool:
        """Rewrite numbers in another spelling and words for overflows; False if there were none.

        Lines stay where they are.
        """
        text = self.read().decode("utf-8", errors="surrogateescape")
        plain = respelled(text, delimiter, decimal)
        if plain != text:
            self.replace(plain.encode("utf-8", errors="surrogateescape"))
        return plain != text

    def read(self) -> bytes:
        """Return the whole content."""
        with self.open() as stream:
            return stream.read()

    def replace(self, content: bytes) -> None:
        """Take other content from now on."""
        self._content = content
        self._is_odd = True

    def _decoded(self) -> bytes:
        with self._path.open("rb") as stream:
            if not self.wide:
                return stream.read()
            decoder = codecs.getincrementaldecoder(self.wide)(errors="replace")
            parts: list[bytes] = []
            while block := stream.read(_BLOCK_BYTES):
                parts.append(decoder.decode(block).encode())
            return b"".join([*parts, decoder.decode(b"", final=True).encode()])


def respelled(text: str, delimiter: str, decimal: str) -> str:
    """Return text with its numbers in plain spelling: ``−1``, ``1.0D+00``, ``+ 0.08``, ``∞``, ``OVLD``.

    ``delimiter``, ``decimal``: several characters each for the head of a file, where they are not known.
    """
    tabs = "" if "\t" in delimiter else "\t"
    edge = re.escape(delimiter) + ("\\t" if delimiter == BLANKS else "") + '"'
    blanks = f"[ {tabs}]*"
    sign = re.escape(decimal)
    mantissa = f"(?:\\d+[{sign}]?\\d*|[{sign}]\\d+)"
    pattern = re.compile(
        f"(?:^|(?<=[{edge}])){blanks}(?:"
        f"(?P<word>[+-]?(?:{_WORDS})|{_REPEATED})"
        f"|(?P<infinite>[+\\-{_MINUS}]?)(?:∞|1\\.#inf)"
        f"|(?P<number>[+-]?{mantissa}(?:D[+\\-{_MINUS}]|E[{_MINUS}])\\d+)"
        f"|(?P<sign>[{_MINUS}]|[+-](?=[ \t])){blanks}"
        f"(?P<digits>{mantissa}(?:[ED][+\\-{_MINUS}]?\\d+)?)"
        f")(?={blanks}(?:[{edge}\\r\\n]|\\Z))",
        re.IGNORECASE | re.MULTILINE,
    )
    return pattern.sub(_plain_cell, text)


def _plain_cell(match: re.Match[str]) -> str:
    if match["word"] is not None:
        return "nan"
    if match["infinite"] is not None:
        return ("-" if _is_minus(match["infinite"]) else "") + "inf"
    number = re.sub(f"[{_MINUS}]", "-", match["number"] or match["digits"])
    number = re.sub(r"D(?=[+-])", "e", number, flags=re.IGNORECASE)
    return ("-" if _is_minus(match["sign"] or "") else "") + number


def _is_minus(sign: str) -> bool:
    return sign != "" and sign in "-" + _MINUS


def _wide_encoding(head: bytes) -> str:
    """Return the encoding of text of two bytes a character, by its mark or by its zero bytes; else ""."""
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    if len(head) < 4:
        return ""
    even, odd = head[0::2].count(0) / len(head[0::2]), head[1::2].count(0) / len(head[1::2])
    if even == 0.0 and odd > _WIDE_SHARE:
        return "utf-16-le"
    return "utf-16-be" if odd == 0.0 and even > _WIDE_SHARE else ""


def _without_end(content: bytes) -> bytes:
    """Return text without an end mark, and without empty rows of separators at its end."""
    mark = content.find(_END_MARK, len(content.rstrip(_END_MARK + b"\r\n \t")))
    end = len(content) if mark < 0 else mark
    last = end
    while last > 0:
        begin = content.rfind(b"\n", 0, last - 1) + 1
        line = content[begin:last]
        if line.strip(_SEPARATORS + b"\n"):
            break
        if line.strip(b"\r\n "):
            end = begin
        last = begin
    return content[:end]
