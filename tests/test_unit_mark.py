"""The mark ``unit``: what is fast by earlier runs, or has never run."""

from __future__ import annotations

from types import SimpleNamespace

from tests.support.unit_mark import CACHE_KEY, UnitMark


class Cache(dict):
    """Pytest's cache, in memory."""

    def set(self, key, value):
        self[key] = value


def item(name):
    marks = []
    return SimpleNamespace(nodeid=name, marks=marks, add_marker=marks.append)


def report(name, when, duration):
    return SimpleNamespace(nodeid=name, when=when, duration=duration, skipped=False)


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
