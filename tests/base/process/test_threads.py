"""A script's identification computes on one core, and leaves the limit of threads as it was."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator

import pytest
import threadpoolctl
from threadpoolctl import threadpool_info, threadpool_limits

import vibrident
from vibrident.base.memory import ONE_THREAD, in_one_thread
from vibrident.physics.simulation import simulate


@pytest.fixture(autouse=True)
def _as_for_a_user(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ONE_THREAD:
        monkeypatch.delenv(name, raising=False)


def threads() -> set[int]:
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


def test_identify_computes_on_one_core_and_returns_the_others() -> None:
    sensor = ("accelerometer", {"sensitivity": 0.01, "natural_frequency": 800.0, "damping_ratio": 0.3})
    made = simulate(sensor, "random", frequencies_hz=[10.0, 2000.0], samples=500, sampling_rate_hz=5000.0, seed=1)
    seen: list[set[int]] = []
    with threadpool_limits(2, "blas"):
        vibrident.identify(made, progress=lambda *_: seen.append(threads()))
        assert threads() == {2}
    assert seen
    assert all(found == {1} for found in seen)


def test_the_last_of_several_at_once_returns_them(monkeypatch: pytest.MonkeyPatch) -> None:
    happened: list[str] = []

    @contextlib.contextmanager
    def limits(number: int, kind: str) -> Iterator[None]:
        happened.append(f"{number} {kind}")
        yield
        happened.append("as before")

    monkeypatch.setattr(threadpoolctl, "threadpool_limits", limits)
    both, first_is_done = threading.Barrier(2, timeout=120.0), threading.Event()

    @in_one_thread
    def work(*, first: bool) -> None:
        both.wait()
        assert first or first_is_done.wait(120.0)

    later = threading.Thread(target=work, kwargs={"first": False}, daemon=True)
    later.start()
    work(first=True)
    assert happened == ["1 blas"]
    first_is_done.set()
    later.join()
    assert happened == ["1 blas", "as before"]


def test_what_the_environment_says_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    with threadpool_limits(2, "blas"):
        assert in_one_thread(threads)() == {2}
