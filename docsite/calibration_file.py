"""The calibration file: an example in words, and every key from the fields that state it."""

from __future__ import annotations

from pydantic import BaseModel

from docsite.tables import page, table
from vibrident.data.io.calibration_file import CalibrationFile
from vibrident.data.io.certificate import CertificateSection
from vibrident.data.io.keys import Key, keys_of
from vibrident.show.language import ENGLISH


def calibration_file() -> str:
    """Return the page with a table of keys for each section."""
    return page("calibration-file.md", "\n\n".join(_sections(CalibrationFile, "")))


def _sections(section: type[BaseModel], prefix: str) -> list[str]:
    parts: list[str] = []
    for name, key in keys_of(section).items():
        if key.section is None:
            continue
        heading = f"[[{prefix}{name}]]" if key.kind == "entries" else f"[{prefix}{name}]"
        about = (key.section.__doc__ or "").split(": ", 1)[-1].split("; see ")[0].strip()
        description = "" if about.startswith("[") else about[:1].upper() + about[1:]
        parts += [f"### {heading}", description, _keys(key.section)]
        parts += _sections(key.section, f"{prefix}{name}.")
    return parts


def _keys(section: type[BaseModel]) -> str:
    printed = section is CertificateSection  # its words are in four languages
    rows = [
        (
            f"`{name}`",
            " ".join(filter(None, (_words(key, printed), key.about))),
            key.unit or "–",
            key.expected,
            _default(key),
        )
        for name, key in keys_of(section).items()
        if key.section is None
    ]
    return table(("key", "meaning", "unit", "value", "without it"), rows)


def _words(key: Key, printed: bool) -> str:
    return str(ENGLISH("label", key.name)) + "." if printed else f"{key.title}."


def _default(key: Key) -> str:
    default = key.default
    if default is ...:
        return "required"
    return "–" if default in (None, "") else f"`{default!r}`".replace("'", '"')
