"""Pictures appear whether or not there is a process to draw them."""

import shutil

import pytest

from vibrident.cli import drawing
from vibrident.result import Result

PICTURES = ["deviation.png", "residuals.png", "sensitivity.png", "signals.png", "training.png"]


@pytest.fixture
def saved(identified, tmp_path):
    return shutil.copy(identified, tmp_path / "result.json")


def drawn(saved):
    with drawing.painter() as artist:
        artist.draw(Result.load(saved), saved)
    return sorted(file.name for file in saved.parent.glob("*.png"))


def test_by_a_process(saved, monkeypatch):
    monkeypatch.setattr(drawing, "cores", lambda: 2)
    monkeypatch.setattr("vibrident.plots.save_all", lambda *_: pytest.fail("the process should have drawn"))
    assert drawn(saved) == PICTURES


def test_with_one_core(saved, monkeypatch):
    monkeypatch.setattr(drawing, "cores", lambda: 1)
    monkeypatch.setattr(drawing, "_start", lambda: pytest.fail("no process should be started"))
    assert drawn(saved) == PICTURES


def test_when_a_process_fails(saved, monkeypatch):
    monkeypatch.setattr(drawing, "cores", lambda: 2)
    monkeypatch.setattr(drawing, "_WORKER", "raise SystemExit(1)")
    assert drawn(saved) == PICTURES


def test_when_no_process_can_be_started(saved, monkeypatch):
    monkeypatch.setattr(drawing, "cores", lambda: 2)
    monkeypatch.setattr("sys.executable", "/nowhere/python")
    assert drawn(saved) == PICTURES


def test_the_process_ends_with_the_block(monkeypatch):
    monkeypatch.setattr(drawing, "cores", lambda: 2)
    with drawing.painter() as artist:
        process = artist._process
        assert process is not None
        assert process.poll() is None
    assert process.returncode is not None
