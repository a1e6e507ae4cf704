"""Libraries that only some formats need."""

from __future__ import annotations

from typing import Any

from vibrident import extras


def library(name: str, extra: str) -> Any:
    """Import a library of an extra.

    Raises:
        InputError: it is not installed.
    """
    return extras.library(name, extra, "This format needs a library that is not installed.", "--format")
