"""Work of a scheduler's worker: hash calibrations, and identify a batch of them in a process.

The process receives one calibration at a time, so it is known which one ended it. That one is tried
alone in a new process. If it ends that too, its row says so. Another process continues the batch.
"""

from __future__ import annotations

import sys
import threading
import weakref
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from vibrident.base.errors import InputError
from vibrident.base.fields import NamedTexts
from vibrident.base.process import Limits, Process, ProcessDied, WorkerError
from vibrident.base.version import __version__
from vibrident.lab.fleet import key as keys
from vibrident.lab.fleet import row as rows
from vibrident.lab.fleet import worker
from vibrident.lab.fleet.key import Fingerprint
from vibrident.lab.fleet.orders import Orders, memory_limit
from vibrident.lab.fleet.parts import unwritable, write_part
from vibrident.lab.fleet.row import Row
from vibrident.lab.fleet.worker import Task

_START_S = 180.0  # longest time to load the libraries, in seconds; a network drive may be slow
_HASHING_S = (
    36_000.0  # longest time to hash some calibrations, in seconds: a drive may be very slow
)
_IDLE_S = (
    120.0  # seconds without a call after which it ends: on a cluster the run may be lost unnoticed
)
_MAX_PART_BYTES = 1_500_000_000  # A process with more memory than this is replaced
_MAX_CALIBRATIONS = 2000  # A process is replaced after so many calibrations


class Identifier:
    """Process that identifies, started when needed and again after it has ended.

    It is for one thread at a time.
    """

    def __init__(self, orders: Orders) -> None:
        self.orders: Orders = orders
        self.memory_bytes: int | None = memory_limit(orders)  # None if there is no limit
        self.ended: bool = False  # True once it must not be started again
        self._process = Process(idle_s=_IDLE_S)
        self._done = 0

    def fingerprints(self, paths: Sequence[str]) -> list[Fingerprint]:
        """Return key and shape of each calibration; errors as of ``identify``."""
        if not self._process.alive:
            self._start()
        return self._process.call(
            worker.fingerprints, paths, self.orders, limits=Limits(_HASHING_S, self.memory_bytes)
        )

    def identify(self, task: Task) -> Row:
        """Return the row of a calibration, a path and its key.

        Raises:
            Died: the process ended during the calibration.
            Ended: another thread has ended it.
            InputError: the outcome cannot be written, or no process can be started.
        """
        if not self._process.alive:
            self._start()
        limits = Limits(self.orders.time_limit_s, self.memory_bytes)
        try:
            row, held_bytes = self._process.call(
                worker.identified, task, self.orders, limits=limits
            )
        except WorkerError as error:
            raise ProcessDied(
                "crash", f"a process that failed: {str(error).strip().rpartition(chr(10))[2]}"
            ) from error
        self._done += 1
        if self._done >= _MAX_CALIBRATIONS or held_bytes > _MAX_PART_BYTES:
            self.close()
        return row

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
            self._process.call(worker.ready, limits=Limits(_START_S, self.memory_bytes))
        except (ProcessDied, OSError) as death:
            printed = death.printed if isinstance(death, ProcessDied) else ""
            ending = death.ending if isinstance(death, ProcessDied) else str(death)
            raise InputError(
                "A process that identifies cannot be started.",
                expected=f"a Python process that loads vibrident within {_START_S:g} s",
                found=f"{ending}: {printed.rpartition(chr(10))[2]}".removesuffix(": "),
                where=sys.executable,
                remedy=(
                    "free memory, use fewer ⟦fleet.workers⟧, or a larger "
                    "⟦fleet.memory_limit_bytes⟧; ⟦command = doctor⟧ checks the rest"
                ),
            ) from death


_ATTEMPTS_ALONE = (
    2  # attempts for a calibration alone: the process may have been ended from outside
)
_PROBLEMS = {
    "time": (
        "Identifying this calibration takes too long.",
        "fewer or shorter records, or a larger ⟦fleet.time_limit_s⟧",
    ),
    "memory": (
        "Identifying this calibration takes too much memory.",
        "shorter records, or a larger ⟦fleet.memory_limit_bytes⟧",
    ),
    "crash": (
        "Identifying this calibration ends its process, also alone.",
        "check that its data files are whole: export them again, or in another format such as CSV",
    ),
}

_local = threading.local()
_processes: weakref.WeakSet[Identifier] = weakref.WeakSet()


@dataclass(frozen=True)
class Done:
    """Summary of a batch; its rows are on the disk."""

    part_file: str  # name of the file with the rows
    statuses: dict[str, int]  # number of rows by status
    seconds: float  # duration of the batch
    # former key → key now, of calibrations whose files changed meanwhile
    moved: NamedTexts


def fingerprints(paths: Sequence[str], orders: Orders) -> list[Fingerprint]:
    """Return key and shape of each calibration, by this thread's process.

    Threads of a coordinator would share one core.
    """
    process = _process(orders)
    try:
        return process.fingerprints(paths)
    except ProcessDied:
        process.close()
        return [keys.fingerprint(path, orders) for path in paths]


def work_off(tasks: Sequence[Task], orders: Orders) -> Done:
    """Identify calibrations, each a path and its key, and write their rows.

    Raises:
        InputError: the outcomes cannot be written, or no process can be started.
    """
    process = _process(orders)
    rows = [_row(process, task) for task in tasks]
    try:
        part_file = write_part(orders.parts_folder, rows, orders.time_limit_s, process.memory_bytes)
    except OSError as error:
        raise unwritable(error, orders.folder) from error
    moved = {
        key: row["key"] for (_, key), row in zip(tasks, rows, strict=True) if row["key"] != key
    }
    seconds = sum(row["seconds"] for row in rows)
    return Done(part_file, dict(Counter(row["status"] for row in rows)), seconds, moved)


def end_processes(run: str) -> None:
    """End the processes that were started here for a run."""
    for process in list(_processes):
        if process.orders.run == run:
            process.end()


def _process(orders: Orders) -> Identifier:
    """Return this thread's process; a new one if the orders differ."""
    _require_same_version(orders)
    process: Identifier | None = getattr(_local, "process", None)
    if process is None or process.ended or process.orders != orders:
        if process is not None:
            process.close()
        process = _local.process = Identifier(orders)
        _processes.add(process)
    return process


def _row(process: Identifier, task: Task) -> Row:
    for _ in range(1 + _ATTEMPTS_ALONE):
        try:
            return process.identify(task)
        except ProcessDied as death:
            last = death
            process.close()
            if death.reason == "time":
                break
    return _killed(last, process.orders, *task)


def lost(path: str, key: str, orders: Orders) -> Row:
    """Return the row of a calibration whose workers were lost repeatedly."""
    return _killed(
        ProcessDied("crash", "workers that were lost with it, several times"), orders, path, key
    )


def _killed(death: ProcessDied, orders: Orders, path: str, key: str) -> Row:
    problem, remedy = _PROBLEMS[death.reason]
    memory_bytes = memory_limit(orders) or 0
    limits = {
        "time": f"at most {orders.time_limit_s:g} s",
        "memory": f"at most {memory_bytes / 1e6:.0f} MB",
    }
    error = InputError(
        problem,
        expected=limits.get(death.reason, "a calibration that a process survives"),
        found=death.ending,
        where=Path(path).name,
        remedy=remedy,
    )
    seconds = orders.time_limit_s if death.reason == "time" else 0.0
    return rows.failed(key, error, keys.sensor_text(path), orders.model, seconds)


def _require_same_version(orders: Orders) -> None:
    if orders.version != __version__:
        raise InputError(
            "A worker has another version of vibrident.",
            expected=orders.version,
            found=__version__,
            where="worker of the scheduler",
            remedy="install the same version on all machines, and start the workers again",
        )
