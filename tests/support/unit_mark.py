"""The mark ``unit``: tests that took less than 0.2 s, by earlier runs on this machine.

Which these are is learned by every run, and kept in pytest's cache, not in the repository: another
machine has other durations. What has never run counts as a unit, too.
"""

from __future__ import annotations

import time

import pytest

MAX_UNIT_S = 0.2
CACHE_KEY = "vibrident/durations"
PHASES = ("setup", "call")


class UnitMark:
    """Plug-in of pytest that learns durations, and marks tests by them.

    Args:
        cache: pytest's cache, which keeps the durations.
        budget_s: seconds after which tests of unknown duration are skipped; None: none is.
    """

    def __init__(self, cache: pytest.Cache, budget_s: float | None) -> None:
        self.cache = cache
        self.budget_s = budget_s
        self.started_s = 0.0
        #: Phase → test → shortest duration in s. What is loaded or made once is paid by one test.
        self.durations: dict[str, dict[str, float]] = cache.get(CACHE_KEY, {})
        self.known = set(self.durations.get("call", {}))

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Mark the tests; what a file sets up once counts for each of its tests."""
        setups: dict[str, float] = {}
        for name, seconds in self.durations.get("setup", {}).items():
            file = name.partition("::")[0]
            setups[file] = max(seconds, setups.get(file, 0.0))
        calls = self.durations.get("call", {})
        for item in items:
            file = item.nodeid.partition("::")[0]
            if setups.get(file, 0.0) + calls.get(item.nodeid, 0.0) < MAX_UNIT_S:
                item.add_marker(pytest.mark.unit)

    def pytest_collection_finish(self) -> None:
        """Begin to spend the budget."""
        self.started_s = time.monotonic()

    def pytest_runtest_setup(self, item: pytest.Item) -> None:
        """Skip a test of unknown duration when the budget is spent."""
        spent = self.budget_s is not None and time.monotonic() - self.started_s > self.budget_s
        if spent and item.nodeid not in self.known:
            pytest.skip(f"never run before, and {self.budget_s:g} s are over")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Learn how long a phase of a test took."""
        if report.when in PHASES and not report.skipped:
            seconds = self.durations.setdefault(report.when, {})
            seconds[report.nodeid] = min(report.duration, seconds.get(report.nodeid, report.duration))

    def pytest_sessionfinish(self) -> None:
        """Keep what was learned."""
        self.cache.set(CACHE_KEY, self.durations)
