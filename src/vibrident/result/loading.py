"""Results as arguments: the object itself, or the path of its file."""

from __future__ import annotations

import os
from pathlib import Path

from vibrident.base.errors import InputError
from vibrident.result.result import Result

#: A result, or the path of its ``result.json``.
GivenResult = Result | str | os.PathLike[str]


def as_result(source: GivenResult) -> Result:
    """Return a result, read from its file where the argument is a path.

    Args:
        source: a result, or the path of its ``result.json``.

    Raises:
        InputError: the file cannot be read or is no result; the message names the file.
    """
    if isinstance(source, Result):
        return source
    path = Path(source)
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
