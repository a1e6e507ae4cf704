"""Run a function in its own process, with limits on memory and time, for untrusted files.

The process protects its caller from a file's cost (memory, time) and from a crash of a native
library. It does not confine code: it runs as the same user and may read that user's files. Its
answer is data, never code.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from vibrident.base.errors import InputError
from vibrident.base.process import Limits, Process, ProcessDied

_T = TypeVar("_T")


def run(function: Callable[..., _T], *args: Any, limits: Limits) -> _T:
    """Run an importable function in a fresh process and return its result, from any thread.

    Raises:
        InputError, NotConverged: as the function does; or it needs more memory or time, or crashed
            (InputError).
        WorkerError: the function raised another error.
    """
    return _run(Process(), function, args, limits)


def call(process: Process, function: Callable[..., _T], *args: Any, limits: Limits) -> _T:
    """Run a function as :func:`run` does, in a process that stays for further calls."""
    try:
        return process.call(function, *args, limits=limits)
    except ProcessDied as death:
        raise _refusal(death, limits) from None


class WarmProcess:
    """Process that was started ahead with its libraries loaded, to run functions as ``run`` does.

    Each process runs one function. It can be used from several threads.

    Args:
        prepare: what the process does while it waits.
        wrapper: command that starts it, such as one that confines it.
    """

    def __init__(self, prepare: Callable[[], None], wrapper: Sequence[str] = ()) -> None:
        self._prepare = prepare
        self._wrapper = wrapper
        self._waiting: Process | None = None
        self._lock = threading.Lock()
        self._closed = False

    def prepare(self) -> None:
        """Start a process, unless one is waiting."""
        with self._lock:
            if not self._closed and not (self._waiting and self._waiting.alive):
                self._waiting = Process(self._prepare, wrapper=self._wrapper)
                self._waiting.start()

    def run(self, function: Callable[..., _T], *args: Any, limits: Limits) -> _T:
        """Run a function as :func:`run` does, in the waiting process."""
        with self._lock:
            process = self._waiting
            self._waiting = None
        try:
            return _run(
                process or Process(self._prepare, wrapper=self._wrapper), function, args, limits
            )
        finally:
            self.prepare()

    def close(self) -> None:
        """End the waiting process and start no other."""
        with self._lock:
            self._closed = True
            process = self._waiting
            self._waiting = None
        if process is not None:
            process.close()


def _run(
    process: Process, function: Callable[..., _T], args: tuple[Any, ...], limits: Limits
) -> _T:
    with process:
        return call(process, function, *args, limits=limits)


def _refusal(death: ProcessDied, limits: Limits) -> InputError:
    if death.reason == "crash":
        return InputError(
            "The reader of this file crashed.",
            expected="a whole file of its format",
            found=death.ending,
            remedy="export the data again, or in another format such as CSV",
        )
    expected, reason = {
        "memory": (
            f"{(limits.memory_bytes or 0) / 1e6:.0f} MB of memory",
            "a file that needs more",
        ),
        "time": (f"{limits.seconds:.3g} s", "a file that takes longer"),
    }[death.reason]
    return InputError(
        "Reading this file costs too much.",
        expected=f"at most {expected}",
        found=reason,
        remedy="give a shorter record, or use the command line of your own machine",
    )
