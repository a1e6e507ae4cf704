"""Parse units as people and programs write them into dimension and factor.

``parse_unit("mm/s")`` is 1e-3 of m s⁻¹; "g" is standard gravity, 9.80665 m/s² (CGPM 1901; ISO
80000-3), never gram. The grammar: symbols or words with SI prefixes and exponents, joined by ``*``,
``·``, blanks, ``/`` or "per"; a second slash divides again ("m/s/s"). Symbols are case-sensitive;
capitals alone count as lower case where only one reading remains ("M/S2", not "MV").
"""

from __future__ import annotations

import functools
import re
import tomllib
import unicodedata
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from vibrident.data.records import REFERENCE_UNITS

MAX_UNIT_LENGTH = 60  # characters; a longer text is a remark
MAX_NAME_LENGTH = 200  # characters of a column's name; of a longer one no unit is sought
_TABLES = tomllib.loads(Path(__file__).with_name("units.toml").read_text(encoding="utf-8"))

#: Signs that mean the same as a plain one.
PLAIN_SIGNS = str.maketrans(_TABLES["plain_signs"])

PLAIN_BRACKETS = str.maketrans("（）［］【】｛｝＜＞／", "()[][]{}<>/")

#: Symbol → factor, dimension (base → exponent), and the SI prefixes that it is written with.
_SYMBOLS: dict[str, tuple[float, dict[str, int], str]] = _TABLES["symbols"]
#: Words and other spellings, in lower case → symbol.
_WORDS = {word: symbol for symbol, words in _TABLES["words"].items() for word in words}
#: Spellings of symbols that are no words, as they may have a prefix; and those in capitals.
_ALIASES: dict[str, str] = _TABLES["aliases"]
_CAPITALS: dict[str, str] = _TABLES["capitals"]
_PREFIXES: dict[str, float] = _TABLES["prefixes"]
_PREFIX_WORDS: dict[str, str] = _TABLES["prefix_words"]
#: Written without a sign between metre and second, also in "mV/ms-2"; by the rules a millisecond.
_RUN_TOGETHER = re.compile(r"(?<![^\W_])ms\^?-([12])(?!\d)")
_NO_UNIT = frozenset(_TABLES["no_unit"])
_COUNTERS = frozenset(_TABLES["counters"])
_AFTER_WORD = re.compile(r"^(.*\S)\s+(?:in|en)\s+(\S.*)$", re.IGNORECASE)
_AFTER_SLASH = re.compile(r"^([^/]*[\w)\]|])\s*/\s*(\(.+\)|.+)$")
_TOKEN = re.compile(
    r"\s*(?:(?P<sign>[*/()])|(?P<name>[^\W\d_]+(?:_n|'s)?|[%°]|1(?![\d.]))(?P<power>\^?[+-]?\d)?)"
)
_PHRASES = (
    (re.compile(r"\bper\b", re.IGNORECASE), "/"),
    (re.compile(r"\bsquared\b|\bsquare\b|\bsq\b\.?", re.IGNORECASE), "^2"),
    (re.compile(r"\b([numck]?m|in|ft)ps(?=\b|\^?2)"), r"\1/s"),  # mmps, mps2
    (re.compile(r"\*\*"), "^"),
    (re.compile(r"\s+\^"), "^"),
    (re.compile(r"\^\{([+-]?\d)\}"), r"^\1"),  # TeX
    (re.compile(r"(?<=[^\W_])\.(?=[^\W\d_])"), "*"),  # V.s2/m
)


@dataclass(frozen=True)
class Unit:
    """A unit: ``factor`` times the SI unit of its dimension, a sorted tuple of (base, exponent)."""

    factor: float
    dimension: tuple[tuple[str, int], ...]

    def over(self, divisor: Unit) -> Unit:
        """Return this unit divided by another."""
        exponents = Counter(dict(self.dimension))
        exponents.subtract(dict(divisor.dimension))
        return Unit(self.factor / divisor.factor, _sorted(exponents))

    def times(self, factor: Unit) -> Unit:
        """Return the product of two units."""
        return self.over(Unit(1.0 / factor.factor, tuple((b, -e) for b, e in factor.dimension)))


def _sorted(exponents: Counter[str]) -> tuple[tuple[str, int], ...]:
    return tuple(sorted((base, exponent) for base, exponent in exponents.items() if exponent))


def is_no_unit(text: str) -> bool:
    """Tell whether a stated unit is one of the words for none, such as "-" or "n/a"."""
    return text.strip().lower() in _NO_UNIT


def is_row_counter(text: str) -> bool:
    """Tell whether a text in place of a unit says that a column numbers the rows."""
    return text.strip().lower() in _COUNTERS


@functools.lru_cache(maxsize=1024)
def parse_unit(text: str) -> Unit | None:
    """Return the unit that a text names; None where it names none that is known."""
    plain = unicodedata.normalize("NFKC", text.strip()).translate(PLAIN_SIGNS)
    plain = without_brackets(plain)
    if is_no_unit(plain) or len(plain) > MAX_UNIT_LENGTH:
        return None
    plain = _RUN_TOGETHER.sub(r"(m/s^\1)", plain)
    if plain.lower() in _WORDS:
        return _named(plain)
    for pattern, sign in _PHRASES:
        plain = pattern.sub(sign, plain)
    return _parse_product(plain)


def conversion(stated: str, wanted: str) -> float | None:
    """Return the factor from one unit to another; None where they do not measure the same."""
    if stated == wanted:
        return 1.0
    units = parse_unit(stated), parse_unit(wanted)
    if units[0] is None or units[1] is None or units[0].dimension != units[1].dimension:
        return None
    return units[0].factor / units[1].factor


def without_brackets(text: str) -> str:
    """Take off brackets around the whole text."""
    while len(text) > 1 and text[0] + text[-1] in ("[]", "()", "{}", "<>") and _closes_last(text):
        text = text[1:-1].strip()
    return text


def _closes_last(text: str) -> bool:
    depth = 0
    for index, sign in enumerate(text):
        depth += (sign in "([{<") - (sign in ")]}>")
        if depth == 0:
            return index == len(text) - 1
    return False


def split_brackets(name: str) -> tuple[str, str]:
    """Return a column's name and the unit in brackets behind it; "" for none.

    There is none in "S in V/(m/s²)", whose brackets are a part of the unit.
    """
    name = name.strip().translate(PLAIN_BRACKETS)
    if len(name) > MAX_NAME_LENGTH or not name.endswith((")", "]", "}", ">")):
        return name, ""
    starts = (index for index in range(1, len(name)) if name[index] in "([{<")
    start = next((index for index in starts if _closes_last(name[index:])), 0)
    base = name[:start].rstrip()
    is_part_of_unit = base.endswith(("/", "*", "·", "⋅", "^"))
    return (name, "") if is_part_of_unit or not base else (base, name[start + 1 : -1].strip())


def split_unit(name: str) -> tuple[str, str]:
    """Return a column's name and the unit behind it, as written; "" for none.

    The unit stands in brackets, behind "in", behind a blank with a slash in it ("S mV/g"), behind a
    comma, or behind a slash.
    """
    base, unit = split_brackets(name)
    if unit or len(base) > MAX_NAME_LENGTH:
        return base, unit
    if (match := _AFTER_WORD.match(base)) and (
        " " not in match[2] or match[2].lower().startswith("db") or parse_unit(match[2])
    ):
        return match[1], match[2]
    before, blank, last = base.rpartition(" ")
    if blank and "/" in last[1:] and parse_unit(last) is not None:
        return before.rstrip(), last
    before, comma, last = base.rpartition(",")
    if comma and parse_unit(last) is not None:
        return before.rstrip(), last.strip()
    match = _AFTER_SLASH.match(base)
    if match and all(match[1].count(a) == match[1].count(b) for a, b in ("()", "[]")):
        return match[1], without_brackets(match[2])
    return base, ""


def _parse_product(text: str) -> Unit | None:
    """Parse factors from left to right; a group in brackets is a factor."""
    stack: list[tuple[Unit, bool]] = []  # the products outside of open brackets, each with its sign
    product = Unit(1.0, ())
    divides = False
    offset = 0
    factors = 0
    while offset < len(text):
        token = _TOKEN.match(text, offset)
        if token is None:
            return None if text[offset:].strip() else (product if factors and not stack else None)
        offset = token.end()
        sign = token["sign"]
        if sign in ("*", "/"):
            divides = sign == "/"
            continue
        if sign == "(":
            stack.append((product, divides))
            product = Unit(1.0, ())
            divides = False
            continue
        if sign == ")":
            if not stack:
                return None
            factor = product
            product, divides = stack.pop()
        else:
            symbol = _named(token["name"])
            if symbol is None:
                return None
            factor = _power(symbol, int((token["power"] or "1").lstrip("^")))
        product = product.over(factor) if divides else product.times(factor)
        divides = False
        factors += 1
    return product if factors and not stack else None


def _power(unit: Unit, exponent: int) -> Unit:
    return Unit(unit.factor**exponent, tuple((b, e * exponent) for b, e in unit.dimension))


@functools.lru_cache(maxsize=1024)
def _named(name: str) -> Unit | None:
    """Return the unit of a symbol or word with a prefix or without."""
    lower = name.lower()
    plural = lower[:-1] if lower.endswith("s") and len(lower) > 3 else lower
    for word in (lower, plural):
        if word in _WORDS and name not in _SYMBOLS:
            return _unit(_WORDS[word], "")
        for prefix, sign in _PREFIX_WORDS.items():
            if word.startswith(prefix) and word[len(prefix) :] in _WORDS:
                return _unit(_WORDS[word[len(prefix) :]], sign)
    exact = _symbol(name)
    if exact is not None or not name.isupper():
        return exact or (_symbol(lower) if name.istitle() and len(name) > 1 else None)
    # "MV" may be meant for mV or for MV: no guess. Other capitals have one reading left.
    if len(name) == 2 and name[0] == "M" and name[1] in "VAC":
        return None
    return _symbol(_CAPITALS.get(name, lower))


def _symbol(name: str) -> Unit | None:
    for size in (0, 1):  # of the prefix
        base = _ALIASES.get(name[size:], name[size:])
        if size and len(base) > 2:  # "mVolts"
            base = _WORDS.get(base.lower().removesuffix("s"), base)
        if base in _SYMBOLS and (not size or name[0] in _SYMBOLS[base][2]):
            return _unit(base, name[:size])
    return None


def _unit(symbol: str, prefix: str) -> Unit:
    factor, exponents, _ = _SYMBOLS[symbol]
    return Unit(factor * _PREFIXES.get(prefix, 1.0), tuple(sorted(exponents.items())))


#: Dimension of each quantity of a reference.
QUANTITY_UNITS = {
    quantity: parsed
    for quantity, si in REFERENCE_UNITS.items()
    if (parsed := parse_unit(si)) is not None
}


def quantity_of(unit: str) -> str | None:
    """Return the quantity of motion that a unit is of; None for another or an unknown unit."""
    parsed = parse_unit(unit)
    if parsed is None:
        return None
    return next((q for q, si in QUANTITY_UNITS.items() if si.dimension == parsed.dimension), None)


def factor_between(unit: str, target: str) -> float | None:
    """Return how many ``target`` units a ``unit`` is; None if unknown or of another dimension."""
    parsed = parse_unit(unit)
    target_unit = parse_unit(target)
    if parsed is None or target_unit is None or parsed.dimension != target_unit.dimension:
        return None
    return parsed.factor / target_unit.factor
