"""Pictures appear whether or not there are processes to draw them."""

import shutil

import pytest

from vibrident.cli import drawing
from vibrident.result import Result

PICTURES = ["deviation.png", "residuals.png", "sensitivity.png", "signals.png", "training.png"]


@pytest.fixture
def saved(identified, tmp_path):
    return shutil.copy(identified, tmp_path / "result.json")


def drawn(saved):
    with drawing.painters() as artists:
        artists.draw(Result.load(saved), saved)
    return sorted(file.name for file in saved.parent.glob("*.png"))


def test_by_processes(saved, monkeypatch):
    monkeypatch.setattr(drawing, "_cores", lambda: 2)
    monkeypatch.setattr("vibrident.plots.save_all", lambda *_: pytest.fail("the processes should have drawn"))
    assert drawn(saved) == PICTURES


def test_with_one_core(saved, monkeypatch):
    monkeypatch.setattr(drawing, "_cores", lambda: 1)
    monkeypatch.setattr(drawing, "_start", lambda: pytest.fail("no process should be started"))
    assert drawn(saved) == PICTURES


def test_when_a_process_fails(saved, monkeypatch):
    monkeypatch.setattr(drawing, "_cores", lambda: 2)
    monkeypatch.setattr(drawing, "_WORKER", "raise SystemExit(1)")
    assert drawn(saved) == PICTURES


def test_when_no_process_can_be_started(saved, monkeypatch):
    monkeypatch.setattr(drawing, "_cores", lambda: 2)
    monkeypatch.setattr("sys.executable", "/nowhere/python")
    assert drawn(saved) == PICTURES


def test_processes_end_with_the_block(monkeypatch):
    monkeypatch.setattr(drawing, "_cores", lambda: 2)
    with drawing.painters() as artists:
        processes = list(artists._processes)
        assert all(process.poll() is None for process in processes)
    assert all(process.returncode is not None for process in processes)
