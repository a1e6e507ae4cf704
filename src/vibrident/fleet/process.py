"""A process that identifies, as its owner sees it: one calibration at a time, within limits on time and memory."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from vibrident.errors import InputError
from vibrident.fleet import worker
from vibrident.fleet.key import Fingerprint
from vibrident.fleet.orders import Orders, memory_limit
from vibrident.fleet.row import Row
from vibrident.process import Died, Limits, Process, WorkerError

#: Longest time to load the libraries, in seconds; a network drive may be slow.
_START_S = 180.0
#: Longest time to hash some calibrations, in seconds: a drive may be very slow.
_HASHING_S = 36_000.0
#: Seconds without a call after which it ends: on a cluster the run may be lost unnoticed.
_IDLE_S = 120.0
#: A process with more memory than this is replaced.
_MOST_BYTES = 1_500_000_000
#: A process is replaced after so many calibrations.
_MOST_DONE = 2000


class Identifier:
    """A process that identifies, started when needed and again after it has ended. For one thread at a time.

    Attributes:
        orders: for the identification.
        memory_bytes: limit on its memory; None if there is no limit.
        ended: True once it must not be started again.
    """

    def __init__(self, orders: Orders) -> None:
        self.orders = orders
        self.memory_bytes = memory_limit(orders)
        self.ended = False
        self._process = Process(idle_s=_IDLE_S)
        self._done = 0

    def fingerprints(self, paths: Sequence[str]) -> list[Fingerprint]:
        """Key and shape of each calibration; errors as of ``identify``."""
        if not self._process.alive:
            self._start()
        return self._process.call(worker.fingerprints, paths, self.orders, limits=Limits(_HASHING_S, self.memory_bytes))

    def identify(self, tasks: Sequence[tuple[str, str]]) -> list[Row]:
        """The rows of calibrations, each a path and its key; more than one only for a device that takes many.

        Raises:
            Died: the process ended during the calibration.
            Ended: another thread has ended it.
            InputError: the outcome cannot be written, or no process can be started.
        """
        if not self._process.alive:
            self._start()
        limits = Limits(len(tasks) * self.orders.time_limit_s, self.memory_bytes)
        try:
            rows, held_bytes = self._process.call(worker.identified, tasks, self.orders, limits=limits)
        except WorkerError as error:
            raise Died("crash", f"a process that failed: {str(error).strip().rpartition(chr(10))[2]}") from error
        self._done += len(tasks)
        if self._done >= _MOST_DONE or held_bytes > _MOST_BYTES:
            self.close()
        return rows

    def end(self) -> None:
        """End the process from another thread; it is not started again."""
        self.ended = True
        self._process.end()

    def close(self) -> None:
        """End the process; the next calibration starts another."""
        self._process.close()

    def _start(self) -> None:
        self._done = 0
        try:
            self._process.call(worker.ready, self.orders.device, limits=Limits(_START_S, self.memory_bytes))
        except (Died, OSError) as death:
            printed = death.printed if isinstance(death, Died) else ""
            ending = death.ending if isinstance(death, Died) else str(death)
            raise InputError(
                "A process that identifies cannot be started.",
                expected=f"a Python process that loads vibrident within {_START_S:g} s",
                found=f"{ending}: {printed.rpartition(chr(10))[2]}".removesuffix(": "),
                where=sys.executable,
                remedy="free memory, use fewer --workers, or a larger --memory-limit; "
                "`vibrident doctor` checks the rest",
            ) from death
