"""Tidy up and end at once on Ctrl-C and SIGTERM.

No exception is raised: inside JAX it may be lost in a callback or crash the process, leaving
half-written files.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
from collections.abc import Callable, Iterator
from types import FrameType

_tidy_ups: list[Callable[[], None]] = []


@contextlib.contextmanager
def tidied_up(tidy_up: Callable[[], None]) -> Iterator[None]:
    """Call ``tidy_up`` if the process is ended within the block.

    It must neither wait nor take a lock.
    """
    _tidy_ups.append(tidy_up)
    try:
        yield
    finally:
        _tidy_ups.remove(tidy_up)


def end_on_signals() -> None:
    """End on termination signals, with exit code 128 plus their number."""
    for number in (signal.SIGINT, signal.SIGTERM):
        # a shell's background job ignores Ctrl-C
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _end)


def _end(number: int, frame: FrameType | None) -> None:
    for tidy_up in reversed(_tidy_ups):
        with contextlib.suppress(Exception):
            tidy_up()
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):
            stream.flush()
    os._exit(128 + number)
