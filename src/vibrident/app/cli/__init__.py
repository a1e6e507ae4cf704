"""Run the command line, ``vibrident --help``.

One file a command; no arithmetic, and heavy libraries are loaded only inside commands.
"""

from __future__ import annotations

import gc
from collections.abc import Callable

from vibrident.app.cli.application import app
from vibrident.app.cli.console import make_streams_forgiving
from vibrident.app.workflow.interruption import end_on_signals
from vibrident.base.memory import keep_freed, use_one_thread

__all__ = ["app", "main"]

#: Number of new objects at which the interpreter first looks for garbage. Libraries that are loaded
#: make many objects, and no garbage.
COLLECTION_THRESHOLD_OBJECTS = 50_000


def main(page: Callable[..., None] | None = None) -> None:
    """Run the command line and exit.

    Exit codes: 0 done, 2 bad input, 3 with ``--strict`` and a warning, 130 interrupted.

    Args:
        page: what ``vibrident serve`` calls; None: there is no page.
    """
    gc.set_threshold(COLLECTION_THRESHOLD_OBJECTS)
    use_one_thread()
    keep_freed()
    end_on_signals()
    make_streams_forgiving()
    app(obj=page, prog_name="vibrident")
