"""Natural order of files: by the numbers in their names."""

from __future__ import annotations

import re

#: A frequency, such as ``0_05Hz``, ``2.5 kHz`` or ``10Hz``: the part after the mark is a fraction.
_FREQUENCY = re.compile(r"(\d+)(?:[._,p](\d+))?[ _-]?(k?)hz", re.IGNORECASE)
_NUMBER = re.compile(r"\d+")
Key = tuple[tuple[tuple[int, float, str], ...], str]


def natural(name: str) -> Key:
    """Sort key under which "2 Hz" comes before "10 Hz", "0_05hz" before "0_5hz", and "500 Hz" before "1 kHz"."""
    pieces: list[tuple[int, float, str]] = []
    place = 0
    while found := _NUMBER.search(name, place):
        if before := name[place : found.start()]:
            pieces.append((0, 0.0, before))
        frequency = _FREQUENCY.match(name, found.start())
        taken = frequency or found
        pieces.append((1, _hertz(frequency) if frequency else _float(found.group()), ""))
        place = taken.end()
    if rest := name[place:]:
        pieces.append((0, 0.0, rest))
    return tuple(pieces), name


def _hertz(found: re.Match[str]) -> float:
    whole, fraction, kilo = found.groups()
    return _float(f"{whole}.{fraction or 0}") * (1000.0 if kilo else 1.0)


def _float(digits: str) -> float:
    return float(digits[:300])  # longer ones overflow
