"""Files appear together or not at all, and a bug keeps its traceback."""

import shutil
from pathlib import Path

import pytest

from vibrident.app.workflow.folder import written_whole
from vibrident.base.errors import InputError


def write_half(target, error):
    with written_whole(target) as folder:
        (folder.path / "result.json").write_text("new")
        raise error


def test_files_appear_when_the_block_ends(tmp_path):
    target = tmp_path / "new" / "out"
    with written_whole(target) as folder:
        (folder.path / "b.txt").write_text("b")
        (folder.path / "result.json").write_text("{}")
        (folder.path / "sub").mkdir()
        (folder.path / "sub" / "a.txt").write_text("a")
        assert not target.exists()
    assert [str(file.relative_to(target)) for file in folder.files] == ["result.json", "b.txt", "sub/a.txt"]
    assert [file.name for file in target.parent.iterdir()] == ["out"]


@pytest.mark.parametrize("error", [KeyboardInterrupt, RuntimeError, SystemExit])
def test_an_interrupted_block_leaves_nothing(error, tmp_path):
    with pytest.raises(error):
        write_half(tmp_path / "new" / "out", error)
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_block_leaves_what_was_there(tmp_path):
    (tmp_path / "result.json").write_text("old")
    with pytest.raises(RuntimeError):
        write_half(tmp_path, RuntimeError)
    assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [("result.json", "old")]


def test_the_folder_one_is_in(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with written_whole(Path()) as folder:
        (folder.path / "a.txt").write_text("a")
        assert folder.path.parent == Path()  # the folder above may not be ours to write
    assert [file.name for file in tmp_path.iterdir()] == ["a.txt"]


def test_no_output_replaces_an_input(tmp_path):
    raw = tmp_path / "a.csv"
    raw.write_text("raw")

    def write_over():
        with written_whole(tmp_path, [raw]) as folder:
            (folder.path / "result.json").write_text("{}")
            (folder.path / "a.csv").write_text("new")

    with pytest.raises(InputError, match="would replace"):
        write_over()
    assert [(file.name, file.read_text()) for file in tmp_path.iterdir()] == [("a.csv", "raw")]


@pytest.mark.parametrize("command", ["correct", "predict", "track", "identify"])
def test_raw_data_and_results_survive_every_command(run, made, identified, tmp_path, command):
    """The output folder is the one of the data and of the result."""
    folder = tmp_path / "data"
    shutil.copytree(made, folder)
    shutil.copy(identified, folder / "result.json")
    before = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    arguments = [folder / "calibration.toml", "--out", folder, "--no-pictures"]
    if command == "predict":
        arguments.remove("--no-pictures")
    if command != "identify":
        arguments.insert(0, folder / "result.json")
    done = run(command, *arguments)
    assert done.exit_code == (0 if command == "identify" else 2), done.output
    assert all(file.read_bytes() == held for file, held in before.items() if file.name != "result.json")
    if command != "identify":
        assert (folder / "result.json").read_bytes() == before[folder / "result.json"]


def test_a_full_disk_is_no_traceback(tmp_path):
    with pytest.raises(InputError, match="No space left"), written_whole(tmp_path / "out"):
        raise OSError(28, "No space left on device")
    assert list(tmp_path.iterdir()) == []


def test_a_bug_is_not_hidden(run, made, tmp_path, monkeypatch):
    def broken(*_, **__):
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr("vibrident.data.io.read_guarded", broken)
    done = run("identify", made / "calibration.toml", "--out", tmp_path / "out")
    assert isinstance(done.exception, ZeroDivisionError)
    assert list(tmp_path.iterdir()) == []


def test_ctrl_c_is_no_traceback(run, made, tmp_path, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("vibrident.data.io.read_guarded", interrupted)
    done = run("identify", made / "calibration.toml", "--out", tmp_path / "out")
    assert done.exit_code == 130
    assert "Traceback" not in done.output
    assert list(tmp_path.iterdir()) == []
