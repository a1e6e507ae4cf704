"""What a server that was killed left is removed by the next one, and nothing else."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from vibrident.app.web.home import PREFIX, ServerFolder, remove_leftovers

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no lock tells a dead server there")
_SERVER = """
import time
from vibrident.app.web.home import ServerFolder
print(ServerFolder().folder, flush=True)
time.sleep(60)
"""


@pytest.fixture
def top(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    return tmp_path


def other_server(top: Path) -> tuple[subprocess.Popen[str], Path]:
    environment = {**os.environ, "TMPDIR": str(top)}
    made = subprocess.Popen([sys.executable, "-c", _SERVER], stdout=subprocess.PIPE, text=True, env=environment)
    assert made.stdout is not None
    return made, Path(made.stdout.readline().strip())


def test_a_home_is_private_and_goes_with_all_that_is_in_it(top):
    home = ServerFolder()
    assert home.folder.stat().st_mode & 0o777 == 0o700
    (home.folder / "user" / "data").mkdir(parents=True)
    home.close()
    home.close()
    assert not list(top.iterdir())


def test_leftovers_of_the_dead_go_and_the_living_keep_theirs(top):
    dead, left = other_server(top)
    alive, kept = other_server(top)
    try:
        assert left.is_dir()
        assert kept.is_dir()
        (left / "user").mkdir()
        (left / "user" / "data.csv").write_text("1,2\n")
        dead.send_signal(signal.SIGKILL)
        dead.wait()
        home = ServerFolder()
        assert not left.exists()
        assert kept.is_dir()
        assert remove_leftovers(top) == []
        home.close()
    finally:
        for process in (dead, alive):
            process.kill()
            process.wait()
            process.stdout.close()


def test_what_is_no_home_stays(top):
    elsewhere = top / "elsewhere"
    (elsewhere / "data").mkdir(parents=True)
    (elsewhere / "lock").touch()
    (top / f"{PREFIX}link").symlink_to(elsewhere, target_is_directory=True)
    (top / f"{PREFIX}empty").mkdir()
    (top / f"{PREFIX}linked-lock").mkdir()
    (top / f"{PREFIX}linked-lock" / "lock").symlink_to(elsewhere / "lock")
    (top / f"{PREFIX}pipe").mkdir()
    os.mkfifo(top / f"{PREFIX}pipe" / "lock")
    (top / f"{PREFIX}file").touch()
    before = sorted(top.rglob("*"))
    assert remove_leftovers(top) == []
    assert sorted(top.rglob("*")) == before


def test_a_link_in_a_leftover_is_removed_and_not_followed(top):
    elsewhere = top / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "data.csv").touch()
    left = top / f"{PREFIX}left"
    left.mkdir()
    (left / "lock").touch()
    (left / "user").symlink_to(elsewhere, target_is_directory=True)
    assert remove_leftovers(top) == [left.name]
    assert (elsewhere / "data.csv").exists()
    assert not left.exists()


def test_what_belongs_to_another_stays(top, monkeypatch):
    left = top / f"{PREFIX}left"
    left.mkdir()
    (left / "lock").touch()
    monkeypatch.setattr(os, "getuid", lambda: os.stat(left).st_uid + 1)
    assert remove_leftovers(top) == []
    assert left.is_dir()
