"""Optional libraries: loaded on demand, with the remedy if one is missing."""

from __future__ import annotations

import importlib.util
import warnings
from typing import Any

from vibrident.base.errors import InputError


def library(name: str, extra: str, problem: str, where: str) -> Any:
    """Import a library, by the dotted name of a module, of an extra, without its deprecation warnings.

    ``problem``: what its absence means; ``where``: the file or option that needs it.

    Raises:
        InputError: it is not installed.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return importlib.import_module(name)
    except ImportError as error:
        raise _missing(name, extra, problem, where, str(error)) from error


def require(name: str, extra: str, problem: str, where: str) -> None:
    """Refuse to go on without a library, which is not loaded; arguments and errors as :func:`library`."""
    if importlib.util.find_spec(name) is None:
        raise _missing(name, extra, problem, where, f"No module named {name!r}")


def _missing(name: str, extra: str, problem: str, where: str, found: str) -> InputError:
    return InputError(
        problem,
        expected=name.partition(".")[0],
        found=found,
        where=where,
        remedy=f"⟦install = vibrident[{extra}]⟧",
    )
