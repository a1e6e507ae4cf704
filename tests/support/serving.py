"""A server of the page in a process of its own, and what is done with it in many tests."""

from __future__ import annotations

import asyncio
import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Coroutine, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

import pytest
from tests.support.shell import printed

_T = TypeVar("_T")
VIBRIDENT = (sys.executable, "-m", "vibrident")
WAIT_MS = 120_000  # longest wait of a test for the page


CHROMIUM_FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


class Server:
    """A running ``vibrident serve``."""

    def __init__(self, process: subprocess.Popen[str], address: str, busy_s: float, log: Path, folder: Path) -> None:
        self.process, self.address, self.busy_s, self.log, self.folder = process, address, busy_s, log, folder


@contextlib.contextmanager
def serving(folder: Path, *command: str, ending: int = signal.SIGTERM) -> Iterator[Server]:
    """A server of a command, which leaves no temporary file behind; ``ending`` is the signal that ends it."""
    pytest.importorskip("nicegui")
    begin = time.monotonic()
    log = folder / "log"
    folders = {"TMPDIR": str(folder), "XDG_DATA_HOME": str(folder / "data"), "PYTHONUNBUFFERED": "1"}
    environment = os.environ | folders
    for name in [name for name in environment if name.startswith(("NICEGUI", "PYTEST"))]:
        del environment[name]
    with (
        log.open("w") as errors,
        subprocess.Popen(
            [*command, "--no-browser"], stdout=subprocess.PIPE, stderr=errors, text=True, env=environment
        ) as process,
    ):
        try:
            yield _ready(process, begin, log, folder)
        finally:
            process.send_signal(ending)  # a suite in the background ignores SIGINT, and its children with it
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                raise
    leftovers = [path for path in folder.iterdir() if path.name.startswith("vibrident-")]
    assert ending != signal.SIGTERM or not leftovers, "temporary files are left"


def _busy_s(pid: int, elapsed_s: float) -> float:
    """Computing time of a process: the other tests keep it waiting. Where the system does not say, the time passed."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return elapsed_s
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _ready(process: subprocess.Popen[str], begin: float, log: Path, folder: Path) -> Server:
    assert process.stdout is not None
    line = process.stdout.readline()
    match = re.search(r"http://\S+", line)
    assert match, line + process.stdout.read() + log.read_text()
    while time.monotonic() < begin + WAIT_MS / 1000:
        try:
            with (
                contextlib.suppress(urllib.error.HTTPError),
                urllib.request.urlopen(match.group(), timeout=5) as answer,
            ):
                answer.read()  # a refusal is an answer too
            return Server(process, match.group(), _busy_s(process.pid, time.monotonic() - begin), log, folder)
        except OSError:
            time.sleep(0.05)
    raise AssertionError("the page does not answer")


def alone(coroutine: Coroutine[Any, Any, _T]) -> _T:
    """Run a coroutine in a thread: the browser of other tests has a loop in this one."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(asyncio.run, coroutine).result()


def upload(page, *files: Path) -> None:
    """Choose files on the page."""
    page.locator("input[type=file][multiple]").first.set_input_files([str(file) for file in files])


def download(page, name: str) -> bytes:
    """The file that a button of the page gives."""
    with page.expect_download(timeout=WAIT_MS) as waiting:
        page.locator(f"#get-{name}").click()
    return Path(waiting.value.path()).read_bytes()


def start_anew(page) -> None:
    """Remove all from the page; where there is nothing it does not ask."""
    page.get_by_role("button", name="Start anew").click()
    remove = page.get_by_role("button", name="Remove all")
    remove.or_(page.get_by_text("No data yet.")).first.wait_for()
    if remove.is_visible():
        remove.click()


def field(page, label: str):
    """What the person can fill in or choose under this label."""
    return page.get_by_label(label, exact=True).locator("visible=true")


def choose(page, label: str, option: str) -> None:
    """Choose from a list of the page."""
    field(page, label).click()
    page.get_by_role("option", name=option, exact=True).click()


def simulated(folder: Path, *arguments: str) -> list[Path]:
    """A short calibration of known truth, without what its columns mean."""
    folder.mkdir(exist_ok=True)
    settings = ("--samples", "2000", "--rate", "12800", "--seed", "4")
    printed("simulate", "--out", ".", *settings, *arguments, folder=folder)
    (folder / "calibration.toml").unlink()
    return sorted(folder.glob("*.csv"))


def chromium() -> str | None:
    """The browser to start: the one that VIBRIDENT_CHROMIUM names, else the system's. None leaves it to playwright."""
    installed = map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))
    return os.environ.get("VIBRIDENT_CHROMIUM") or next(filter(None, installed), None)
