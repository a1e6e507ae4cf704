"""The words of a certificate in one language, or in two below each other, from a text file a language."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from vibrident.result import Result
from vibrident.show.formulas import Words


@cache
def _texts(code: str) -> dict[str, dict[str, str]]:
    return tomllib.loads((Path(__file__).parent / "languages" / f"{code}.toml").read_text(encoding="utf-8"))


class Say:
    """Texts in one language, or in a first and, in a line of its own, a second one."""

    def __init__(self, *codes: str) -> None:
        self.codes = codes or ("en",)

    @classmethod
    def of(cls, result: Result) -> Say:
        """The languages that a result's certificate asks for."""
        first = str(result.certificate.get("language") or "en")
        return cls(*dict.fromkeys([first, str(result.certificate.get("second_language") or first)]))

    def each(self, make: Callable[[Say], str]) -> Words:
        """A text made in each language by itself."""
        return Words("\n".join(dict.fromkeys(make(Say(code)) for code in self.codes)))

    def __call__(self, section: str, key: str, **values: Any) -> Words:
        """A text of a language's file, its ``{name}`` filled in with our own words or numbers."""
        return self.each(lambda one: _texts(one.codes[0])[section][key].format(**values))

    def known(self, text: str) -> Words:
        """Our own English words from elsewhere, in the languages as far as these have them."""
        return self.each(lambda one: _texts(one.codes[0])["known"].get(text, text))

    def has(self, text: str) -> bool:
        """Whether these are words that are translated anywhere, not those of others."""
        return any(text in _texts(code)["known"] for code in ("de", *self.codes))


ENGLISH = Say("en")
