"""Withdrawal of public names.

A withdrawn name works as before for one minor version at least, and warns each caller.
"""

from __future__ import annotations

import warnings


def warn_withdrawn(name: str, *, removed_in: str, instead: str, stack_level: int = 3) -> None:
    """Warn the caller of a public name, or of an argument, that it will be removed.

    Args:
        name: as a user writes it, such as ``vibrident.read(path, strict=…)``.
        removed_in: version that has it no more, such as ``1.2``.
        instead: what to write in its place.
        stack_level: frames up to the line to blame; 3: who called the function that calls this one.
    """
    text = f"{name} is deprecated and will be removed in vibrident {removed_in}: use {instead}."
    warnings.warn(text, DeprecationWarning, stacklevel=stack_level)
