"""Elements of a certificate: both namespaces, texts in English, numbers with all digits."""

from __future__ import annotations

from typing import Any

from vibrident.base.escaping import xml_text
from vibrident.export.form import library
from vibrident.show.language import Translator

LANGUAGE = "en"  # language of the texts written here, ISO 639-1
DCC = "https://ptb.de/dcc"  # namespace of the certificate
SI = "https://ptb.de/si"  # namespace of the quantities


class Tree:
    """Elements of both namespaces."""

    def __init__(self) -> None:
        self.etree: Any = library("lxml.etree", "dcc")

    def make(self, tag: str, *children: Any, text: str | None = None, **attributes: str) -> Any:
        """Return an element; a tag with ``si:`` is in that namespace, all others are DCC's."""
        space, _, name = tag.rpartition(":")
        element = self.etree.Element(f"{{{SI if space == 'si' else DCC}}}{name}", **attributes)
        element.text = text
        element.extend([child for child in children if child is not None])
        return element

    def text(self, tag: str, *lines: str) -> Any:
        """Return text by vibrident in English, as one ``content``.

        Each language may have one (PTB's rules in dcclib).
        """
        return self.make(tag, self.make("content", text=cleaned(" ".join(lines)), lang=LANGUAGE))

    def titled(self, key: str) -> Any:
        """Return a certificate's heading as a ``name``."""
        return self.text("name", Translator(LANGUAGE)("section", key))

    def optional(self, tag: str, text: object) -> Any:
        """Return an element with a text; None if there is none."""
        return self.make(tag, text=cleaned(text)) if text else None

    def identification(self, issuer: str, value: object, name: str = "") -> Any:
        """Return a number by which its issuer identifies something."""
        value_node = self.make("value", text=cleaned(value))
        return self.make(
            "identification",
            self.make("issuer", text=issuer),
            value_node,
            self.text("name", name) if name else None,
        )

    def named(self, text: object) -> Any:
        """Return a ``name`` that is stated: one ``content`` without language."""
        return self.make("name", self.make("content", text=cleaned(text)))

    def multiline(self, tag: str, text: object) -> Any:
        """Return text by the laboratory, line by line, in an unknown language."""
        lines = [line for line in str(text).splitlines() if line.strip()] or [""]
        return self.make(tag, *(self.make("content", text=cleaned(line)) for line in lines))


def numeral(value: float) -> str:
    """Return the shortest text that reads back to the same number."""
    return repr(float(value))


def cleaned(text: object) -> str:
    """Return a line of characters allowed in XML, never empty."""
    return xml_text(text) or "not stated"
