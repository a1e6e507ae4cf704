"""Optional libraries of file formats: loaded when such a file is opened, with the remedy if one is missing."""

from __future__ import annotations

import gc
import sys
import traceback
import warnings
from pathlib import Path
from typing import Any

from vibrident import extras


def library(name: str, extra: str, path: Path) -> Any:
    """Import a library of an extra.

    Args:
        name: dotted name of the module.
        extra: the extra of this package that installs it.
        path: the file that needs it, for the message.

    Raises:
        InputError: it is not installed.
    """
    return extras.library(name, extra, "This file format needs a library that is not installed.", str(path))


def drop_failed(error: BaseException) -> None:
    """Collect half-made objects of a failed library, whose destructors raise warnings."""
    hook = sys.unraisablehook
    sys.unraisablehook = lambda _: None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            cause: BaseException | None = error
            while cause is not None:
                traceback.clear_frames(cause.__traceback__)
                cause = cause.__context__
            gc.collect()  # some are reference cycles
    finally:
        sys.unraisablehook = hook
