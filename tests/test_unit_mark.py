"""The mark ``unit``: what is fast by earlier runs, or has never run, as much as the time of a quick run allows."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from tests.support import unit_mark
from tests.support.unit_mark import CACHE_KEY, MAX_ROOM_S, MAX_UNKNOWN_S, NEVER_TIMED, OVERHEAD_S, UNKNOWN_S, UnitMark


class Cache(dict):
    """Pytest's cache, in memory."""

    def set(self, key, value):
        self[key] = value


def item(name, *, slow=False):
    marks = []
    return SimpleNamespace(nodeid=name, marks=marks, add_marker=marks.append, get_closest_marker=lambda _: slow)


def report(name, when, duration, skipped=None):
    return SimpleNamespace(nodeid=name, when=when, duration=duration, skipped=bool(skipped), longrepr=skipped)


def marked(cache, *names):
    items = [item(name) for name in names]
    UnitMark(cache).pytest_collection_modifyitems(items)
    return [one.nodeid for one in items if one.marks]


def test_the_shortest_duration_counts_and_setups_count_for_their_whole_file():
    cache = Cache()
    plugin = UnitMark(cache)
    for name, when, duration in (
        ("a.py::fast", "call", 3.0),  # paid for what is loaded once
        ("a.py::fast", "call", 0.1),
        ("a.py::slow", "call", 0.3),
        ("b.py::first", "setup", 2.0),
        ("b.py::first", "call", 0.0),
        ("b.py::second", "call", 0.0),
    ):
        plugin.pytest_runtest_logreport(report(name, when, duration))
    plugin.pytest_sessionfinish()
    assert set(cache) == {CACHE_KEY}
    names = ("a.py::fast", "a.py::slow", "a.py::new", "b.py::first", "b.py::second")
    assert marked(cache, *names) == ["a.py::fast", "a.py::new"]


def test_of_a_room_the_shortest_are_marked_as_long_as_their_work_fits_a_quick_run():
    cache = Cache()
    plugin = UnitMark(cache)
    names = [f"tests/{room}/a.py::{number}" for room in ("data", "fit") for number in range(100)]
    for name in names:
        plugin.pytest_runtest_logreport(report(name, "setup", 0.01))
        plugin.pytest_runtest_logreport(report(name, "call", 0.15 if name.endswith("7") else 0.098))
    plugin.pytest_sessionfinish()
    at_most = int(MAX_ROOM_S / (0.01 + 0.098 + OVERHEAD_S))
    assert at_most < 90, "those that are not the shortest would be taken too"
    assert len(marked(cache, *names[:100])) == at_most
    assert not [name for name in marked(cache, *names) if name.endswith("7")]
    assert len(marked(cache, *names)) == 2 * at_most


def test_what_was_never_timed_gets_half_of_a_run_and_what_is_slow_or_skips_itself_nothing_of_it():
    cache = Cache()
    plugin = UnitMark(cache)
    known, new = ([f"tests/data/{file}.py::{number}" for number in range(1000)] for file in ("known", "new"))
    for name in known:
        plugin.pytest_runtest_logreport(report(name, "call", 0.01))
    plugin.pytest_runtest_logreport(report(new[0], "setup", 0.0, skipped="Skipped: needs an extra"))
    plugin.pytest_runtest_logreport(report(new[1], "setup", 0.0, skipped=f"Skipped: {NEVER_TIMED}"))
    plugin.pytest_sessionfinish()
    slow = [item(f"tests/data/slow.py::{number}", slow=True) for number in range(1000)]
    items = [*slow, *map(item, known + new)]
    UnitMark(cache).pytest_collection_modifyitems(items)
    chosen = [one.nodeid for one in items if one.marks]
    first = [name for name in chosen if name in new]
    assert first == new[: len(first)]
    half = MAX_ROOM_S / 2
    assert len(first) == pytest.approx(half / UNKNOWN_S, abs=2)
    assert len(chosen) - len(first) == pytest.approx(half / (0.01 + OVERHEAD_S), abs=2)
    assert set(chosen) <= {*known, *new}


def test_a_run_of_units_starts_what_was_never_timed_for_some_seconds_alone(monkeypatch):
    clock = iter([10.0, 10.0 + MAX_UNKNOWN_S, 10.1 + MAX_UNKNOWN_S])
    monkeypatch.setattr(unit_mark.time, "monotonic", lambda: next(clock))
    cache = Cache({CACHE_KEY: {"call": {"a.py::known": 0.1}}})
    plugin = UnitMark(cache, only_units=True)
    plugin.pytest_runtest_setup(item("a.py::first"))
    plugin.pytest_runtest_setup(item("a.py::second"))
    with pytest.raises(pytest.skip.Exception, match="never timed"):
        plugin.pytest_runtest_setup(item("a.py::third"))
    plugin.pytest_runtest_setup(item("a.py::known"))
    UnitMark(cache).pytest_runtest_setup(item("a.py::third"))  # a run of all tests skips nothing


def test_a_worker_marks_and_learns_nothing():
    cache = Cache({CACHE_KEY: {"call": {"a.py::slow": 0.3}}})
    plugin = UnitMark(cache, learns=False)
    plugin.pytest_runtest_logreport(report("a.py::fast", "call", 3.0))
    plugin.pytest_sessionfinish()
    assert marked(cache, "a.py::fast", "a.py::slow") == ["a.py::fast"]
