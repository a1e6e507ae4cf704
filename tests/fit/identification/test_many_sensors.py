"""Many sensors: the results of one by one, in order, with calibrations taken only as they are asked for."""

import functools
from concurrent.futures import Future
from dataclasses import replace

import pytest

import vibrident
from vibrident.base.errors import InputError
from vibrident.physics.simulation import simulate, with_noise

CLEAN = simulate("paper", frequencies_hz=[100.0, 250.0, 400.0, 630.0, 1000.0], samples=1000, start="steady", seed=1)


def calibrations(count, taken=None):
    for seed in range(count):
        if taken is not None:
            taken.append(seed)
        yield with_noise(CLEAN, response_noise=0.01, seed=seed)


def plain(result):
    document = result.to_dict()
    document["settings"].pop("time_s")
    document.pop("provenance", None)
    return document


@functools.cache
def alone(count):
    """The first calibrations, identified one by one."""
    return [plain(vibrident.identify(one, estimator="ipnn")) for one in calibrations(count)]


def test_the_results_are_those_of_one_by_one():
    one_by_one = [plain(vibrident.identify(one)) for one in calibrations(3)]
    assert [plain(result) for result in vibrident.identify_many(calibrations(3))] == one_by_one


def test_workers_give_the_same_in_order(monkeypatch):
    monkeypatch.setattr("vibrident.lab.many.PROCESS_START_S", 0.0)
    found = vibrident.identify_many(calibrations(6), estimator="ipnn", workers=2)
    assert [plain(result) for result in found] == alone(6)


def test_a_process_that_has_not_started_yet_holds_nothing_up(monkeypatch):
    class Starting:
        """A pool whose processes never come."""

        def __init__(self, *_):
            pass

        def submit(self, *_):
            return Future()

        def shutdown(self, **_):
            pass

    monkeypatch.setattr("vibrident.lab.many.PROCESS_START_S", 0.0)
    monkeypatch.setattr("concurrent.futures.ProcessPoolExecutor", Starting)
    taken = []
    found = vibrident.identify_many(calibrations(6, taken), estimator="ipnn", workers=2)
    first = plain(next(found))
    second = plain(next(found))
    assert len(taken) <= 5  # a few ahead
    assert [first, second, *map(plain, found)] == alone(6)


def test_calibrations_are_taken_as_they_are_asked_for():
    taken = []
    found = vibrident.identify_many(calibrations(100, taken))
    assert taken == []
    next(found), next(found)
    assert taken == [0, 1]


def test_what_cannot_be_used_ends_the_iteration_or_stands_in_its_place():
    good = next(calibrations(1))
    broken = replace(good, records=tuple(replace(r, response=r.response * 0.0) for r in good.records))
    with pytest.raises(InputError):
        list(vibrident.identify_many([good, broken, good]))
    first, second, third = vibrident.identify_many([good, broken, good], refused="return")
    assert isinstance(second, InputError)
    assert plain(first) == plain(third)
    with pytest.raises(InputError, match="workers"):
        vibrident.identify_many([good], workers=0)
