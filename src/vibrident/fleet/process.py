"""A worker process seen from its parent: one calibration at a time, within limits on time and memory."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Sequence
from dataclasses import asdict
from typing import IO, Any

from vibrident.errors import InputError
from vibrident.fleet.orders import Orders, memory_limit
from vibrident.fleet.row import Row

_WORK = "from vibrident.fleet.worker import work; work()"
#: One thread of arithmetic. No plug-ins of HDF5: they are foreign code.
_SURROUNDINGS = {
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS"), "1"),
    "HDF5_PLUGIN_PRELOAD": "::",
    "XLA_PYTHON_CLIENT_PREALLOCATE": "false",  # processes share a GPU
}
#: Longest time to load the libraries, in seconds; a network drive may be slow.
_START_S = 180.0
#: A process with more memory than this, or after so many calibrations, is replaced.
_MOST_BYTES, _MOST_DONE = 1_500_000_000, 2000
_LAST_BYTES = 2000


class Died(Exception):
    """The process ended, or was ended, during a calibration.

    Attributes:
        reason: ``time``, ``memory`` or ``crash``.
        ending: how it ended, in words.
    """

    def __init__(self, reason: str, ending: str) -> None:
        super().__init__(ending)
        self.reason, self.ending = reason, ending


class Ended(Exception):
    """The process was ended and is not started again; its outcome is not needed."""


class Process:
    """A process that identifies, started when needed and restarted after it has ended. For one thread at a time.

    Attributes:
        orders: for the identification.
        memory_bytes: limit on its memory; None if there is no limit.
        ended: True once it must not be started again.
    """

    def __init__(self, orders: Orders) -> None:
        self.orders = orders
        self.memory_bytes = memory_limit(orders)
        self._process: subprocess.Popen[str] | None = None
        self._errors: IO[bytes] | None = None
        self._done = 0
        self._lock = threading.Lock()
        self.ended = False

    def identify(self, tasks: Sequence[tuple[str, str]]) -> list[Row]:
        """The rows of calibrations, each a path and its key; more than one only for a device that takes many.

        Raises:
            Died: the process ended during the calibration.
            Ended: another thread has ended it.
            InputError: the outcome cannot be written, or no process can be started.
        """
        with self._lock:
            try:
                return self._identify(tasks)
            finally:
                if self.ended:
                    self.close()

    def _identify(self, tasks: Sequence[tuple[str, str]]) -> list[Row]:
        if self.ended:
            raise Ended
        if self._process is None or self._process.poll() is not None:
            self._start()
            if self.ended:  # before there was a process to kill
                raise Ended
        answer = self._exchange({"tasks": tasks}, len(tasks) * self.orders.time_limit_s)
        if "unwritable" in answer:
            raise unwritable(answer["unwritable"], self.orders.folder)
        if "memory" in answer:
            self.close()
            raise Died("memory", "a process that asked for more")
        self._done += len(tasks)
        if self._done >= _MOST_DONE or answer["memory_bytes"] > _MOST_BYTES:
            self.close()
        return answer["rows"]

    def end(self) -> None:
        """End the process from another thread; it is not started again."""
        self.ended = True
        if (process := self._process) is not None:
            process.kill()
        if self._lock.acquire(blocking=False):  # else the thread that uses it closes it
            try:
                self.close()
            finally:
                self._lock.release()

    def close(self) -> None:
        """End the process; the next calibration starts another."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            for stream in (process.stdin, process.stdout):
                if stream is not None:
                    with contextlib.suppress(OSError):
                        stream.close()
        if self._errors is not None:
            self._errors.close()
            self._errors = None

    def _start(self) -> None:
        self.close()
        self._errors, self._done = tempfile.TemporaryFile(), 0  # noqa: SIM115  closed with the process
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", _WORK],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            encoding="ascii",
            env={**os.environ, **_SURROUNDINGS, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        )
        try:
            ready = self._exchange({"orders": asdict(self.orders), "memory_bytes": self.memory_bytes}, _START_S)
        except Died as death:
            raise self._not_started(death) from None
        if "refused" in ready:
            self.close()
            raise InputError(**ready["refused"])

    def _exchange(self, message: dict[str, Any], seconds: float) -> dict[str, Any]:
        process = self._process
        assert process is not None
        assert process.stdin is not None
        assert process.stdout is not None
        overdue = threading.Event()
        alarm = threading.Timer(seconds, lambda: (overdue.set(), process.kill()))
        alarm.daemon = True
        alarm.start()
        line = ""
        try:
            with contextlib.suppress(BrokenPipeError):
                process.stdin.write(json.dumps(message) + "\n")
                process.stdin.flush()
                line = process.stdout.readline()
        finally:
            alarm.cancel()
        if line.endswith("\n"):
            return json.loads(line)
        code = process.wait()
        if overdue.is_set():
            raise Died("time", "a process that was still at work")
        raise Died("crash", f"a process that ended with {f'signal {-code}' if code < 0 else f'status {code}'}")

    def _not_started(self, death: Died) -> InputError:
        said = ""
        if self._errors is not None:
            self._errors.seek(max(0, self._errors.seek(0, os.SEEK_END) - _LAST_BYTES))
            said = self._errors.read().decode(errors="replace").strip().rpartition("\n")[2]
        self.close()
        return InputError(
            "A process that identifies cannot be started.",
            expected=f"a Python process that loads vibrident within {_START_S:g} s",
            found=f"{death.ending}: {said}".removesuffix(": "),
            where=sys.executable,
            remedy="free memory, use fewer --workers, or a larger --memory-limit; `vibrident doctor` checks the rest",
        )


def unwritable(found: str, folder: str) -> InputError:
    """The error of a folder that cannot be written."""
    return InputError(
        "The output cannot be written.",
        expected="a folder that can be written, with room for the files",
        found=found,
        where=folder,
        remedy="free disk space or correct the permissions (remote workers need the folder under the same name), "
        "then run the same command again: it continues where it stopped",
    )
