"""What a reader that was taken over could do: nothing with other files, other processes or the network."""

from __future__ import annotations

import os
import shutil
import socket

import pytest
from tests.support.tasks import killed, names_in, priority, reached, written

from vibrident.app.web.confinement import can_confine, confinement_command
from vibrident.base.process import Process, ProcessDied, WorkerError

walled = pytest.mark.skipif(not can_confine(), reason="bubblewrap is not installed, or not allowed here")


@pytest.fixture
def reader(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "a.csv").touch()
    (tmp_path / "theirs").mkdir()
    with Process(wrapper=confinement_command(tmp_path / "mine")) as process:
        yield process


@walled
def test_it_sees_its_folder_and_nobody_elses_files(reader, tmp_path):
    assert reader.call(names_in, str(tmp_path / "mine")) == ["a.csv"]
    assert reader.call(names_in, str(tmp_path)) == ["mine"]
    assert str(os.getpid()) not in reader.call(names_in, "/proc")
    with pytest.raises(WorkerError, match="Read-only file system"):
        reader.call(written, str(tmp_path / "mine" / "b.csv"))


@walled
def test_it_reaches_no_network(reader):
    with socket.create_server(("127.0.0.1", 0)) as server:
        with pytest.raises(WorkerError, match=r"ConnectionRefusedError|Network is unreachable"):
            reader.call(reached, server.getsockname()[1])
        reached(server.getsockname()[1])


@walled
def test_an_identification_may_write_in_its_own_folder(tmp_path):
    with Process(folder=tmp_path, wrapper=confinement_command(tmp_path, writable=True)) as process:
        process.call(written, "result.json")
    assert (tmp_path / "result.json").exists()


@pytest.mark.skipif(not shutil.which("nice"), reason="the system has no nice")
def test_the_server_goes_first(tmp_path):
    with Process(wrapper=confinement_command(tmp_path)) as process:
        assert process.call(priority) == min(os.nice(0) + 10, 19)
    with Process(wrapper=confinement_command(tmp_path)) as process, pytest.raises(ProcessDied) as death:
        process.call(killed)
    assert "signal" in death.value.ending
