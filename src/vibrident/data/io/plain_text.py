"""Bytes of a text file as its parsers take them: no UTF-16, no Ctrl-Z, numbers in plain spelling.

An ordinary file is read from the disk as it is. One in UTF-16, with an end mark or with empty rows
at its end is kept in memory; so is one with numbers in another spelling, which the quick parsers
refuse and :meth:`PlainText.respell` then rewrites.
"""

from __future__ import annotations

import codecs
import io
import re
from pathlib import Path
from typing import BinaryIO

from vibrident.data.io.vocabulary import VOCABULARY

#: Stands for one or more blanks or tabs as the delimiter.
BLANKS = " "
TAIL_BYTES = 1 << 14  # at the end of a file, in which its last row is sought
_END_MARK = b"\x1a"  # Ctrl-Z, of CP/M and MS-DOS
_SEPARATORS = b',;\t "\r'
_WIDE_SHARE = 0.75  # of the bytes at odd or at even places that are zero in UTF-16 of numbers
_BLOCK_BYTES = 1 << 20
#: What instruments write for a value beyond their range, in lower case.
OVERFLOWS: tuple[str, ...] = tuple(VOCABULARY["overflows"])
_REPEATED = r"\+{3,}|-{3,}|\*{3,}|#{3,}"
_WORD_LIKE = re.compile(r"[A-Za-z#*][A-Za-z#*./ ]|[+-]{2}")
_PLAIN = b'0123456789.,;+-eE" \t\r\n'
_LOOSE_SIGN = re.compile(rb"[+-][^0-9.,]")
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
        self.wide: str = _wide_encoding(head)  # "utf-16" and its relatives; "" for others
        self._is_odd = bool(self.wide) or len(_without_end(tail)) < len(tail)

    def open(self) -> BinaryIO:
        """Open the content as a stream of bytes."""
        if not self._is_odd:
            return self._path.open("rb")
        if self._content is None:
            self._content = _without_end(self._decoded())
        return io.BytesIO(self._content)

    def respell(self, delimiter: str) -> bool:
        """Rewrite numbers in another spelling and words for overflows; False if there were none.

        Lines stay where they are.
        """
        content = self.read()
        blocks: list[bytes] = []
        begin = 0
        while begin < len(content):
            end = content.find(b"\n", begin + _BLOCK_BYTES) + 1 or len(content)
            block = content[begin:end]
            if block.translate(None, _PLAIN) or _LOOSE_SIGN.search(block):
                text = respelled(block.decode(errors="surrogateescape"), delimiter)
                block = text.encode(errors="surrogateescape")
            blocks.append(block)
            begin = end
        plain = b"".join(blocks)
        if plain != content:
            self.replace(plain)
        return plain != content

    def read(self) -> bytes:
        """Return the whole content."""
        with self.open() as stream:
            return stream.read()

    def replace(self, content: bytes) -> None:
        """Take other content from now on."""
        self._content = content
        self._is_odd = True

    def _decoded(self) -> bytes:
        content = self._path.read_bytes()
        return content.decode(self.wide, errors="replace").encode() if self.wide else content


def respelled(text: str, delimiter: str) -> str:
    """Return text with its numbers in plain spelling: −1, 1.0D+00, + 0.08, ∞, OVLD.

    ``delimiter``: of cells, or all that it may be.
    """
    edge = re.escape(delimiter) + ("\\t" if delimiter == BLANKS else "") + r'\r\n"'
    blank = " " if "\t" in delimiter else r"[ \t]"
    for sign in _MINUS:
        if sign in text:
            text = re.sub(f"{sign}(?<![^{edge} eEdD]{sign})", "-", text)
    text = re.sub(rf"(?<=[\d.,])[dD](?=[+-]\d+{blank}*(?:[{edge}]|\Z))", "e", text)
    text = text.replace("∞", "inf")
    text = re.sub(rf"([+-])(?<![^{edge} ][+-]){blank}+(?=[\d.,])", r"\1", text)
    if _WORD_LIKE.search(text):
        cell = rf"(?<![^{edge}]){blank}*(?:([+-]?)1\.#inf|[+-]?(?:{_WORDS})|{_REPEATED})"
        cell += rf"(?={blank}*(?:[{edge}]|\Z))"
        text = re.sub(cell, _plain_word, text, flags=re.IGNORECASE)
    return text


def _plain_word(match: re.Match[str]) -> str:
    return "nan" if match[1] is None else match[1] + "inf"


def _wide_encoding(head: bytes) -> str:
    """Return the encoding of text of two bytes a character, by its mark or its zeros; else ""."""
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    if len(head) < 4:
        return ""
    even = head[0::2].count(0) / len(head[0::2])
    odd = head[1::2].count(0) / len(head[1::2])
    if even == 0.0 and odd > _WIDE_SHARE:
        return "utf-16-le"
    return "utf-16-be" if odd == 0.0 and even > _WIDE_SHARE else ""


def _without_end(content: bytes) -> bytes:
    """Return text without an end mark, and without empty rows of separators at its end."""
    mark = content.find(_END_MARK, len(content.rstrip(_END_MARK + b"\r\n \t\0")))
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
