"""Who has what on the page, for how long, and how much all may have."""

from __future__ import annotations

import asyncio
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip("nicegui")

from tests.support import tasks
from tests.support.serving import alone

from vibrident.app.web import column_guess, task_run, translated, users, worker
from vibrident.app.web.column_guess import ColumnGuess
from vibrident.app.web.form.columns import merge_guess
from vibrident.app.web.language import language
from vibrident.app.web.task_run import TaskProgress
from vibrident.app.web.tasks import identify_request
from vibrident.app.web.user import User
from vibrident.app.web.users import Users
from vibrident.base.errors import InputError, NotConverged
from vibrident.base.process import WorkerError
from vibrident.data.io.guess import guess_columns


class Browser:
    """A tab, seen from the server; ``client`` is the page in it."""

    def __init__(self, identity: str = "tab") -> None:
        self.identity = identity
        self.open()

    def open(self) -> None:
        self.client = SimpleNamespace(has_socket_connection=True, tab_id=self.identity)

    def leave(self) -> None:
        self.client.has_socket_connection = False


@pytest.fixture
def clock(monkeypatch):
    now = SimpleNamespace(s=0.0)
    monkeypatch.setattr(users.time, "time", lambda: now.s)
    return now


@pytest.fixture
def everybody(tmp_path, clock):
    made = Users(tmp_path, 1.0)
    yield made
    made.close()
    assert not list(tmp_path.iterdir())


def with_file(everybody: Users, tab: Browser, size: int = 10) -> User:
    user = everybody.attach(tab.client)
    user.session.reserve_path("a.csv", size).write_bytes(bytes(size))
    return user


def test_a_tab_that_comes_back_within_the_hour_finds_what_it_left(everybody, clock):
    tab = Browser()
    user = with_file(everybody, tab)
    tab.leave()
    clock.s = 3500.0
    everybody.remove_absent()
    tab.open()
    assert everybody.attach(tab.client) is user
    clock.s = 10_000.0
    everybody.remove_absent()  # it is looked at
    tab.leave()
    clock.s += 3700.0
    everybody.remove_absent()
    tab.open()
    fresh = everybody.attach(tab.client)
    assert fresh is not user
    assert fresh.empty
    assert not user.session.folder.exists()


def test_a_page_reloaded_before_the_old_connection_ends_is_the_same_and_a_duplicated_tab_is_another(everybody):
    tab = Browser()
    user = with_file(everybody, tab)
    tab.open()
    assert everybody.attach(tab.client) is user
    copy = Browser("other")
    other = everybody.attach(copy.client)
    assert other is not user
    assert other.empty
    assert everybody.attach(tab.client) is user


def test_who_has_nothing_is_forgotten_at_once(everybody, clock):
    tab = Browser()
    everybody.attach(tab.client)
    tab.leave()
    clock.s = 60.0
    everybody.remove_absent()
    assert not everybody.members


def test_too_many_users(everybody, clock, monkeypatch):
    monkeypatch.setattr(users, "MAX_USERS", 3)
    tabs = [Browser(str(i)) for i in range(3)]
    for second, tab in enumerate(tabs):
        clock.s = float(second)
        with_file(everybody, tab)
    late = Browser("late")
    with pytest.raises(InputError, match="limit of users"):
        everybody.attach(late.client)
    tabs[1].leave()
    clock.s = 10.0
    everybody.remove_absent()
    tabs[2].leave()
    everybody.attach(late.client)
    left = {user.tab for user in everybody.members}
    assert [tab.identity in left for tab in tabs] == [True, False, True]


def test_room_for_all_is_made_by_those_who_left_first(everybody, clock):
    tabs = [Browser(str(i)) for i in range(10)]
    for second, tab in enumerate(tabs):
        clock.s = float(second)
        with_file(everybody, tab, 1_000_000)
    late = Browser("late")
    with pytest.raises(InputError, match="no room"):
        with_file(everybody, late)
    tabs[4].leave()
    user = everybody.attach(late.client)
    user.session.reserve_path("a.csv", 1_000_000)
    left = {user.tab for user in everybody.members}
    assert [tab.identity in left for tab in tabs] == [number != 4 for number in range(10)]


def test_what_was_left_is_offered_to_its_owner_alone(everybody):
    tab, other = Browser("one"), Browser("two")
    left = everybody.attach(tab.client, "me")
    left.session.reserve_path("a.csv", 10).write_bytes(bytes(10))
    user = everybody.attach(other.client, "me")
    assert everybody.closed_tabs_of("me") == []  # it is open
    tab.leave()
    assert everybody.closed_tabs_of("me") == [left]
    assert everybody.closed_tabs_of("you") == everybody.closed_tabs_of("") == []
    assert not everybody.hand_over(left, everybody.attach(Browser("three").client, "you"))
    assert everybody.hand_over(left, user)
    assert everybody.attach(other.client, "me") is left
    assert everybody.attach(Browser("two").client, "you") is not left  # the name of a tab is no key


def test_a_stopped_server_leaves_its_users_to_the_next(tmp_path):
    before = Users(tmp_path, 1.0, keep_s=1000.0)
    user = before.attach(Browser().client, "me")
    user.session.reserve_path("a.csv", 10).write_bytes(bytes(10))
    user.session.reserve_path("b.csv", 20).write_bytes(bytes(5))  # it was arriving
    (user.session.folder / "run-1").mkdir()
    user.form = merge_guess(None, guessed(user.session.data, "t,ref [mm/s],out [pC]", "c.csv"))
    user.form.set("reference.scale", 2.0)
    (user.session.data / "c.csv").unlink()
    (tmp_path / "made.json").write_text("{}")
    user.keep_result("1: mine", tmp_path / "made.json", request=identify_request("calibration.toml"))
    user.fit.progress = TaskProgress(identify_request("calibration.toml", "ml"))
    user.write()

    after = Users(tmp_path, 1.0, keep_s=1000.0)
    after._restore()
    again = after.attach(Browser().client, "me")
    assert again is not user
    assert again.session.names == ["a.csv"]
    assert not (again.session.folder / "run-1").exists()
    assert again.form is not None
    assert (again.form.description, again.form.touched) == (user.form.description, {"reference.scale"})
    assert again.results == user.results
    assert isinstance(again.fit.progress.error, worker.StoppedError)
    assert again.fit.progress.request == user.fit.progress.request

    (again.session.folder / "state").write_bytes(b"[0, 3]\n")  # of another version
    late = Users(tmp_path, 1.0, keep_s=1000.0)
    late._restore()
    assert not late.members
    assert not list(tmp_path.iterdir())


def test_what_was_left_too_long_ago_is_not_taken_up(tmp_path, clock):
    before = Users(tmp_path, 1.0, keep_s=1000.0)
    user = before.attach(Browser().client, "me")
    user.session.reserve_path("a.csv", 10).write_bytes(bytes(10))
    user.write()
    clock.s = 1001.0
    after = Users(tmp_path, 1.0, keep_s=1000.0)
    after._restore()
    assert not after.members
    assert not list(tmp_path.iterdir())


def test_a_run_says_its_share_and_the_most_time_left(monkeypatch):
    now = SimpleNamespace(s=0.0)
    monkeypatch.setattr(task_run.time, "monotonic", lambda: now.s)
    run = TaskProgress(identify_request("calibration.toml"), began=0.0)
    run.receive("iteration", 1, 11, 3.0)
    assert run.most_left_s is None
    now.s = 2.0
    run.receive("iteration", 2, 11, 2.0)
    assert (run.share, run.most_left_s) == (2 / 11, 18.0)
    assert run.status(language("en")).endswith("(2 s; this start: at most 18 s more)")


def test_a_run_tells_separate_starts_and_steps_apart():
    run = TaskProgress(identify_request("calibration.toml"))
    for iteration in (1, 2, 3, 1, 2, 1):
        run.receive("iteration", iteration, 60, 10.0 / iteration)
    assert [len(points) for _, points in run.lines] == [3, 2, 1]
    assert run.line_names == ["start 1", "start 2", "start 3"]
    assert run.status(language("en")).startswith("start 3: Iteration 1 of at most 60")
    run.receive("step", "Identifying by ml")
    run.receive("iteration", 1, 60, 1.0)
    assert run.line_names[-1] == "Identifying by ml"
    assert run.status(language("en")).startswith("Identifying by ml: Iteration 1 of at most 60")


def worked(task, *args, folder: Path, progress=None) -> worker.Worker:
    """A worker after it has run a function."""
    one = worker.Worker()
    alone(one.run(task, *args, folder=folder, progress=progress))
    return one


@pytest.mark.parametrize(
    ("task", "error", "words"),
    [
        (tasks.refused, InputError, "xxx"),
        (tasks.not_converged, NotConverged, "no optimum"),
        (tasks.broken, WorkerError, "a bug"),
        (tasks.killed, worker.StoppedError, "signal 9"),
        (tasks.talkative, WorkerError, "the end"),
        (tasks.hungry, InputError, "more memory than the page allows"),
    ],
)
def test_whatever_a_worker_says_reaches_the_page(tmp_path, task, error, words):
    with pytest.raises(error, match=words) as caught:
        worked(task, folder=tmp_path)
    assert len(str(caught.value)) < 300_000


def test_progress_of_a_worker_comes_as_it_is_made(tmp_path):
    steps = []
    worked(tasks.two_steps, 0.5, folder=tmp_path, progress=lambda *step: steps.append(step))
    assert steps == [(1, 9, 0.5), (2, 9, 0.25)]


def test_a_worker_that_is_cancelled_ends_at_once(tmp_path):
    async def cancelled() -> None:
        one = worker.Worker()
        running = asyncio.create_task(one.run(time.sleep, 3600.0, folder=tmp_path))
        await asyncio.sleep(0.3)
        one.cancel()
        with pytest.raises(asyncio.CancelledError):
            await asyncio.wait_for(running, 600.0)

    alone(cancelled())


def guessed(tmp_path, header: str, name: str = "a.csv") -> ColumnGuess:
    width = header.count(",") + 1
    (tmp_path / name).write_text(header + "\n" + "\n".join(",".join([f"{i}.5"] * width) for i in range(4)) + "\n")
    return ColumnGuess(guess_columns(tmp_path / name), None, width, b"")


def test_a_guess_sets_nothing_that_a_person_set(tmp_path):
    first = guessed(tmp_path, "t,ref [mm/s],out [pC],x")
    form = merge_guess(None, first)
    assert [form.get(f"reference.{key}") for key in ("column", "quantity", "scale")] == ["ref [mm/s]", "velocity", 1.0]
    again = merge_guess(form, guessed(tmp_path, "t,laser,coil"))  # untouched: the new guess holds
    assert [again.get(f"reference.{key}") for key in ("column", "quantity")] == ["laser", "displacement"]

    form.set("reference.scale", 2.0)
    form.set("sensor.serial_number", "7")
    kept = merge_guess(form, guessed(tmp_path, "t,ref [mm/s],out [pC],laser"))
    assert kept.description == form.description
    assert kept.touched == {"reference.scale", "sensor.serial_number"}
    form.set("response.column", "x")
    other = merge_guess(form, guessed(tmp_path, "t,laser,coil"))
    assert [other.get(path) for path in ("reference.scale", "response.column")] == [
        2.0,
        "x",
    ]  # set by hand: asked about
    assert [other.get(path) for path in ("reference.column", "sampling.time_column")] == ["laser", "t"]  # not set, gone


def test_a_wide_file_offers_few_columns_and_those_that_were_guessed(tmp_path):
    names = [f"channel {i}" for i in range(2000)] + ["ref", "response"]
    wide = guessed(tmp_path, ",".join(names)).columns
    few = column_guess._offered_columns(wide)
    assert len(few.columns) == len(few.labels) == column_guess.MAX_OFFERED_COLUMNS + 2
    assert {"ref", "response"} <= set(few.columns)
    assert (
        column_guess._offered_columns(replace(wide, columns=wide.columns[:3], labels=wide.labels[:3])).columns
        == wide.columns[:3]
    )


def test_charts_that_are_too_large_are_left_out():
    drawn = [("a", b"x" * 60, 3), ("b", b"x" * 5000, 3), ("c", b"x", 3)]
    found, left = translated.fitting(drawn, 100)
    assert found == drawn[:1]
    assert left < 0
    assert len(translated.fitting(drawn, 10_000)[0]) == 3
