"""The command line: ``vibrident --help``. One file a command; no arithmetic, heavy libraries only inside commands."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType

from vibrident.cli.application import app
from vibrident.cli.console import forgiving_streams
from vibrident.cli.folder import discard_unfinished

__all__ = ["app", "main"]


def main() -> None:
    """Run the command line and exit: 0 done, 2 bad input, 3 with ``--strict`` and a warning, 130 interrupted."""
    forgiving_streams()
    signal.signal(signal.SIGTERM, _terminated)
    try:
        app()
    except KeyboardInterrupt:  # outside a command: while something is loaded or written at the end
        sys.exit(130)


def _terminated(number: int, frame: FrameType | None) -> None:
    """Leave nothing half-written and die of the signal. An exception could be lost in a callback or an import."""
    discard_unfinished()
    signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)
