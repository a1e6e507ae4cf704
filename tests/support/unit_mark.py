"""The mark ``unit``: by earlier runs on this machine, the shortest tests of a room, in all 10 s.

Which these are is learned by every run, and kept in pytest's cache, not in the repository: another
machine has other durations. What has never run counts as a unit, so the first run of a room takes
as long as its tests, and teaches the next.
"""

from __future__ import annotations

import pytest

MAX_UNIT_S = 0.2
MAX_ROOM_S = 10.0
CACHE_KEY = "vibrident/durations"
PHASES = ("setup", "call")


class UnitMark:
    """Plug-in of pytest that learns durations, and marks tests by them.

    Args:
        cache: pytest's cache, which keeps the durations.
        learns: False in a worker of another process, which sees every report of its workers.
    """

    def __init__(self, cache: pytest.Cache, *, learns: bool = True) -> None:
        self.cache = cache
        self.learns = learns
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
        spent: dict[str, float] = {}  # room → s
        for item in sorted(items, key=lambda item: calls.get(item.nodeid, 0.0)):
            file = item.nodeid.partition("::")[0]
            room = "/".join(file.split("/")[:2])
            seconds = calls.get(item.nodeid, 0.0)
            total = spent.get(room, 0.0) + seconds
            if setups.get(file, 0.0) + seconds < MAX_UNIT_S and total < MAX_ROOM_S:
                spent[room] = total
                item.add_marker(pytest.mark.unit)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Learn how long a phase of a test took."""
        if self.learns and report.when in PHASES and not report.skipped:
            seconds = self.durations.setdefault(report.when, {})
            seconds[report.nodeid] = min(report.duration, seconds.get(report.nodeid, report.duration))

    def pytest_sessionfinish(self) -> None:
        """Keep what was learned."""
        if self.learns:
            self.cache.set(CACHE_KEY, self.durations)
