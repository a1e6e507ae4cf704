"""Check a file's keys by pydantic, and turn its findings into an InputError."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from vibrident.base.errors import InputError, did_you_mean
from vibrident.data.io.keys import Key, keys_of

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
    raise _refusal(finding, root, file, what)


def _refusal(finding: ErrorDetails, root: type[BaseModel], file: str, what: str) -> InputError:
    keys_above, keys, section = _walk(finding["loc"], root)
    expected = keys[-1].expected if keys else "sections in brackets"
    if finding["type"] == "extra_forbidden" and section is not None:
        name = str(finding["loc"][-1])
        problem = f"The key {name!r} is not known here."
        value = name
        expected = f"one of {', '.join(section.model_fields)}"
        remedy = _likely(name, section, root)
    elif finding["type"] == "missing":
        *keys_above, name = keys_above
        problem = f"The key {name!r} is missing."
        value = "nothing"
        remedy = f"add {name} = …"
    else:
        problem = f"A value in the {what} file cannot be used."
        remedy = "correct the value"
        if finding["type"] == "literal_error" and isinstance(finding["input"], str):
            remedy = did_you_mean(finding["input"], expected.split(" | "), remedy)
        value = repr(finding["input"])[:60]
        if keys_above and isinstance(keys_above[-1], str):
            value = f"{keys_above[-1]} = {value}"
    where = f"{file}, {_words(keys_above, keys)}"
    expected = expected or finding["msg"]
    return InputError(problem, expected=expected, found=value, where=where, remedy=remedy)


def _walk(
    location: Sequence[Any], root: type[BaseModel]
) -> tuple[Sequence[Any], list[Key], type[BaseModel] | None]:
    """Return the part of a place that is known, its keys, and the section where it ends.

    What pydantic adds for the branch of a union is not known.
    """
    section: type[BaseModel] | None = root
    keys: list[Key] = []
    for number, step in enumerate(location):
        if isinstance(step, int):
            continue
        if section is None or step not in section.model_fields:
            return location[:number], keys, section
        keys.append(keys_of(section)[step])
        section = keys[-1].section
    return location, keys, section


def _likely(name: str, section: type[BaseModel], root: type[BaseModel]) -> str:
    """Return what to do about an unknown key: the nearest one, or the sections that have it."""
    nearest = difflib.get_close_matches(name, section.model_fields, n=1, cutoff=0.0)[0]
    sections = [key for key in keys_of(root).values() if key.section]
    elsewhere = [
        key.heading
        for key in sections
        if name in keys_of(key.section)  # type: ignore[arg-type]
    ]
    if not elsewhere or difflib.SequenceMatcher(None, name, nearest).ratio() >= 0.75:
        return f"did you mean {nearest!r}?"
    return f"{name!r} belongs under {' or '.join(elsewhere)}; the nearest key here is {nearest!r}"


def _words(location: Sequence[Any], keys: Sequence[Key]) -> str:
    """Return section and key in words."""
    if not location:
        return "top level"
    words = [f"entry {step + 1}" if isinstance(step, int) else str(step) for step in location[1:]]
    return " ".join([keys[0].heading, *words])
