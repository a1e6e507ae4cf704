"""Which calibrations go into the next batch: of like shape, about ten seconds of work by the rate measured so far."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

#: Seconds of work in a batch: long beside what it costs to send one, short beside what may be lost.
BATCH_S = 10.0
#: Where little is left it is shared out among all workers, down to this.
_LEAST_S = 0.5
#: Most calibrations of a batch, however short they are.
MOST = 1000
#: Share of the newest batch in a shape's time.
_NEW = 0.5

Task = tuple[str, str]  # path, key


@dataclass
class Batches:
    """Calibrations that wait, by shape, and how long one of each shape takes."""

    waiting: dict[str, deque[Task]] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)

    def __len__(self) -> int:
        return sum(len(tasks) for tasks in self.waiting.values())

    def add(self, shape: str, task: Task) -> None:
        """Let a calibration wait for its turn."""
        self.waiting.setdefault(shape, deque()).append(task)

    def measured(self, shape: str, seconds: float, calibrations: int) -> None:
        """Learn from a batch that is done."""
        each = seconds / calibrations
        self.seconds[shape] = (1 - _NEW) * self.seconds.get(shape, each) + _NEW * each

    def ahead_s(self) -> float:
        """Seconds of work that wait; a shape that none was measured of counts as a second each."""
        return sum(len(tasks) * self.seconds.get(shape, 1.0) for shape, tasks in self.waiting.items())

    def take(self, workers: int) -> tuple[str, list[Task]]:
        """The next batch, of the shape that has most work waiting; there must be some.

        Of a shape that none was measured of, one calibration goes ahead.
        """
        shape = max(self.waiting, key=lambda name: len(self.waiting[name]) * self.seconds.get(name, 1.0))
        tasks, each = self.waiting[shape], self.seconds.get(shape)
        wanted_s = min(BATCH_S, max(_LEAST_S, self.ahead_s() / (2 * max(workers, 1))))
        size = 1 if each is None else max(1, min(MOST, round(wanted_s / max(each, 1e-6))))
        batch = [tasks.popleft() for _ in range(min(size, len(tasks)))]
        if not tasks:
            del self.waiting[shape]
        return shape, batch
