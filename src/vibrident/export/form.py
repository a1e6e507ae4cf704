"""Define a format of exports (name, writer, limits) and the options of an export."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from vibrident.base import extras
from vibrident.base.errors import InputError
from vibrident.base.escaping import c_comment
from vibrident.export.sensor import ExportedSensor

_NAME = re.compile(
    r"(?!(?:con|prn|aux|nul|com\d|lpt\d)\Z)[a-z][a-z0-9_]{0,40}", re.IGNORECASE | re.ASCII
)


@dataclass(frozen=True)
class Option:
    """Option of some formats, with its label on the page."""

    label: str = ""  # empty: the page does not offer it
    number: bool = False  # True for a number, False for text


#: Field of ``Options`` → option, for those of some formats only.
OPTIONS: Mapping[str, Option] = MappingProxyType(
    {
        "rate_hz": Option("Sampling rate in Hz", number=True),
        "channel": Option("Channel, NET.STA.LOC.CHA"),
        "country": Option("Country, two letters"),
        "schema": Option(),
        "online": Option(),
    }
)


@dataclass(frozen=True)
class Options:
    """Options of an export; each format uses its own."""

    # sampling rate of discrete formats; None takes the network's, if there is one
    rate_hz: float | None = None
    # band for errors and for the correction filter; None takes that of the data
    band_hz: tuple[float, float] | None = None
    without: Sequence[str] = ()  # add-ons to leave out
    name: str = "sensor"  # of files, and of what is defined in them
    schema: Path | None = None  # XSD to validate a certificate against
    country: str | None = None  # ISO 3166-1 code of the calibration laboratory, for a certificate
    # NET.STA.LOC.CHA for seismological formats; None takes codes for tests (network XX)
    channel: str | None = None
    online: bool = False  # of C: the tracker in place of the fixed filters

    def __post_init__(self) -> None:
        if not _NAME.fullmatch(self.name):
            raise InputError(
                "The name cannot be used.",
                expected=(
                    "letters, digits and _, a letter first, 41 characters at most, no device "
                    "(con, nul, …)"
                ),
                found=repr(self.name),
                where="⟦export.name⟧",
                remedy="choose another",
            )


def library(name: str, extra: str) -> Any:
    """Import a library that only some formats need, from an extra.

    Raises:
        InputError: it is not installed.
    """
    return extras.library(
        name, extra, "This format needs a library that is not installed.", "⟦export.form⟧"
    )


def template(name: str) -> str:
    """Return the text around the numbers of a written file, from the folder of templates."""
    return (Path(__file__).parent / "templates" / name).read_text(encoding="utf-8")


def fill_template(name: str, values: Mapping[str, str]) -> str:
    """Replace ``@KEY@`` in a template by values, in one pass: inserted text is no template."""
    return re.sub("@(\\w+)@", lambda match: values[match[1]], template(name))


def write_c_comment(lines: Iterable[str]) -> str:
    """Return lines as the middle of a C comment."""
    return "\n".join(f" * {c_comment(line)}".rstrip() for line in lines)


@dataclass(frozen=True)
class Format:
    """Format in which a sensor is written."""

    name: str  # as a user names it
    title: str  # in a few words
    # (sensor, folder, options) → files. Raises InputError if the format cannot hold the sensor
    write: Callable[[ExportedSensor, Path, Options], list[Path]]
    contents: str  # parts of a result in it
    cannot_hold: str  # parts of a result not in it
    # fields of ``Options`` specific to this or few formats; each a key of ``OPTIONS``
    options: tuple[str, ...] = ()
    extra: str = ""  # extra of vibrident, or package, with its library; empty: none

    def __post_init__(self) -> None:
        for option in self.options:
            if option not in OPTIONS:
                raise ValueError(
                    f"{option!r} is not an option of an export; there are {', '.join(OPTIONS)}"
                )
