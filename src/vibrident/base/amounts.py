"""Format numbers with units for messages, tables and pictures."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import overload

PLAIN_DIGITS = 6  # significant digits of a value whose uncertainty is not known
NONE = "–"  # printed where there is no number


def plain(value: float | None, digits: int = PLAIN_DIGITS) -> str:
    """Return a number without stated uncertainty as text; "–" for None and not finite.

    ``digits``: largest number of significant digits.
    """
    if value is None or not math.isfinite(value):
        return NONE
    text = f"{value:.{digits}g}"
    head, _, power = text.partition("e")
    if power and 0 <= int(power) < 6:  # 4.1e+03 reads better as 4100
        return f"{float(text):.0f}"
    return f"{head}e{int(power)}" if power else "0" if float(text) == 0 else text


_PREFIXES = {-15: "f", -12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
_EXPONENTS = {prefix: exponent for exponent, prefix in _PREFIXES.items() if prefix} | {
    "u": -6,
    "μ": -6,
}

#: Powers of ten that engineers write before each unit: 475 mHz or km/s² are not used.
_NATURAL = {
    "V": (-9, 6),
    "A": (-12, 3),
    "C": (-15, 0),
    "s": (-12, 0),
    "m": (-12, 0),
    "Hz": (0, 9),
    "Pa": (-6, 9),
    "N": (-6, 6),
    "W": (-9, 6),
    "F": (-15, 0),
    "Ω": (-3, 9),
}
SUPERSCRIPTS = str.maketrans("0123456789-+", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺")


@dataclass(frozen=True)
class UnitScale:
    """Factor to values in ``unit``, which is ready for print."""

    factor: float
    unit: str

    @property
    def printed(self) -> str:
        """Return the unit; empty for the unit one."""
        return "" if self.unit == "1" else self.unit

    @overload
    def times(self, value: float) -> float: ...
    @overload
    def times(self, value: float | None) -> float | None: ...
    def times(self, value: float | None) -> float | None:
        """Return a value in the unit; None stays None."""
        return None if value is None else value * self.factor


def pretty(unit: str) -> str:
    """Format a unit with superscripts: ``m/s^2`` becomes ``m/s²``; no unit becomes ``1``."""
    power = r"\^(?:\(([+-]?\d+)\)|([+-]?\d+))"
    text = re.sub(power, lambda match: (match[1] or match[2]).translate(SUPERSCRIPTS), unit.strip())
    return text.replace("*", "·") or "1"


def scaled(unit: str, size: float) -> UnitScale:
    """Choose the SI prefix that makes a number read well.

    Args:
        unit: unit of the number, such as ``V/(m/s^2)``, ``s`` or ``1``; it may have a prefix
            already.
        size: typical magnitude of the number in that unit; zero and values that are not finite
            leave the unit as it is.

    Returns:
        factor and unit; the factor is 1 if no prefix is natural for the unit.
    """
    lead = re.match(r"[A-Za-zµμΩ]+", unit)
    if (
        lead is None
        or unit[lead.end() : lead.end() + 1] in ("^", "²", "³")
        or not math.isfinite(size)
        or size == 0
    ):
        return UnitScale(1.0, pretty(unit))
    symbol = lead.group()
    present = 0
    if symbol not in _NATURAL and symbol[:1] in _EXPONENTS:
        present = _EXPONENTS[symbol[0]]
        symbol = symbol[1:]
    if symbol not in _NATURAL:
        return UnitScale(1.0, pretty(unit))
    decade = math.floor(math.log10(abs(size)) + 1e-9) + present
    lowest, highest = _NATURAL[symbol]
    exponent = min(max(3 * math.floor(decade / 3), lowest), highest)
    if symbol == "Hz" and 0 <= decade < 4:  # 4096 Hz reads better than 4.096 kHz
        exponent = 0
    return UnitScale(
        10.0 ** (present - exponent), pretty(_PREFIXES[exponent] + symbol + unit[lead.end() :])
    )


def amount(value: float, unit: str, digits: int = 5) -> str:
    """Return a number with its unit for a message: ``812.34 Hz``, ``1.2 µs``; no unit for one."""
    scale = scaled(unit, value)
    return f"{plain(value * scale.factor, digits)} {scale.printed}".rstrip()
