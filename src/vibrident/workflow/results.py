"""Reading a result file; errors name it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from vibrident.errors import InputError

if TYPE_CHECKING:
    from vibrident.result import Result


def load_result(path: Path) -> Result:
    """Read a result.

    Raises:
        InputError: the file cannot be read or is not a result.
    """
    from vibrident.result import Result

    if path.suffix.lower() == ".toml" and os.path.isfile(path):
        raise InputError(
            "A result is needed here, not a calibration file.",
            expected="a result.json that `vibrident identify` wrote",
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
