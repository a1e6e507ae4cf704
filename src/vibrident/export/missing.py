"""Libraries that only some formats need: loaded when the format is asked for, with the remedy where they are absent."""

from __future__ import annotations

import importlib
from typing import Any

from vibrident.errors import InputError


def library(name: str, extra: str) -> Any:
    """Import a library of an extra.

    Raises:
        InputError: it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise InputError(
            "This format needs a library that is not installed.",
            expected=name.partition(".")[0],
            found=str(error),
            where="--format",
            remedy=f"pip install 'vibrident[{extra}]'",
        ) from error
