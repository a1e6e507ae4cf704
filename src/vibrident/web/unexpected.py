"""Unexpected errors: the user gets a number, the log the traceback under the same number."""

from __future__ import annotations

import logging
import secrets
import traceback

from vibrident.errors import InputError, VibridentError
from vibrident.process import WorkerError

_LOG = logging.getLogger("vibrident.web")
_LONGEST = 20_000


def error_to_show(error: BaseException) -> VibridentError:
    """The error to show: vibrident's own unchanged; anything else is logged."""
    if isinstance(error, VibridentError):
        return error
    number = noted(error)
    return InputError(
        "Something went wrong.",
        expected="no error of the program",
        found=f"an unexpected error, number {number} in the server's log",
        remedy="your files and results are kept; try again, and report a repeated error with that number",
    )


def noted(error: BaseException) -> str:
    """Write an error to the log; returns its number."""
    number = secrets.token_hex(4)
    text = str(error) if isinstance(error, WorkerError) else "".join(traceback.format_exception(error))
    lines = ("".join(c if c.isprintable() else " " for c in line) for line in text[-_LONGEST:].splitlines())
    _LOG.error("something went wrong, %s\n%s", number, "\n".join(f"{number}  {line}" for line in lines))
    return number
