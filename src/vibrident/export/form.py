"""What an export format is to the rest: its name, what it writes, which options it reads, what it cannot hold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from vibrident.export.options import OPTIONS, Options
from vibrident.export.sensor import Sensor


@dataclass(frozen=True)
class Format:
    """A form in which a sensor is written.

    Attributes:
        name: as ``--format`` names it.
        title: what it is, in a few words.
        write: (sensor, folder, options) → files. It raises InputError where the form cannot hold the sensor.
        holds: what of a result is in it.
        cannot_hold: what of a result is not.
        options: fields of ``Options`` that concern this form alone or few others; each a key of ``OPTIONS``.
        extra: extra of vibrident, or package, that brings the library it needs; empty: it needs none.
    """

    name: str
    title: str
    write: Callable[[Sensor, Path, Options], list[Path]]
    holds: str
    cannot_hold: str
    options: tuple[str, ...] = ()
    extra: str = ""

    def __post_init__(self) -> None:
        for option in self.options:
            if option not in OPTIONS:
                raise ValueError(f"{option!r} is no option of an export; there are {', '.join(OPTIONS)}")
