"""Translate the page's sentences, from a TOML file a language.

As in gettext, the key of a sentence is its English text, and values are inserted by name:
``translate("{name} came with the data", name=file)``. The sentences of certificates are in the
catalogues of ``vibrident.show.language``.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from functools import cache, cached_property, lru_cache
from pathlib import Path
from string import Formatter
from typing import Any

from vibrident.base.fields import NamedTexts
from vibrident.show.language import COMMA, Translator, from_english

#: Code → what the language calls itself.
LANGUAGES = {"en": "English", "de": "Deutsch", "zh": "中文"}
#: Code → the name of the language for browser and Quasar.
LOCALES = {"en": "en-US", "de": "de", "zh": "zh-CN"}
COOKIE = "vibrident-language"  # of the browser, where somebody has chosen a language
SCOPE = "vibrident.language"  # key of a request's scope: the language of its page
_FOLDER = Path(__file__).parent / "languages"
_NUMBERS = ("count", "number", "iteration", "most", "start", "done", "total", "frequency")
_MIN_TEMPLATE_LETTERS = 4  # of a template's own words, by which a finished sentence is recognised
_NUMBER = re.compile(r"[-+−±<(]?\s?\d")
_FILE = re.compile(r"\.[A-Za-z]|\d{4}-\d\d")


def choose_language(cookies: NamedTexts, accepted: str) -> str:
    """Return the code of a page's language: the chosen one, else the browser's first known one."""
    if (code := cookies.get(COOKIE, "")) in LANGUAGES:
        return code
    preferred = []
    for order, choice in enumerate(accepted[:1000].split(",")):
        name, _, weight = choice.partition(";")
        quality = re.fullmatch(r"\s*q=([01](?:\.\d{1,3})?)\s*", weight)
        size = float(quality[1]) if quality else 0.0 if weight else 1.0
        preferred.append((-size, order, name.strip().lower().partition("-")[0]))
    return next((code for size, _, code in sorted(preferred) if size and code in LANGUAGES), "en")


def translate(english: str, /, **values: Any) -> str:
    """Return a sentence in the language of the page being built or served."""
    return page_language()(english, **values)


def translate_count(number: int, singular: str, plural: str, /, **values: Any) -> str:
    """Return one of two sentences by a ``{count}``, in the language of the page."""
    return page_language().count(number, singular, plural, **values)


def phrase(english: str, /, **values: Any) -> str:
    """Return an English sentence that ``translate`` translates when it is shown."""
    return english.format(**values) if values else english


def page_language() -> Language:
    """Return the language of the page being built or served; English outside a page."""
    from nicegui import context

    try:
        request = context.client.request
    except RuntimeError:  # no page
        return language("en")
    return language(request.scope.get(SCOPE, "en"))


@cache
def language(code: str) -> Language:
    """Return a language by its code."""
    return Language(code)


@cache
def catalogue(code: str) -> Mapping[str, NamedTexts]:
    """Return the page's own catalogue of a language: English sentence → sentence, in two parts.

    ``said`` are sentences of the page itself, ``made`` those that it gets in English with their
    values in them.
    """
    if code == "en":
        return {"said": {}, "made": {}}
    return tomllib.loads((_FOLDER / f"{code}.toml").read_text(encoding="utf-8"))


class Language:
    """A language that the page can speak."""

    def __init__(self, code: str) -> None:
        self.code = code
        self.comma = code in COMMA
        self._certificates = Translator(code)

    def __call__(self, english: str, /, **values: Any) -> str:
        """Return a sentence, with values by name; one that is finished is recognised by its words.

        English words that no catalogue has stay as they are.
        """
        text = self.translation(english)
        if values:
            filled = {name: self._value(value) for name, value in values.items()}
            return (english if text is None else text).format(**filled)
        return self._finished(english) if text is None else text

    def count(self, number: int, singular: str, plural: str, /, **values: Any) -> str:
        """Return one of two sentences, by the ``{count}`` of something."""
        return self(singular if number == 1 else plural, count=number, **values)

    def translation(self, english: str) -> str | None:
        """Return the translation of the page or its certificates; None if there is none."""
        if self.code == "en":
            return english
        return self._words.get(english)

    def label(self, english: str) -> str:
        """Return a label whose unit, after the last comma, stays as it is."""
        title, comma, unit = english.rpartition(", ")
        return (
            f"{self(title)}{comma}{unit}"
            if comma and self.translation(english) is None
            else self(english)
        )

    def number(self, text: str) -> str:
        """Return the numbers of a text with the decimal sign of the language."""
        return self._certificates.number(text)

    def _value(self, value: Any) -> Any:
        """Return a value with the decimal sign, where it begins with a number and names no file."""
        if isinstance(value, str) and _NUMBER.match(value) and not _FILE.search(value):
            return self.number(value)
        return value

    @lru_cache(maxsize=4000)  # noqa: B019 - one object a language, for as long as the server runs
    def _finished(self, english: str) -> str:
        """Return a sentence whose values are inserted already."""
        for pattern, text in self._templates:
            if match := pattern.fullmatch(english):
                matched = {name: self.label(value) for name, value in match.groupdict().items()}
                return text.format(**{name: self._value(value) for name, value in matched.items()})
        return self._value(english)

    @cached_property
    def _words(self) -> NamedTexts:
        page_words = catalogue(self.code)
        return {**from_english(self.code), **page_words["made"], **page_words["said"]}

    @cached_property
    def _templates(self) -> list[tuple[re.Pattern[str], str]]:
        """Return patterns of the sentences with values, those of most words first."""
        if self.code == "en":
            return []
        texts = {**from_english(self.code), **catalogue(self.code)["made"]}
        pieces_of = {english: [*Formatter().parse(english)] for english in texts if "{" in english}
        words = {
            english: "".join(piece[0] for piece in pieces) for english, pieces in pieces_of.items()
        }
        telling = [
            english
            for english in pieces_of
            if len(re.findall("[A-Za-z]", words[english])) >= _MIN_TEMPLATE_LETTERS
        ]
        ordered = sorted(telling, key=lambda english: -len(words[english]))
        return [(_pattern(pieces_of[english]), texts[english]) for english in ordered]


def _pattern(pieces: list[Any]) -> re.Pattern[str]:
    """Return a pattern of a sentence with any values; a name that comes twice has one value."""
    pattern = ""
    names = set()
    for literal, name, _, _ in pieces:
        pattern += re.escape(literal)
        if name is not None:
            values = r"[-+−\d.,e]+" if name in _NUMBERS else r"[^\n]+?"
            pattern += f"(?P={name})" if name in names else f"(?P<{name}>{values})"
            names.add(name)
    return re.compile(pattern)
