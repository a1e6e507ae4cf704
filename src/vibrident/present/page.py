"""A page in the common frame whose sections are HTML already, for what no view model holds yet."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from vibrident.escaping import html as escaped
from vibrident.present import html
from vibrident.present.views import Sentence


@dataclass
class Page:
    """A page in the making; ``head`` and the sections' parts are HTML."""

    title: str
    sections: list[tuple[str, str, str]] = field(default_factory=list)
    head: str = ""

    def add(self, name: str, title: str, *parts: str | None) -> None:
        """Add a section, unless all its parts are empty."""
        body = "\n".join(part for part in parts if part)
        if body:
            self.sections.append((name, title, body))

    def html(self) -> str:
        """The whole file."""
        return html.framed(self.title, self.head, self.sections)


def text(words: object) -> str:
    """Text of others as text, on one line."""
    return escaped(words)


def paragraphs(words: Iterable[str], kind: str = "") -> str:
    """Each text a paragraph."""
    return html.fragment(*(Sentence(part, "note" if kind == "note" else "plain") for part in words))


def folded(summary: str, content: str) -> str:
    """Content behind a line to open it; nothing for nothing."""
    return f"<details><summary>{text(summary)}</summary>\n{content}</details>" if content else ""
