"""Run a fleet: find, hash and identify calibrations in batches, then write table and page."""

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

#: Seconds of work of a batch: much longer than it takes to send, short enough to be lost.
BATCH_S = 10.0
#: Seconds of work of the shortest batches, in which the last calibrations are divided.
_MIN_BATCH_S = 0.5
_MAX_BATCH_SIZE = 1000  # calibrations
_NEWEST_WEIGHT = 0.5  # of the newest batch in the time of a shape
_GUESSED_S = 1.0  # time of a calibration whose shape has not been measured
WINDOW = 2  # calls of a worker at once: one that it works on, one that waits for it
_FIRST_HASHES = 8  # calibrations hashed by each of the first calls, so that work begins at once
_MAX_HASHES = 100  # calibrations hashed by a later call
_REPORT_INTERVAL_S = 0.5  # between updates of the number of workers and of the progress
_MAX_RESENT = 4  # how often a calibration is sent again after its worker was lost
_MAX_REHASHED = 3  # how often it is hashed again after its files changed
_HEX_DIGITS = frozenset("0123456789abcdef")
_KEY_DIGITS = 64


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

    def update_time(self, shape: str, seconds: float, calibrations: int) -> None:
        """Update the time of a shape from a finished batch."""
        newest = seconds / calibrations
        previous = self.seconds.get(shape, newest)
        self.seconds[shape] = (1 - _NEWEST_WEIGHT) * previous + _NEWEST_WEIGHT * newest

    def _waiting_s(self, shape: str) -> float:
        return len(self.waiting[shape]) * self.seconds.get(shape, _GUESSED_S)

    def ahead_s(self) -> float:
        """Return the seconds of waiting work."""
        return sum(map(self._waiting_s, self.waiting))

    def take(self, workers: int) -> tuple[str, list[Task]]:
        """Remove the next batch, of the shape with most waiting work, and return it.

        At least one calibration must be waiting. The first batch of a shape is one calibration,
        which measures its time.
        """
        shape = max(self.waiting, key=self._waiting_s)
        tasks = self.waiting[shape]
        size = 1
        if shape in self.seconds:
            batch_s = min(BATCH_S, max(_MIN_BATCH_S, self.ahead_s() / (2 * max(workers, 1))))
            size = round(batch_s / max(self.seconds[shape], 1e-6))
            size = max(1, min(_MAX_BATCH_SIZE, size, len(tasks)))
        batch = [tasks.popleft() for _ in range(size)]
        if not tasks:
            del self.waiting[shape]
        return shape, batch


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

    done: int  # calibrations with a row, including those of earlier runs
    total: int  # calibrations
    rate: float  # calibrations finished in this run, per second
    left_s: float | None  # remaining seconds at that rate; None before a rate is known
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
    parts.arrow()  # refuse now, not after the work
    begin = time.monotonic()
    began_at = time.time()
    folder = os.path.abspath(request.orders.folder)
    orders = replace(request.orders, folder=folder, run=uuid.uuid4().hex)
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
        del work
        memory.return_freed()
        table = Path(folder) / "fleet.parquet"
        tally = write_table(table, names, keys, orders)
        memory.return_freed()
        page = write_page(table.with_suffix(".html"), table, tally, request.specification, began_at)
    except OSError as error:
        raise parts.unwritable(error, folder) from error
    left_out = int(np.sum(~is_hashed))
    return Outcome(tally, [table, page], computed, left_out, seconds, orders.results_folder)


def _prepare(orders: Orders, *, fresh: bool) -> None:
    """Make the folders, remove what earlier runs left, and check that files can be written.

    ``fresh``: whether to remove all rows and results, too.
    """
    orders.parts_folder.mkdir(parents=True, exist_ok=True)
    for folder, ending in ((orders.parts_folder, ".parquet"), (orders.results_folder, ".json")):
        if folder.is_dir():
            parts.remove_left(folder)
            for path in folder.glob(f"*{ending}") if fresh else ():
                if len(path.stem) == _KEY_DIGITS and _HEX_DIGITS.issuperset(path.stem):
                    path.unlink(missing_ok=True)  # a file of ours, by its name
    if orders.results:
        orders.results_folder.mkdir(exist_ok=True)
    trial = orders.parts_folder / ".trial"
    with atomic_write(trial) as partial:
        partial.touch()
    trial.unlink(missing_ok=True)


class _Work:
    """Work of a run: calls on their way to workers, and calibrations that wait.

    Attributes:
        keys: of the calibrations; empty where one is not hashed yet, or is no calibration.
        computed: number of calibrations that this run has finished.
    """

    def __init__(
        self,
        named: patterns.NamedFiles,
        orders: Orders,
        finished: set[bytes],
        scheduler: Scheduler,
        progress: Callable[[RunProgress], None],
    ) -> None:
        self.keys = np.zeros(len(named.paths), dtype=parts.PACKED)
        self.computed = 0
        self._named = named
        self._orders = orders
        self._scheduler = scheduler
        self._progress = progress
        self._losses: Counter[str] = Counter()  # lost workers by key
        self._rehashed: Counter[int] = Counter()  # by index
        self._known_keys = finished  # or on the way
        self._batches = Batches()
        self._hash_calls: dict[int, list[int]] = {}
        self._work_calls: dict[int, tuple[str, list[Task]]] = {}
        self._next = 0  # index of the first calibration that no call hashes yet
        self._hashed = 0
        self._unfinished = 0
        self._begin = time.monotonic()

    def do(self) -> None:
        """Run until every calibration has a row."""
        reported_at = 0.0
        while self._is_unhashed or self._hash_calls or self._batches or self._work_calls:
            self._send()
            if (reply := self._scheduler.next_reply(_REPORT_INTERVAL_S)) is not None:
                self._receive(reply)
            if time.monotonic() - reported_at >= _REPORT_INTERVAL_S:
                reported_at = time.monotonic()
                self._report_progress()
        self._report_progress()

    @property
    def _is_unhashed(self) -> bool:
        return self._next < len(self._named.paths)

    def _send(self) -> None:
        """Submit calls until every worker has enough: to hash calibrations, or to identify some."""
        # an adaptive cluster starts workers only once work is submitted
        workers = max(self._scheduler.workers(), 1)
        while len(self._hash_calls) + len(self._work_calls) < WINDOW * workers:
            needs_work = self._batches.ahead_s() < WINDOW * workers * BATCH_S
            if self._is_unhashed and needs_work and len(self._hash_calls) <= workers // 2:
                size = _FIRST_HASHES if self._hashed < WINDOW * _MAX_HASHES else _MAX_HASHES
                first = self._next
                self._next = min(first + size, len(self._named.paths))
                self._submit_hashes(list(range(first, self._next)))
            elif self._batches:
                self._submit_work(*self._batches.take(workers))
            else:
                return

    def _path(self, index: int) -> str:
        return os.path.abspath(self._named.paths[index])

    def _submit_hashes(self, indices: list[int]) -> None:
        paths = [self._path(index) for index in indices]
        self._hash_calls[self._scheduler.submit(fingerprints, paths, self._orders)] = indices

    def _submit_work(self, shape: str, tasks: list[Task]) -> None:
        self._work_calls[self._scheduler.submit(work_off, tasks, self._orders)] = (shape, tasks)

    def _receive(self, reply: Reply) -> None:
        """Store a reply, or send its call again if the worker was lost."""
        if reply.error is not None:
            raise reply.error
        if reply.call in self._hash_calls:
            indices = self._hash_calls.pop(reply.call)
            if reply.lost:
                self._submit_hashes(indices)
            else:
                self._store_hashes(indices, reply.value)
            return
        shape, tasks = self._work_calls.pop(reply.call)
        if not reply.lost:
            self._finish(shape, tasks, reply.value)
        elif len(tasks) == 1 and self._losses[tasks[0][1]] >= _MAX_RESENT:
            row = lost(*tasks[0], self._orders)
            limit_s = self._orders.time_limit_s
            part_file = parts.write_part(self._orders.parts_folder, [row], limit_s, None)
            self._finish(shape, tasks, Done(part_file, {row["status"]: 1}, 0.0, {}))
        else:  # in halves: one of them holds the calibration that ended the workers
            self._losses.update(key for _, key in tasks)
            middle = (len(tasks) + 1) // 2
            for half in filter(None, (tasks[:middle], tasks[middle:])):
                self._submit_work(shape, half)

    def _store_hashes(self, indices: list[int], hashes: list[Fingerprint]) -> None:
        """Store the keys of calibrations, and let those wait whose key is new."""
        self._hashed += len(indices)
        for index, fingerprint in zip(indices, hashes, strict=True):
            path = self._path(index)
            if self._named.in_folder[index] and not fingerprint.calibration:
                continue
            if not fingerprint.exists and os.path.exists(path):
                raise InputError(
                    "A worker does not see the calibrations.",
                    expected="the same files under the same names on all machines",
                    found="no file of that name, where the worker runs",
                    where=path,
                    remedy="put data and output on a drive that all machines share, or start the "
                    "workers on this machine",
                )
            self.keys[index] = key = parts.packed([fingerprint.key])[0]
            if key not in self._known_keys:
                self._known_keys.add(bytes(key))
                self._unfinished += 1
                self._batches.add(fingerprint.shape, (path, fingerprint.key))

    def _finish(self, shape: str, tasks: list[Task], done: Done) -> None:
        """Count finished calibrations; hash those again whose files have changed."""
        self.computed += len(tasks)
        self._unfinished -= len(tasks)
        self._batches.update_time(shape, done.seconds, len(tasks))
        for old_key, new_key in done.moved.items():
            self._change_key(old_key, new_key)

    def _change_key(self, old_key: str, new_key: str) -> None:
        """Hash all calibrations of a key again, as files changed after they were hashed."""
        old, new = parts.packed([old_key, new_key]).tolist()
        self._known_keys.discard(old)
        self._known_keys.add(new)
        rehashed = []
        for index in np.flatnonzero(self.keys == old).tolist():
            if self._rehashed[index] < _MAX_REHASHED:
                rehashed.append(index)
            else:  # its files keep changing: use the latest row
                self.keys[index] = new
        self._rehashed.update(rehashed)
        self._hashed -= len(rehashed)
        if rehashed:
            self._submit_hashes(rehashed)

    def _report_progress(self) -> None:
        elapsed_s = time.monotonic() - self._begin
        rate = self.computed / elapsed_s if elapsed_s > 0 else 0.0
        total = len(self._named.paths)
        remaining = total - self._hashed + self._unfinished
        left_s = remaining / rate if rate > 0 else None
        workers = self._scheduler.workers()
        self._progress(RunProgress(total - remaining, total, rate, left_s, workers))
