"""A result as it is given: the object itself, or the path of its file."""

from __future__ import annotations

import os
from pathlib import Path

from vibrident.base.errors import InputError
from vibrident.result.result import Result

#: A result, or the path of its ``result.json``.
GivenResult = Result | str | os.PathLike[str]


def as_result(given: GivenResult) -> Result:
    """Return a result, read from its file where a path is given.

    Args:
        given: a result, or the path of its ``result.json``.

    Raises:
        InputError: the file cannot be read or is no result; the message names the file.
    """
    if isinstance(given, Result):
        return given
    path = Path(given)
    if path.suffix.lower() == ".toml" and path.is_file():
        raise InputError(
            "A result is needed here, not a calibration file.",
            expected="a result.json that ⟦command = identify⟧ wrote",
            found=path.name,
            where=str(path),
            remedy="name the result first and the calibration file after it, or identify first",
        )
    try:
        return Result.load(path)
    except InputError as error:
        if error.where:
            raise
        raise error.at(str(path)) from error
