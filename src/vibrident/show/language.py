"""Translate the texts of a certificate into one language or two, from a TOML file a language."""

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
    """Return the translations of all texts of certificates: English → the language ``code``."""
    texts = _texts(code)
    translations = {}
    for section, english in _texts("en").items():
        for key, text in english.items():
            translations.setdefault(text, texts[section][key])
    return {**translations, **texts["known"]}


#: Languages with a comma before the decimals; a document has the sign of its first language.
COMMA = ("de", "fr")
_POINT = re.compile(r"(?<![\d.])(\d+)\.(\d+)(?![\d.]*\d)")


class Translator:
    """A translator into one language or two, the second in a line of its own.

    ``comma``: whether numbers have a decimal comma; None for the first language's own sign.
    """

    def __init__(self, *codes: str, comma: bool | None = None) -> None:
        self.codes: tuple[str, ...] = codes or ("en",)
        self.comma: bool = self.codes[0] in COMMA if comma is None else comma

    @classmethod
    def from_result(cls, result: Result) -> Translator:
        """Return the translator into the languages that a result's certificate asks for."""
        first = str(result.certificate.get("language") or "en")
        return cls(*dict.fromkeys([first, str(result.certificate.get("second_language") or first)]))

    def number(self, text: str) -> str:
        """Return a text with the document's decimal sign in its numbers."""
        return _POINT.sub(r"\1,\2", text) if self.comma else text

    def each_language(self, make: Callable[[Translator], str]) -> Words:
        """Return the lines that ``make`` returns for the translator into each language."""
        texts = (make(Translator(code, comma=self.comma)) for code in self.codes)
        return Words("\n".join(dict.fromkeys(texts)))

    def __call__(self, section: str, key: str, **values: Any) -> Words:
        """Return a text of the languages' files, its ``{name}`` replaced by the values."""
        filled = {
            name: self.number(value) if isinstance(value, str) else value
            for name, value in values.items()
        }
        return self._look_up(section, lambda texts: texts[key].format(**filled))

    def name(self, section: str, key: str) -> Words:
        """Return the translation of one of the program's names; a new name as it is."""
        return self._look_up(section, lambda texts: texts.get(key, key))

    def phrase(self, english: str) -> Words:
        """Return the translation of an English phrase; an unknown phrase as it is."""
        return self.name("known", english)

    def knows(self, phrase: str) -> bool:
        """Return whether any language has a translation of an English phrase."""
        return any(phrase in _texts(code)["known"] for code in ("de", *self.codes))

    def _look_up(self, section: str, choose: Callable[[Mapping[str, str]], str]) -> Words:
        return Words("\n".join(dict.fromkeys(choose(_texts(code)[section]) for code in self.codes)))


ENGLISH = Translator("en")
