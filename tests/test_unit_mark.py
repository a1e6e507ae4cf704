"""The mark ``unit``: what was short in quick runs, or has never run in one, while time allows."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from tests.support import unit_mark
from tests.support.unit_mark import (
    CACHE_KEY,
    MAX_PROCESS_S,
    MAX_ROOM_S,
    OUT_OF_TIME,
    OVERHEAD_S,
    UnitMark,
)


class Cache(dict):
    """Pytest's cache, in memory."""

    def set(self, key, value):
        self[key] = value


@pytest.fixture
def clock(monkeypatch):
    """A clock that tests set."""
    clock = SimpleNamespace(s=100.0)
    monkeypatch.setattr(unit_mark.time, "monotonic", lambda: clock.s)
    return clock


def item(name, *, slow=False):
    marks = []
    return SimpleNamespace(nodeid=name, marks=marks, add_marker=marks.append, get_closest_marker=lambda _: slow)


def report(name, when, duration, longrepr=None):
    return SimpleNamespace(nodeid=name, when=when, duration=duration, longrepr=longrepr)


def learn(cache, *reports, **kwargs):
    plugin = UnitMark(cache, **{"is_quick": True, **kwargs})
    for each in reports:
        plugin.pytest_runtest_logreport(report(*each))
    plugin.pytest_sessionfinish()


def marked(cache, *names):
    items = [item(name) for name in names]
    UnitMark(cache).pytest_collection_modifyitems(items)
    return [each.nodeid for each in items if each.marks]


def test_the_last_quick_run_counts_with_what_the_test_sets_up_and_without_one_any_other():
    cache = Cache()
    learn(cache, ("a.py::fast", "call", 3.0))
    learn(
        cache,
        ("a.py::fast", "setup", 0.0),
        ("a.py::fast", "call", 0.1),
        ("a.py::slow", "call", 0.3),
        ("b.py::first", "setup", 2.0),
        ("b.py::first", "call", 0.0),
        ("b.py::first", "teardown", 9.0),
    )
    learn(cache, ("a.py::slow", "call", 0.0), ("b.py::second", "call", 0.3), is_quick=False)
    assert set(cache) == {CACHE_KEY}
    names = ("a.py::fast", "a.py::slow", "a.py::new", "b.py::first", "b.py::second")
    assert marked(cache, *names) == ["a.py::fast", "a.py::new"]


def test_the_shortest_of_each_room_are_marked_until_their_work_fills_a_quick_run():
    cache = Cache()
    rooms = ("data", "fit")
    names = [f"tests/{room}/a.py::{number}" for room in rooms for number in range(100)]
    learn(cache, *((name, "setup", 0.01) for name in names))
    learn(cache, *((name, "call", 0.15 if name.endswith("7") else 0.098) for name in names))
    most = int(MAX_ROOM_S / (0.01 + 0.098 + OVERHEAD_S))
    assert most < 90, "those that are not the shortest would be taken too"
    assert len(marked(cache, *names[:100])) == most
    assert not [name for name in marked(cache, *names) if name.endswith("7")]
    assert len(marked(cache, *names)) == 2 * most


def test_slow_tests_are_no_units_and_known_ones_start_first_in_the_order_of_their_files():
    cache = Cache()
    learn(cache, ("tests/fit/b.py::first", "call", 0.1), ("tests/fit/b.py::second", "call", 0.05))
    slow = item("tests/fit/a.py::slow", slow=True)
    names = ("tests/fit/a.py::new", "tests/fit/b.py::first", "tests/fit/b.py::second")
    items = [slow, *map(item, names)]
    UnitMark(cache, is_quick=True).pytest_collection_modifyitems(items)
    assert not slow.marks
    assert [each.nodeid for each in items if each.marks] == [*names[1:], names[0]]


def test_a_quick_run_skips_what_starts_after_its_seconds_and_learns_nothing_of_it(clock):
    cache = Cache()
    quick, whole = UnitMark(cache, is_quick=True), UnitMark(cache)
    for plugin in (quick, whole):
        plugin.pytest_collection_modifyitems([item("tests/fit/a.py::1"), item("tests/data/a.py::1")])
    clock.s += 2 * MAX_PROCESS_S  # of two rooms
    quick.pytest_runtest_setup()
    clock.s += 0.1
    with pytest.raises(pytest.skip.Exception, match=OUT_OF_TIME):
        quick.pytest_runtest_setup()
    whole.pytest_runtest_setup()
    learn(cache, ("a.py::late", "setup", 0.0, f"Skipped: {OUT_OF_TIME}"))
    assert not cache[CACHE_KEY]


def test_of_runs_of_all_tests_the_shortest_counts():
    cache = Cache()
    learn(cache, ("a.py::fast", "call", 3.0), is_quick=False)  # paid for what is made once
    assert not marked(cache, "a.py::fast")
    learn(cache, ("a.py::fast", "call", 0.1), is_quick=False)
    learn(cache, ("a.py::fast", "call", 3.0), is_quick=False)
    assert marked(cache, "a.py::fast")


def test_workers_learn_nothing():
    cache = Cache()
    learn(cache, ("a.py::fast", "call", 3.0), is_worker=True)
    assert not cache
