"""The mark ``unit``: the tests of a room that `make quick` runs, by what they took in such runs.

The last quick run that ran a test counts: in a run of all tests, what is made or loaded once is
paid by others. For a test that no quick run has run, the shortest of any run counts; for one that
never ran, nothing does. Durations are kept in pytest's cache, not in the repository: another
machine has others.
"""

from __future__ import annotations

import time

import pytest

MAX_UNIT_S = 0.2
#: Two processes load a room's tests in up to 5 s; this leaves `make quick` 10 s in all.
MAX_PROCESS_S = 4.0
MAX_ROOM_S = 2 * MAX_PROCESS_S
#: What pytest and its workers need for a test that does nothing.
OVERHEAD_S = 0.002
OUT_OF_TIME = "the seconds of a quick run are over"
CACHE_KEY = "vibrident/unit-durations"
PHASES = ("setup", "call")


def room(nodeid: str) -> str:
    """Return the folder of tests that a test is of: ``tests/fit``."""
    return "/".join(nodeid.partition("::")[0].split("/")[:2])


class UnitMark:
    """Plug-in of pytest that marks units by their durations, and learns these in runs of units.

    Args:
        cache: pytest's cache, which keeps the durations.
        is_quick: True if the run selects tests by this mark, and ends in time.
        is_worker: True in a worker of another process, which sees every report of its workers.
    """

    def __init__(self, cache: pytest.Cache, *, is_quick: bool = False, is_worker: bool = False) -> None:
        self.cache = cache
        self.is_quick = is_quick
        self.learns = not is_worker
        self.deadline_s = float("inf")  # on the clock of `time.monotonic`
        #: Kind of run (quick, any) → test → phase → s.
        self.durations: dict[str, dict[str, dict[str, float]]] = cache.get(CACHE_KEY, {})

    def _of(self, kind: str) -> dict[str, dict[str, float]]:
        """Return the durations that a kind of run has shown, for the caller to add to."""
        return self.durations.setdefault(kind, {})

    def _total_s(self, nodeid: str) -> float:
        """Return what a test took with its set-up; 0 s if that is unknown."""
        return sum((self._of("quick").get(nodeid) or self._of("any").get(nodeid, {})).values())

    def _place_in_time(self, item: pytest.Item) -> float:
        """Return a key that keeps the order of what quick runs have run; the shortest follow."""
        return 0.0 if item.nodeid in self._of("quick") else 1.0 + self._total_s(item.nodeid)

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Mark the shortest tests of each room, as many as a quick run has time for.

        Those that no quick run has run come last, where time may end before they start.
        """
        spent_s: dict[str, float] = {}
        candidates = [item for item in items if not item.get_closest_marker("slow")]
        for item in sorted(candidates, key=lambda item: self._total_s(item.nodeid)):
            duration_s = self._total_s(item.nodeid)
            total_s = spent_s.get(room(item.nodeid), 0.0) + duration_s + OVERHEAD_S
            if duration_s <= MAX_UNIT_S and total_s <= MAX_ROOM_S:
                spent_s[room(item.nodeid)] = total_s
                item.add_marker(pytest.mark.unit)
        if self.is_quick:
            items.sort(key=self._place_in_time)
            self.deadline_s = time.monotonic() + MAX_PROCESS_S * len(spent_s)

    def pytest_runtest_setup(self) -> None:
        """Skip what is left when the time of a quick run is over."""
        if time.monotonic() > self.deadline_s:
            pytest.skip(OUT_OF_TIME)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Learn how long a phase of a test took."""
        if not self.learns or report.when not in PHASES or OUT_OF_TIME in str(report.longrepr):
            return
        shortest = self._of("any").setdefault(report.nodeid, {})
        shortest[report.when] = min(report.duration, shortest.get(report.when, report.duration))
        if self.is_quick:
            self._of("quick").setdefault(report.nodeid, {})[report.when] = report.duration

    def pytest_sessionfinish(self) -> None:
        """Keep what was learned."""
        if self.learns:
            self.cache.set(CACHE_KEY, self.durations)
