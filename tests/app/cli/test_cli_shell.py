"""The command as a shell sees it: a process with streams, an environment and signals."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

VIBRIDENT = [sys.executable, "-m", "vibrident"]


def shell(*arguments, **environment):
    """Run a process of its own; return it when it is done."""
    return subprocess.run(
        [*VIBRIDENT, *map(str, arguments)],
        env={**os.environ, **environment},
        capture_output=True,
        timeout=300,
        check=False,
    )


def test_a_bad_file_is_one_message_and_no_jax(made, tmp_path):
    done = shell("identify", tmp_path / "none.toml", "--out", tmp_path / "out")
    assert done.returncode == 2
    assert done.stdout == b""
    assert done.stderr.startswith(b"Error: ")
    assert list(tmp_path.iterdir()) == []


def test_redirected_output_is_plain_text_and_names_of_the_folder_are_no_modules(made, tmp_path):
    (tmp_path / "matplotlib.py").write_text("raise SystemExit('the wrong module')")
    code = "import sys; sys.path = [p for p in sys.path if p]; from vibrident.app.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "identify", str(made / "calibration.toml"), "--out", "out"],
        env={**os.environ, "TERM": "xterm-256color"}, cwd=tmp_path, capture_output=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stderr == b""  # no log lines of a library either
    assert b"\x1b" not in done.stdout
    assert "mV/(m/s²)" in done.stdout.decode()
    assert (tmp_path / "out" / "signals.png").is_file()


@pytest.mark.skipif(os.name != "posix", reason="closed as a shell of POSIX closes them")
def test_closed_streams_change_no_exit_code(tmp_path):
    command = ["sh", "-c", 'exec "$@" <&- >&- 2>&-', "sh", *VIBRIDENT, "identify", str(tmp_path / "none.toml")]
    assert subprocess.run(command, check=False).returncode == 2


@pytest.mark.skipif(sys.platform != "linux", reason="names of any bytes as Linux has them")
def test_names_that_are_no_utf_8_give_a_result_that_is(run, calibration, tmp_path):
    folder = Path(os.fsdecode(os.fsencode(calibration.parent) + b"-f\xfcr"))
    calibration.parent.rename(folder)
    (folder / "100_Hz.csv").rename(os.fsdecode(os.fsencode(folder) + b"/M\xfcller.csv"))
    file = folder / calibration.name
    text = file.read_text("utf-8").partition("[[records]]")[0]
    file.write_text(text + '[[records]]\nfile = "*.csv"\nexcitation = "sine"\n', "utf-8")
    for command, less in (("identify", "--no-pictures"), ("compare", "--estimators=ml,lsm")):
        done = run(command, file, "--out", tmp_path / command, less)
        assert done.exit_code == 0, done.output
    document = json.loads((tmp_path / "identify" / "result.json").read_text("utf-8"))
    assert "M?ller.csv" in document["measured"]["record"]


def test_an_ascii_terminal_gets_question_marks(identified, made, tmp_path):
    done = shell("inspect", made / "calibration.toml", "--out", tmp_path, PYTHONIOENCODING="ascii", LC_ALL="C")
    assert done.returncode == 0, done.stderr
    assert b"m/s?" in done.stdout
    done.stdout.decode("ascii")


def test_a_reader_that_leaves_is_no_traceback(made, tmp_path):
    process = subprocess.Popen(
        [*VIBRIDENT, "inspect", str(made / "calibration.toml"), "--out", str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdout is not None
    process.stdout.close()
    assert process.stderr is not None
    assert b"Traceback" not in process.stderr.read()
    process.wait(timeout=120)
    process.stderr.close()


#: Options with which identify computes for longer than the test waits on any machine.
LONG = ("--estimator", "ipnn", "--optimiser", "adam", "--steps", "1000000")


@pytest.mark.needs("network")
@pytest.mark.skipif(os.name != "posix", reason="signals as POSIX has them")
@pytest.mark.parametrize(
    ("number", "delay_s"),
    [(signal.SIGINT, 0.2), (signal.SIGTERM, 0.6), (signal.SIGINT, 1.5), (signal.SIGTERM, 1.5)],
    ids=["reading", "loading", "computing", "computing-terminated"],
)
@pytest.mark.quick("reading", "loading", "computing")
def test_a_signal_leaves_nothing_behind(number, delay_s, made, tmp_path):
    # A suite that runs in the background ignores SIGINT, and its children would with it.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    process = subprocess.Popen(
        [*VIBRIDENT, "identify", str(made / "calibration.toml"), *LONG, "--out", str(tmp_path / "out")],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    signal.signal(signal.SIGINT, before)
    deadline = time.monotonic() + 60
    while not any(Path(tmp_path).iterdir()) and time.monotonic() < deadline:
        time.sleep(0.01)
    time.sleep(delay_s)
    process.send_signal(number)
    _, error = process.communicate(timeout=60)
    assert process.returncode == 128 + number
    assert error == b""
    assert list(tmp_path.iterdir()) == []
