"""What nobody foresaw: the person is told that it happened, the log is told what, and both get the same number."""

from __future__ import annotations

import logging
import secrets
import traceback

from vibrident.errors import InputError, VibridentError
from vibrident.sandbox import WorkerError

_LOG = logging.getLogger("vibrident.web")
_LONGEST = 20_000


def foreseen(error: BaseException) -> VibridentError:
    """The error as it is shown: what was raised on purpose as it stands, anything else noted in the log."""
    if isinstance(error, VibridentError):
        return error
    number = noted(error)
    return InputError(
        "Something went wrong.",
        expected="a step without a fault of the program",
        found=f"a fault; the log of the server tells of it under {number}",
        remedy="your files and results are kept: go on, or try again; where it comes again, report it with that number",
    )


def noted(error: BaseException) -> str:
    """Write an error to the log; returns the number it has there."""
    number = secrets.token_hex(4)
    text = str(error) if isinstance(error, WorkerError) else "".join(traceback.format_exception(error))
    lines = ("".join(c if c.isprintable() else " " for c in line) for line in text[-_LONGEST:].splitlines())
    _LOG.error("something went wrong, %s\n%s", number, "\n".join(f"{number}  {line}" for line in lines))
    return number
