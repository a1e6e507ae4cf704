"""Steps of a run: find, hash and identify calibrations in batches, then write table and page."""

from __future__ import annotations

import itertools
import os
import time
import uuid
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from vibrident.base import memory
from vibrident.base.errors import InputError
from vibrident.base.files import atomic_write
from vibrident.lab.fleet import parts, patterns
from vibrident.lab.fleet.batch import Done, fingerprints, lost, work_off
from vibrident.lab.fleet.key import Fingerprint
from vibrident.lab.fleet.limits import Specification
from vibrident.lab.fleet.orders import Orders
from vibrident.lab.fleet.page import write_page
from vibrident.lab.fleet.schedulers import Reply, Scheduler
from vibrident.lab.fleet.table import Tally, identified_keys, index_of, write_table
from vibrident.lab.fleet.worker import Task

BATCH_S = 10.0  # of work: long against the time to send a batch, short against an acceptable loss
_MIN_BATCH_S = 0.5  # of work: the last calibrations are divided among all workers
_MAX_BATCH_SIZE = 1000  # calibrations, however short they are
_NEWEST_SHARE = 0.5  # share of the newest batch in a shape's time


@dataclass
class Batches:
    """Waiting calibrations, by shape, and the time that one of each shape takes."""

    waiting: dict[str, deque[Task]] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    def __len__(self) -> int:
        return sum(len(tasks) for tasks in self.waiting.values())

    def add(self, shape: str, task: Task) -> None:
        """Add a calibration to the waiting ones."""
        self.waiting.setdefault(shape, deque()).append(task)

    def measured(self, shape: str, seconds: float, calibrations: int) -> None:
        """Update the time of a shape from a finished batch."""
        each = seconds / calibrations
        self.seconds[shape] = (1 - _NEWEST_SHARE) * self.seconds.get(
            shape, each
        ) + _NEWEST_SHARE * each

    def ahead_s(self) -> float:
        """Return the seconds of waiting work.

        A calibration of a shape without a measured time counts as one second.
        """
        return sum(
            len(tasks) * self.seconds.get(shape, 1.0) for shape, tasks in self.waiting.items()
        )

    def take(self, workers: int) -> tuple[str, list[Task]]:
        """Take the next batch, of the shape with most waiting work.

        At least one calibration must be waiting. Of a shape without a measured time, the batch is
        one calibration.
        """
        shape = max(
            self.waiting, key=lambda name: len(self.waiting[name]) * self.seconds.get(name, 1.0)
        )
        tasks = self.waiting[shape]
        each = self.seconds.get(shape)
        wanted_s = min(BATCH_S, max(_MIN_BATCH_S, self.ahead_s() / (2 * max(workers, 1))))
        size = (
            1 if each is None else max(1, min(_MAX_BATCH_SIZE, round(wanted_s / max(each, 1e-6))))
        )
        batch = [tasks.popleft() for _ in range(min(size, len(tasks)))]
        if not tasks:
            del self.waiting[shape]
        return shape, batch


WINDOW = 2  # calls of a worker at once: one that it works on, one that waits for it
_FIRST_HASHED_AT_ONCE = (
    8  # calibrations hashed by each of the first calls, so that work begins at once
)
_MAX_HASHED_AT_ONCE = 100  # calibrations hashed by a later call
_TURN_S = 0.5  # seconds between updates of the number of workers and of the progress
_MAX_RESENT = 4  # how often a calibration is sent again after its worker was lost
_MAX_REHASHED = 3  # how often it is hashed again after its files changed


@dataclass(frozen=True)
class RunRequest:
    """Request for a run."""

    patterns: Sequence[str]  # files, folders and globs
    orders: Orders  # how each calibration is identified, and the folder
    # limits of the parameters, by type
    specification: Specification = field(default_factory=Specification)
    fresh: bool = False  # compute everything again instead of continuing


@dataclass(frozen=True)
class RunProgress:
    """Progress of a run."""

    done: int  # calibrations that have a row, including those of earlier runs
    total: int  # calibrations
    rate: float  # calibrations finished in this run, per second
    left_s: float | None  # seconds left at that rate; None before a rate is known
    workers: int  # at work now


@dataclass(frozen=True)
class Outcome:
    """Outcome of a run."""

    tally: Tally  # of the table's rows
    files: list[Path]  # written: the table, then the page
    computed: int  # calibrations of this run, without those of equal content or of an earlier run
    left_out: int  # TOML files, in folders, that hold no section of a calibration
    seconds: float  # of the run
    folder: Path  # of the whole results

    def results(self) -> Iterator[Path]:
        """Yield the path of each identified calibration's result, each once.

        The files exist if ``results`` was set.
        """
        return (self.folder / f"{key}.json" for key in identified_keys(self.files[0]))


def run(
    request: RunRequest,
    scheduler: Scheduler,
    progress: Callable[[RunProgress], None] = lambda _: None,
) -> Outcome:
    """Identify all calibrations that are not on the disk yet; write ``fleet.parquet`` and its page.

    Args:
        request: of the run.
        scheduler: closed at the end.
        progress: called about twice a second.

    Returns:
        The outcome; the page is ``fleet.html``.

    Raises:
        InputError: a pattern names nothing, the folder cannot be written, the connection to the
            scheduler is lost, or pyarrow is not installed.
    """
    parts.arrow()  # before the work that it would come after
    begin = time.monotonic()
    began_at = time.time()
    orders = replace(
        request.orders, folder=os.path.abspath(request.orders.folder), run=uuid.uuid4().hex
    )
    try:
        named = patterns.find_files(request.patterns)
        _prepare(orders, fresh=request.fresh)
        index = index_of(orders)
        work = _Work(named, orders, set(index.keys[index.is_final].tolist()), scheduler, progress)
        del index
        try:
            work.do()
        finally:
            scheduler.close(orders.run)
        seconds = time.monotonic() - begin
        computed = work.computed
        is_hashed = work.keys != b""
        names = itertools.compress(named.paths, is_hashed.tolist())
        keys = work.keys[is_hashed]
        table = Path(orders.folder) / "fleet.parquet"
        left_out = int(np.sum(~is_hashed))
        del work
        memory.return_freed()
        tally = write_table(table, names, keys, orders)
        memory.return_freed()
        page = write_page(table.with_suffix(".html"), table, tally, request.specification, began_at)
    except OSError as error:
        raise parts.unwritable(error, orders.folder) from error
    return Outcome(tally, [table, page], computed, left_out, seconds, orders.results_folder)


def _prepare(orders: Orders, *, fresh: bool) -> None:
    orders.parts_folder.mkdir(parents=True, exist_ok=True)
    for folder, ending in ((orders.parts_folder, ".parquet"), (orders.results_folder, ".json")):
        if folder.is_dir():
            parts.remove_left(folder)
            for path in folder.glob(f"*{ending}") if fresh else ():
                if len(path.stem) == 64 and set(path.stem) <= set(
                    "0123456789abcdef"
                ):  # ours, by its name
                    path.unlink(missing_ok=True)
    if orders.results:
        orders.results_folder.mkdir(exist_ok=True)
    trial = orders.parts_folder / ".trial"
    with atomic_write(trial) as partial:
        partial.touch()
    trial.unlink(missing_ok=True)


class _Work:
    """Open calls, and the remaining work."""

    def __init__(
        self,
        named: patterns.NamedFiles,
        orders: Orders,
        finished: set[bytes],
        scheduler: Scheduler,
        progress: Callable[[RunProgress], None],
    ) -> None:
        self.named = named
        self.orders = orders
        self.scheduler = scheduler
        self.progress = progress
        self.keys = np.zeros(
            len(named.paths), dtype=parts.PACKED
        )  # empty: not hashed yet, or no calibration
        self.computed = 0
        self._lost: Counter[str] = Counter()
        self._moves: Counter[int] = Counter()
        self._finished = finished  # or on the way
        self._batches = Batches()
        self._hashing: dict[int, list[int]] = {}
        self._work: dict[int, tuple[str, list[Task]]] = {}
        self._next = 0
        self._hashed = 0
        self._waiting_for = 0
        self._begin = time.monotonic()

    def do(self) -> None:
        """Run until every calibration has a row."""
        reported_at = 0.0
        while self._next < len(self.named.paths) or self._hashing or self._batches or self._work:
            self._send()
            if (reply := self.scheduler.next_reply(_TURN_S)) is not None:
                self._take(reply)
            if time.monotonic() - reported_at >= _TURN_S:
                reported_at = time.monotonic()
                self._report_progress()
        self._report_progress()

    def _send(self) -> None:
        # an adaptive cluster starts workers only once work is submitted
        workers = max(self.scheduler.workers(), 1)
        while len(self._hashing) + len(self._work) < WINDOW * workers:
            ahead = self._batches.ahead_s() >= WINDOW * workers * BATCH_S
            if (
                self._next < len(self.named.paths)
                and not ahead
                and len(self._hashing) <= workers // 2
            ):
                size = (
                    _FIRST_HASHED_AT_ONCE
                    if self._hashed < WINDOW * _MAX_HASHED_AT_ONCE
                    else _MAX_HASHED_AT_ONCE
                )
                first = self._next
                self._next = min(self._next + size, len(self.named.paths))
                self._hash(list(range(first, self._next)))
            elif self._batches:
                shape, tasks = self._batches.take(workers)
                self._work[self.scheduler.submit(work_off, tasks, self.orders)] = (shape, tasks)
            else:
                return

    def _hash(self, indices: list[int]) -> None:
        paths = [os.path.abspath(self.named.paths[index]) for index in indices]
        self._hashing[self.scheduler.submit(fingerprints, paths, self.orders)] = indices

    def _take(self, reply: Reply) -> None:
        if reply.error is not None:
            raise reply.error
        if reply.call in self._hashing:
            indices = self._hashing.pop(reply.call)
            self._hash(indices) if reply.lost else self._take_hashes(indices, reply.value)
            return
        shape, tasks = self._work.pop(reply.call)
        if not reply.lost:
            self._done(shape, tasks, reply.value)
        elif len(tasks) == 1 and self._lost[tasks[0][1]] >= _MAX_RESENT:
            row = lost(*tasks[0], self.orders)
            part_file = parts.write_part(
                self.orders.parts_folder, [row], self.orders.time_limit_s, None
            )
            self._done(shape, tasks, Done(part_file, {row["status"]: 1}, 0.0, {}))
        else:  # in halves: one of them holds the calibration that ended the workers
            self._lost.update(key for _, key in tasks)
            middle = (len(tasks) + 1) // 2
            for half in filter(None, (tasks[:middle], tasks[middle:])):
                self._work[self.scheduler.submit(work_off, half, self.orders)] = (shape, half)

    def _take_hashes(self, indices: list[int], hashes: list[Fingerprint]) -> None:
        for index, fingerprint in zip(indices, hashes, strict=True):
            self._hashed += 1
            if self.named.in_folder[index] and not fingerprint.calibration:
                continue
            if not fingerprint.exists and os.path.exists(self.named.paths[index]):
                raise InputError(
                    "A worker does not see the calibrations.",
                    expected="the same files under the same names on all machines",
                    found="no file of that name, where the worker runs",
                    where=os.path.abspath(self.named.paths[index]),
                    remedy=(
                        "put data and output on a drive that all machines share, or start the "
                        "workers on this machine"
                    ),
                )
            self.keys[index] = key = parts.packed([fingerprint.key])[0]
            if key not in self._finished:
                self._finished.add(bytes(key))
                self._waiting_for += 1
                self._batches.add(
                    fingerprint.shape, (os.path.abspath(self.named.paths[index]), fingerprint.key)
                )

    def _done(self, shape: str, tasks: list[Task], done: Done) -> None:
        self.computed += len(tasks)
        self._waiting_for -= len(tasks)
        self._batches.measured(shape, done.seconds, len(tasks))
        for before, after in done.moved.items():
            self._moved(before, after)

    def _moved(self, before: str, after: str) -> None:
        """Hash again all calibrations of a key, as files changed after they were hashed."""
        old, new = parts.packed([before, after]).tolist()
        self._finished.discard(old)
        self._finished.add(new)
        indices = np.flatnonzero(self.keys == old).tolist()
        again = [index for index in indices if self._moves[index] < _MAX_REHASHED]
        for index in set(indices) - set(again):  # its files keep changing: use the latest row
            self.keys[index] = new
        self._moves.update(again)
        self._hashed -= len(again)
        if again:
            self._hash(again)

    def _report_progress(self) -> None:
        elapsed = time.monotonic() - self._begin
        rate = self.computed / elapsed if elapsed > 0 else 0.0
        remaining = len(self.named.paths) - self._hashed + self._waiting_for
        left_s = remaining / rate if rate > 0 else None
        workers = self.scheduler.workers()
        self.progress(
            RunProgress(
                len(self.named.paths) - remaining, len(self.named.paths), rate, left_s, workers
            )
        )
