"""A file's keys checked by pydantic, and its findings as an InputError."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from vibrident.base.errors import InputError
from vibrident.data.io.keys import Key, bracketed, keys_of, section_of

_Document = TypeVar("_Document", bound=BaseModel)


def validated(
    root: type[_Document], document: Mapping[str, Any], file: str, what: str = "calibration"
) -> _Document:
    """Return the document of a ``what`` file, checked.

    InputError: a key is missing or unknown, or a value is not allowed.
    """
    try:
        return root.model_validate(document)
    except ValidationError as error:  # an unknown key precedes a missing one
        finding = min(error.errors(), key=lambda finding: finding["type"] != "extra_forbidden")
    if finding["type"] == "extra_forbidden":
        raise _unknown_key(finding, root, file)
    if finding["type"] == "missing":
        raise _missing_key(finding, root, file)
    raise _bad_value(finding, root, file, what)


def _unknown_key(finding: ErrorDetails, root: type[BaseModel], file: str) -> InputError:
    *parents, key = finding["loc"]
    section = _section_at(tuple(parents), root)
    keys = list(section.model_fields)
    elsewhere = [
        bracketed(name, each.field)
        for name, each in keys_of(root).items()
        if each.section and key in each.section.model_fields
    ]
    nearest = difflib.get_close_matches(str(key), keys, n=1, cutoff=0.0)[0]
    likely = difflib.SequenceMatcher(None, str(key), nearest).ratio() >= 0.75
    remedy = f"did you mean {nearest!r}?"
    if elsewhere and not likely:
        remedy = (
            f"{key!r} belongs under {' or '.join(elsewhere)}; the nearest key here is {nearest!r}"
        )
    return InputError(
        f"The key {key!r} is not known here.",
        expected="one of " + ", ".join(keys),
        found=str(key),
        where=_where(file, tuple(parents), root),
        remedy=remedy,
    )


def _missing_key(finding: ErrorDetails, root: type[BaseModel], file: str) -> InputError:
    *parents, key = finding["loc"]
    return InputError(
        f"The key {key!r} is missing.",
        expected=_expected(tuple(finding["loc"]), root) or "a value",
        found="nothing",
        where=_where(file, tuple(parents), root),
        remedy=f"add {key} = …",
    )


def _bad_value(finding: ErrorDetails, root: type[BaseModel], file: str, what: str) -> InputError:
    location = _known_part(finding["loc"], root)
    expected = _expected(location, root) or finding["msg"]
    text = repr(finding["input"])[:60]
    found = f"{location[-1]} = {text}" if location and isinstance(location[-1], str) else text
    return InputError(
        f"A value in the {what} file cannot be used.",
        expected=expected,
        found=found,
        where=_where(file, location, root),
        remedy="correct the value",
    )


def _known_part(location: tuple[Any, ...], root: type[BaseModel]) -> tuple[Any, ...]:
    """Drop pydantic's suffix for the branch of a union."""
    section: type[BaseModel] | None = root
    for place, part in enumerate(location):
        if isinstance(part, int):
            continue
        if section is None or part not in section.model_fields:
            return location[:place]
        section = section_of(section.model_fields[part].annotation)
    return location


def _section_at(location: tuple[Any, ...], root: type[BaseModel]) -> type[BaseModel]:
    section = root
    for part in location:
        if isinstance(part, str):
            section = section_of(section.model_fields[part].annotation) or section
    return section


def _expected(location: tuple[Any, ...], root: type[BaseModel]) -> str:
    """Return what the key at a place takes."""
    names = [part for part in location if isinstance(part, str)]
    if not names:
        return "sections in brackets"
    section = _section_at(tuple(names[:-1]), root)
    return Key(names[-1], section.model_fields[names[-1]]).expected


def _where(file: str, location: tuple[Any, ...], root: type[BaseModel]) -> str:
    """Name file, section and key."""
    if not location:
        return f"{file}, top level"
    name, *rest = location
    text = bracketed(str(name), root.model_fields[name])
    for part in rest:
        text += f" entry {part + 1}" if isinstance(part, int) else f" {part}"
    return f"{file}, {text}"
