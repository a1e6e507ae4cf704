"""An export format: its name, writer and options, and what it cannot hold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from vibrident.export.options import OPTIONS, Options
from vibrident.export.sensor import ExportedSensor


@dataclass(frozen=True)
class Format:
    """A format in which a sensor is written.

    Attributes:
        name: as ``--format`` names it.
        title: in a few words.
        write: (sensor, folder, options) → files. Raises InputError if the format cannot hold the sensor.
        holds: parts of a result in it.
        cannot_hold: parts of a result not in it.
        options: fields of ``Options`` specific to this or few formats; each a key of ``OPTIONS``.
        extra: extra of vibrident, or package, with its library; empty: none.
    """

    name: str
    title: str
    write: Callable[[ExportedSensor, Path, Options], list[Path]]
    holds: str
    cannot_hold: str
    options: tuple[str, ...] = ()
    extra: str = ""

    def __post_init__(self) -> None:
        for option in self.options:
            if option not in OPTIONS:
                raise ValueError(f"{option!r} is not an option of an export; there are {', '.join(OPTIONS)}")
