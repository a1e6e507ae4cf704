"""Schedulers: threads of this process, each with a process, or workers of a Dask cluster."""

from __future__ import annotations

import abc
import contextlib
import itertools
import queue
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

from vibrident.base.cluster import PATIENCE_S, connect
from vibrident.base.errors import InputError
from vibrident.lab.fleet.batch import end_processes


@dataclass(frozen=True)
class Reply:
    """End of a call."""

    call: int  # number passed to ``submit``
    value: Any = None  # returned by the function; None if it did not return
    error: BaseException | None = None  # exception that it raised
    lost: bool = False  # True if its workers ended for an unknown reason


class Scheduler(abc.ABC):
    """Run importable functions in other threads or processes, and report their end."""

    def __init__(self) -> None:
        self._calls = itertools.count(1)
        self._replies: queue.SimpleQueue[Reply] = queue.SimpleQueue()

    @abc.abstractmethod
    def workers(self) -> int:
        """Return the number of calls that can run at present."""

    def submit(self, function: Callable[..., Any], *args: Any) -> int:
        """Submit a call of a function; the number identifies the call."""
        call = next(self._calls)
        self._begin(call, function, args)
        return call

    @abc.abstractmethod
    def _begin(self, call: int, function: Callable[..., Any], args: tuple[Any, ...]) -> None: ...

    def next_reply(self, seconds: float) -> Reply | None:
        """Return the next answer, or None if none arrives within so many seconds.

        Raises:
            InputError: no answer can arrive any more.
        """
        with contextlib.suppress(queue.Empty):
            return self._replies.get(timeout=seconds)
        return None

    @abc.abstractmethod
    def close(self, run: str) -> None:
        """End all work of this run that is still in progress."""


class LocalScheduler(Scheduler):
    """A number of processes on this machine.

    A thread waits for each. So it is known which batch a process has, and the end of one does not
    affect the others. A pool of processes (loky's, ``concurrent.futures``) is broken as a whole
    when one of them ends.
    """

    def __init__(self, workers: int) -> None:
        super().__init__()
        self._workers = workers
        self._pool = ThreadPoolExecutor(workers, thread_name_prefix="fleet")

    def workers(self) -> int:
        """Return the number of processes."""
        return self._workers

    def _begin(self, call: int, function: Callable[..., Any], args: tuple[Any, ...]) -> None:
        def reply(future: Future[Any]) -> None:
            if not future.cancelled():
                error = future.exception()
                self._replies.put(Reply(call, None if error else future.result(), error))

        self._pool.submit(function, *args).add_done_callback(reply)

    def close(self, run: str) -> None:
        """End the processes."""
        self._pool.shutdown(wait=False, cancel_futures=True)
        end_processes(run)
        self._pool.shutdown(wait=True)


class Dask(Scheduler):
    """A running Dask scheduler; each thread of its workers has a process beside it.

    Args:
        where: address, such as ``tcp://host:8786``, or the scheduler's file (``.json``).

    Raises:
        InputError: Dask is not installed, or no scheduler answers there.
    """

    #: Seconds to wait for the scheduler, and seconds for which a count of workers is reused.
    _PATIENCE_S = PATIENCE_S
    _COUNT_S = 1.0

    def __init__(self, where: str) -> None:
        super().__init__()
        self._where = where
        self._futures = {}
        self._count = 0
        self._counted = -self._COUNT_S
        self._client = connect(where, f"⟦fleet.scheduler = {where!r}⟧", self._PATIENCE_S)

    def workers(self) -> int:
        """Return the number of threads of all present workers."""
        if time.monotonic() - self._counted >= self._COUNT_S:
            with contextlib.suppress(OSError, TimeoutError):
                self._count = sum(self._client.nthreads().values())
                self._counted = time.monotonic()
        return self._count

    def _begin(self, call: int, function: Callable[..., Any], args: tuple[Any, ...]) -> None:
        future = self._client.submit(function, *args, pure=False)
        self._futures[call] = future  # Dask drops a call without a reference to its future
        future.add_done_callback(lambda done: self._replies.put(self._reply(call, done)))

    def _reply(self, call: int, future: Any) -> Reply:
        if future.status == "finished":
            return Reply(call, future.result())
        error = future.exception() if future.status == "error" else None
        if isinstance(error, ImportError):
            error = InputError(
                "The workers of the scheduler cannot load vibrident.",
                expected="vibrident installed where the workers run, in the same version",
                found=str(error),
                where=self._where,
                remedy="install it there, and start the workers again",
            )
        killed = error is None or type(error).__name__ == "KilledWorker"
        return Reply(call, None, None if killed else error, lost=killed)

    def next_reply(self, seconds: float) -> Reply | None:
        """Return the next answer, or None if none arrives within so many seconds.

        Raises:
            InputError: the connection is lost.
        """
        reply = super().next_reply(seconds)
        if self._client.status in ("closing", "closed", "connecting"):
            raise InputError(
                "The connection to the scheduler is lost.",
                expected="a scheduler that answers",
                found=f"a connection that is {self._client.status}",
                where=self._where,
                remedy=(
                    "start it and its workers again; then run the same command again: it "
                    "continues where it stopped"
                ),
            )
        if reply is not None:
            self._futures.pop(reply.call, None)
        return reply

    def close(self, run: str) -> None:
        """End the processes beside the workers, and disconnect from the scheduler."""
        with contextlib.suppress(Exception):
            self._client.cancel(list(self._futures.values()))
        with contextlib.suppress(Exception):
            self._client.run(end_processes, run)
        with contextlib.suppress(Exception):
            self._client.close(timeout=5)
