"""Units of a result in the spelling of the Digital System of Units (D-SI), each one checked by dsiUnits."""

from __future__ import annotations

import re
import warnings

from vibrident.base.errors import InputError
from vibrident.export.form import library

_NAMES = {
    "V": "volt", "A": "ampere", "C": "coulomb", "Hz": "hertz", "s": "second", "m": "metre", "rad": "radian",
    "deg": "degree", "°": "degree", "N": "newton", "Pa": "pascal", "W": "watt", "F": "farad", "Ω": "ohm", "K": "kelvin",
    "%": "percent", "min": "minute",
}  # fmt: skip
#: Spellings of dimensionless counts.
_ONE = {"1", "count", "counts", "LSB", "digit", "digits"}
_PREFIXES = {
    "f": "femto", "p": "pico", "n": "nano", "u": "micro", "µ": "micro", "μ": "micro", "m": "milli", "c": "centi",
    "k": "kilo", "M": "mega", "G": "giga",
}  # fmt: skip
_TOKEN = re.compile(r"\s*(?:(\()|(\))|([*·/])|\^(\([+-]?\d+\)|[+-]?\d+)|(1(?![\d.])|[^\W\d_]+|[%°]))")
_PLAIN = str.maketrans({"²": "^2", "³": "^3"})


def d_si(unit: str) -> str:
    r"""A unit such as ``V/(m/s^2)`` in D-SI: ``\volt\metre\tothe{-1}\second\tothe{2}``.

    Raises:
        InputError: the unit is unknown, or dsiUnits is not installed.
    """
    powers = _parsed(unit)
    parts = []
    for name, power in powers.items():
        if power:
            parts.append(name if power == 1 else f"{name}\\tothe{{{power}}}")
    text = "".join(parts) or "\\one"
    kind = library("dsi_unit", "dcc").DsiUnit
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # ``valid`` reports the same
        valid = kind(text).valid
    if not valid:
        raise _unknown(unit, text)
    return text


def _parsed(unit: str) -> dict[str, int]:
    """Product of named units, name → power, by one pass over the text; a quotient applies to the next factor only."""
    text = unit.strip().translate(_PLAIN) or "1"
    powers: dict[str, int] = {}
    signs, sign, at = [1], 1, 0  # signs: of the parentheses around; sign: of the next factor
    last: list[tuple[str, int]] = []
    while at < len(text):
        found = _TOKEN.match(text, at)
        if not found:
            raise _unknown(unit, text[at:])
        at = found.end()
        opened, closed, operator, power, name = found.groups()
        if opened:
            signs.append(signs[-1] * sign)
            sign, last = 1, []
        elif closed:
            if len(signs) == 1:
                raise _unknown(unit, text)
            signs.pop()
            sign, last = 1, []
        elif operator:
            sign, last = (-1 if operator == "/" else 1), []
        elif power is not None:
            if not last:
                raise _unknown(unit, text)
            for key, count in last:
                powers[key] += count * (int(power.strip("()")) - 1)
            last = []
        else:
            key = _named(name, unit)
            count = signs[-1] * sign
            if key is not None:
                powers[key] = powers.get(key, 0) + count
            last = [(key, count)] if key is not None else []
            sign = 1
    if len(signs) != 1:
        raise _unknown(unit, text)
    return powers


def _named(name: str, unit: str) -> str | None:
    """D-SI name of a symbol with or without prefix; None for a pure number."""
    if name in _ONE:
        return None
    if name in _NAMES:
        return f"\\{_NAMES[name]}"
    if name[0] in _PREFIXES and name[1:] in _NAMES:
        return f"\\{_PREFIXES[name[0]]}\\{_NAMES[name[1:]]}"
    raise _unknown(unit, name)


def _unknown(unit: str, found: str) -> InputError:
    return InputError(
        f"The unit {unit!r} has no form in D-SI.",
        expected="units of the SI by their symbols, such as V/(m/s^2), mV, pC or count",
        found=repr(found),
        where="result.json, units",
        remedy="state [response] unit (and that of a drive) by its SI symbol and identify again",
    )
