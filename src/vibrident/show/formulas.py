"""Set the few formulas among our words, such as ``E_n`` or ``e^{jωt}``.

Only ``Words`` hold formulas. Any other text may be of others, whose ``CALS_0042`` is a number and
no formula.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Mapping

from vibrident.physics.naming import parameter_name, parameter_names


class Words(str):
    """Our own words, without text of others: their formulas are set."""

    __slots__ = ()


class Mixed(str):
    """Our own words, in a line a language, with text of others among them: no formula is set."""

    __slots__ = ()


def symbol(name: str) -> Words:
    """Return the symbol of a parameter: ``f_n``; empty if it has no symbol."""
    letters = parameter_name(name).symbol
    return Words(f"{letters[0]}_{letters[1:]}" if len(letters) > 1 else letters)


_BELOW = str.maketrans("0123456789n", "₀₁₂₃₄₅₆₇₈₉ₙ")


@functools.cache
def formulas() -> Mapping[str, tuple[str, str, str]]:
    """Return formula → its base, its index or exponent, and ``sub`` or ``sup``."""
    symbols: list[str] = sorted({symbol(name) for name in parameter_names()}, key=len, reverse=True)
    symbols = [text for text in symbols if "_" in text]
    pieces = {"e^{jωt}": ("e", "jωt", "sup")}
    for text in ("ν_eff", "E_n", "U_first", *symbols):
        base, _, small = text.partition("_")
        pieces[text] = (base, small, "sub")
    return pieces


def typeset(text: str, escape: Callable[[str], str], mark: Callable[[str, str, str], str]) -> str:
    """Return a text for a medium: escaped, and in ``Words`` with the formulas set.

    ``mark``: from base, small text and ``sub`` or ``sup`` to what the medium writes.
    """
    escaped = escape(text)
    if not isinstance(text, Words):
        return escaped
    formula_parts = {escape(text): pieces for text, pieces in formulas().items()}
    pattern = "|".join(re.escape(text) for text in formula_parts)
    return re.sub(
        rf"(?<![A-Za-z0-9_])(?:{pattern})(?![A-Za-z0-9_])",
        lambda match: mark(*formula_parts[match[0]]),
        escaped,
    )


def marked(base: str, small: str, kind: str) -> str:
    """Return a formula in HTML, which Markdown accepts too."""
    return f"{base}<{kind}>{small}</{kind}>"


def in_a_line(text: str) -> str:
    """Return formulas for a medium of one line: ``f₀`` where the letters exist, else as written."""

    def mark(base: str, small: str, kind: str) -> str:
        below = small.translate(_BELOW)
        return (
            base + below
            if kind == "sub" and below != small
            else f"{base}{'_' if kind == 'sub' else '^'}{small}"
        )

    return typeset(text, str, mark)
