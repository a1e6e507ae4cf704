"""Natural order of files: by the numbers in their names."""

from __future__ import annotations

import re

#: A number or what is between two. One before "Hz", such as in ``0_05Hz`` or ``2.5 kHz``, may have a fraction.
_PIECE = re.compile(r"(\d+)(?:(?:[._,p](\d+))?[ _-]?(k?)hz)?|\D+", re.IGNORECASE)
#: A float has no more.
_MOST_DIGITS = 300
Key = tuple[tuple[tuple[int, float, str], ...], str]


def natural(name: str) -> Key:
    """Sort key under which "2 Hz" comes before "10 Hz", "0_05hz" before "0_5hz", and "500 Hz" before "1 kHz"."""
    pieces: list[tuple[int, float, str]] = []
    for found in _PIECE.finditer(name):
        whole, fraction, kilo = found.groups()
        if whole is None:
            pieces.append((0, 0.0, found.group()))
        else:
            pieces.append((1, float(f"{whole}.{fraction or 0}"[:_MOST_DIGITS]) * (1000.0 if kilo else 1.0), ""))
    return tuple(pieces), name
