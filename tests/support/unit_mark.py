"""The mark ``unit``: by earlier runs on this machine, the shortest tests of a room.

Which these are is learned by every run, and kept in pytest's cache, not in the repository: another
machine has other durations. What has never run counts as a unit, yet such tests get half of a run
at most: what is chosen by count and turns out too long for that is skipped. Each run teaches the
next.
"""

from __future__ import annotations

import time

import pytest

MAX_UNIT_S = 0.2
#: Two processes need 4 s each to load a room's tests: this much work leaves `make quick` 10 s in all.
MAX_ROOM_S = 7.0
#: What pytest and its workers need for a test that does nothing.
OVERHEAD_S = 0.002
#: What a test of unknown duration is thought to take: half of a room's work is room for 175 of them.
UNKNOWN_S = 0.02
#: How long a process starts them.
MAX_UNKNOWN_S = MAX_ROOM_S / 4
NEVER_TIMED = "never timed on this machine"
CACHE_KEY = "vibrident/durations"
PHASES = ("setup", "call")


class UnitMark:
    """Plug-in of pytest that learns durations, and marks tests by them.

    Args:
        cache: pytest's cache, which keeps the durations.
        learns: False in a worker of another process, which sees every report of its workers.
        only_units: True if the run selects tests by this mark.
    """

    def __init__(self, cache: pytest.Cache, *, learns: bool = True, only_units: bool = False) -> None:
        self.cache = cache
        self.learns = learns
        self.only_units = only_units
        self.first_unknown_s: float | None = None  # when the first test of unknown duration began
        #: Phase → test → shortest duration in s. What is loaded or made once is paid by one test.
        self.durations: dict[str, dict[str, float]] = cache.get(CACHE_KEY, {})

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Mark the tests that are not slow; what a file sets up once counts for each of its tests."""
        setups: dict[str, float] = {}
        for name, seconds in self.durations.get("setup", {}).items():
            file = name.partition("::")[0]
            setups[file] = max(seconds, setups.get(file, 0.0))
        calls = self.durations.get("call", {})
        own_setups = self.durations.get("setup", {})
        spent: dict[str, float] = {}  # room → s
        candidates = [item for item in items if not item.get_closest_marker("slow")]
        for item in sorted(candidates, key=lambda item: calls.get(item.nodeid, 0.0)):
            file = item.nodeid.partition("::")[0]
            room = "/".join(file.split("/")[:2])
            known = item.nodeid in calls  # the others come first
            seconds = calls.get(item.nodeid, UNKNOWN_S)
            total = spent.get(room, 0.0) + seconds + own_setups.get(item.nodeid, 0.0) + OVERHEAD_S * known
            most = MAX_ROOM_S if known else MAX_ROOM_S / 2
            if setups.get(file, 0.0) + seconds < MAX_UNIT_S and total <= most:
                spent[room] = total
                item.add_marker(pytest.mark.unit)

    def pytest_runtest_setup(self, item: pytest.Item) -> None:
        """Skip a test of unknown duration when the time for such tests is over."""
        if not self.only_units or item.nodeid in self.durations.get("call", {}):
            return
        now = time.monotonic()
        if self.first_unknown_s is None:
            self.first_unknown_s = now
        if now - self.first_unknown_s > MAX_UNKNOWN_S:
            pytest.skip(f"{NEVER_TIMED}; the next run of units goes on here")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Learn how long a phase of a test took; one that skips itself takes no longer than its last phase."""
        if not self.learns or report.when not in PHASES or NEVER_TIMED in str(report.longrepr):
            return
        for phase in {report.when, "call"} if report.skipped else {report.when}:
            seconds = self.durations.setdefault(phase, {})
            seconds[report.nodeid] = min(report.duration, seconds.get(report.nodeid, report.duration))

    def pytest_sessionfinish(self) -> None:
        """Keep what was learned."""
        if self.learns:
            self.cache.set(CACHE_KEY, self.durations)
