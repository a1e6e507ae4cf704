"""The choice of the next batch: calibrations of one shape, about ten seconds of work by the rate measured so far."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

#: Seconds of work in a batch: long against the time to send one, short against an acceptable loss.
BATCH_S = 10.0
#: Shortest batch, in seconds: the last calibrations are divided among all workers.
_LEAST_S = 0.5
#: Most calibrations of a batch, however short they are.
MOST = 1000
#: Share of the newest batch in a shape's time.
_NEW = 0.5

Task = tuple[str, str]  # path, key


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
        self.seconds[shape] = (1 - _NEW) * self.seconds.get(shape, each) + _NEW * each

    def ahead_s(self) -> float:
        """Seconds of waiting work; a calibration of a shape without a measured time counts as one second."""
        return sum(len(tasks) * self.seconds.get(shape, 1.0) for shape, tasks in self.waiting.items())

    def take(self, workers: int) -> tuple[str, list[Task]]:
        """The next batch, of the shape with most waiting work; at least one calibration must be waiting.

        Of a shape without a measured time, the batch is one calibration.
        """
        shape = max(self.waiting, key=lambda name: len(self.waiting[name]) * self.seconds.get(name, 1.0))
        tasks, each = self.waiting[shape], self.seconds.get(shape)
        wanted_s = min(BATCH_S, max(_LEAST_S, self.ahead_s() / (2 * max(workers, 1))))
        size = 1 if each is None else max(1, min(MOST, round(wanted_s / max(each, 1e-6))))
        batch = [tasks.popleft() for _ in range(min(size, len(tasks)))]
        if not tasks:
            del self.waiting[shape]
        return shape, batch
