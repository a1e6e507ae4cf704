"""Pictures appear whether or not there is a process to draw them."""

import shutil

import pytest

from vibrident.app.cli import drawing
from vibrident.result import Result

PICTURES = ["deviation.png", "residuals.png", "sensitivity.png", "signals.png", "training.png"]


@pytest.fixture
def saved(identified, tmp_path):
    return shutil.copy(identified, tmp_path / "result.json")


def crash():
    raise SystemExit(1)


def drawn(saved):
    with drawing.painter() as artist:
        artist.draw(Result.load(saved), saved)
    return sorted(file.name for file in saved.parent.glob("*.png"))


def test_by_a_process(saved, monkeypatch):
    monkeypatch.setattr(drawing, "processors", lambda: 2)
    monkeypatch.setattr("vibrident.show.plots.save_all", lambda *_: pytest.fail("the process should have drawn"))
    assert drawn(saved) == PICTURES


def test_with_one_core(saved, monkeypatch):
    monkeypatch.setattr(drawing, "processors", lambda: 1)
    monkeypatch.setattr(drawing.Process, "start", lambda _: pytest.fail("no process should be started"))
    assert drawn(saved) == PICTURES


@pytest.fixture
def blank(monkeypatch):
    """Pictures drawn in this process are empty files."""
    monkeypatch.setattr(
        "vibrident.show.plots.save_all", lambda _, folder: [(folder / name).touch() for name in PICTURES]
    )


def test_when_a_process_fails(saved, blank, monkeypatch):
    monkeypatch.setattr(drawing, "processors", lambda: 2)
    monkeypatch.setattr(drawing, "prepare", crash)
    assert drawn(saved) == PICTURES


def test_when_no_process_can_be_started(saved, blank, monkeypatch):
    monkeypatch.setattr(drawing, "processors", lambda: 2)
    monkeypatch.setattr("sys.executable", "/nowhere/python")
    assert drawn(saved) == PICTURES


def test_the_process_ends_with_the_block(monkeypatch):
    monkeypatch.setattr(drawing, "processors", lambda: 2)
    with drawing.painter() as artist:
        assert artist._process is not None
        assert artist._process.alive
    assert not artist._process.alive
