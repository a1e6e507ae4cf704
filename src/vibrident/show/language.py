"""Say the words of a certificate in one language or two, from a text file a language."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from vibrident.result import Result
from vibrident.show.formulas import Words


@cache
def _texts(code: str) -> dict[str, dict[str, str]]:
    return tomllib.loads(
        (Path(__file__).parent / "languages" / f"{code}.toml").read_text(encoding="utf-8")
    )


@cache
def from_english(code: str) -> Mapping[str, str]:
    """Return English words → words of a language, of all that certificates say."""
    texts = _texts(code)
    translations = {}
    for section, english in _texts("en").items():
        for key, words in english.items():
            translations.setdefault(words, texts[section][key])
    return {**translations, **texts["known"]}


#: Languages with a comma before the decimals; a document has the sign of its first language.
COMMA = ("de", "fr")
_POINT = re.compile(r"(?<![\d.])(\d+)\.(\d+)(?![\d.]*\d)")


class Say:
    """Texts in one language, or in a first and, in a line of its own, a second one.

    ``comma``: whether numbers have a decimal comma; None for the first language's own sign.
    """

    def __init__(self, *codes: str, comma: bool | None = None) -> None:
        self.codes: tuple[str, ...] = codes or ("en",)
        self.comma: bool = self.codes[0] in COMMA if comma is None else comma

    def number(self, text: str) -> str:
        """Return our own numbers, and what stands beside them, with the document's decimal sign."""
        return _POINT.sub(r"\1,\2", text) if self.comma else text

    @classmethod
    def of(cls, result: Result) -> Say:
        """Return the languages that a result's certificate asks for."""
        first = str(result.certificate.get("language") or "en")
        return cls(*dict.fromkeys([first, str(result.certificate.get("second_language") or first)]))

    def each(self, make: Callable[[Say], str]) -> Words:
        """Return a text made in each language by itself."""
        texts = (make(Say(code, comma=self.comma)) for code in self.codes)
        return Words("\n".join(dict.fromkeys(texts)))

    def __call__(self, section: str, key: str, **values: Any) -> Words:
        """Return a text of a language's file, its ``{name}`` filled in with words or numbers."""
        filled = {
            name: self.number(value) if isinstance(value, str) else value
            for name, value in values.items()
        }
        return self.each(lambda words: _texts(words.codes[0])[section][key].format(**filled))

    def word(self, section: str, key: str) -> Words:
        """Return the translation of a name of the program; the name itself where it is new."""
        return self.each(lambda words: _texts(words.codes[0])[section].get(key, key))

    def translate(self, text: str) -> Words:
        """Return our own English words in the languages, as far as these have them."""
        return self.each(lambda words: _texts(words.codes[0])["known"].get(text, text))

    def has(self, text: str) -> bool:
        """Return whether these are words that are translated anywhere."""
        return any(text in _texts(code)["known"] for code in ("de", *self.codes))


ENGLISH = Say("en")
