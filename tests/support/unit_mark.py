"""The mark ``unit``: by earlier runs on this machine, the shortest tests of a room.

Which these are is learned by every run, and kept in pytest's cache, not in the repository: another
machine has other durations. What has never run counts as a unit. A run of units starts such tests
for a few seconds and skips the others; each run teaches the next.
"""

from __future__ import annotations

import time

import pytest

MAX_UNIT_S = 0.2
#: Two processes need 4 s each to load a room's tests: this much work leaves `make quick` 10 s in all.
MAX_ROOM_S = 8.0
#: What pytest and its workers need for a test that does nothing.
OVERHEAD_S = 0.002
#: How long a process starts tests of unknown duration.
MAX_UNKNOWN_S = 4.0
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

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Mark the tests; what a file sets up once counts for each of its tests."""
        setups: dict[str, float] = {}
        for name, seconds in self.durations.get("setup", {}).items():
            file = name.partition("::")[0]
            setups[file] = max(seconds, setups.get(file, 0.0))
        calls = self.durations.get("call", {})
        own_setups = self.durations.get("setup", {})
        spent: dict[str, float] = {}  # room → s
        for item in sorted(items, key=lambda item: calls.get(item.nodeid, 0.0)):
            file = item.nodeid.partition("::")[0]
            room = "/".join(file.split("/")[:2])
            seconds = calls.get(item.nodeid, 0.0)
            work = seconds + own_setups.get(item.nodeid, 0.0) + OVERHEAD_S
            total = spent.get(room, 0.0) + (work if item.nodeid in calls else 0.0)
            if setups.get(file, 0.0) + seconds < MAX_UNIT_S and total < MAX_ROOM_S:
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
            pytest.skip("never timed on this machine; the next run of units goes on here")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Learn how long a phase of a test took."""
        if self.learns and report.when in PHASES and not report.skipped:
            seconds = self.durations.setdefault(report.when, {})
            seconds[report.nodeid] = min(report.duration, seconds.get(report.nodeid, report.duration))

    def pytest_sessionfinish(self) -> None:
        """Keep what was learned."""
        if self.learns:
            self.cache.set(CACHE_KEY, self.durations)
