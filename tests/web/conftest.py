"""The page served by a process of its own, and a real browser where there is one."""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

#: Pictures that the tests take, to be looked at.
PICTURES = Path(__file__).resolve().parents[2] / "out" / "page"
LIMIT_MB = 100
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
VIBRIDENT = (sys.executable, "-c", "from vibrident.cli import main; main()")


class Server:
    """A running ``vibrident serve``."""

    def __init__(self, process: subprocess.Popen[str], address: str, busy_s: float, log: Path, folder: Path) -> None:
        self.process, self.address, self.busy_s, self.log, self.folder = process, address, busy_s, log, folder


@pytest.fixture(scope="session")
def server(tmp_path_factory) -> Iterator[Server]:
    """``vibrident serve`` on a free port, its temporary files in a folder of the tests."""
    with serving(tmp_path_factory.mktemp("serve"), *VIBRIDENT, "serve", "--limit-mb", str(LIMIT_MB)) as made:
        yield made


@contextlib.contextmanager
def serving(folder: Path, *command: str) -> Iterator[Server]:
    """A server of a command, which leaves no temporary file behind."""
    pytest.importorskip("nicegui")
    begin = time.monotonic()
    log = folder / "log"
    environment = {**os.environ, "TMPDIR": str(folder), "PYTHONUNBUFFERED": "1"}
    for name in [name for name in environment if name.startswith(("NICEGUI", "PYTEST"))]:
        del environment[name]
    with (
        log.open("w") as errors,
        subprocess.Popen(
            [*command, "--no-browser"], stdout=subprocess.PIPE, stderr=errors, text=True, env=environment
        ) as made,
    ):
        try:
            yield _ready(made, begin, log, folder)
        finally:
            made.terminate()  # a suite in the background ignores SIGINT, and its children with it
            try:
                made.wait(20)
            except subprocess.TimeoutExpired:
                made.kill()
                raise
    assert not [path for path in folder.iterdir() if path.name.startswith("vibrident-")], "temporary files are left"


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
    found = re.search(r"http://\S+", line)
    assert found, line + process.stdout.read() + log.read_text()
    while time.monotonic() < begin + 20.0:
        try:
            with urllib.request.urlopen(found.group(), timeout=5) as answer:
                answer.read()
            return Server(process, found.group(), _busy_s(process.pid, time.monotonic() - begin), log, folder)
        except OSError:
            time.sleep(0.05)
    raise AssertionError("the page does not answer")


def _chromium() -> str | None:
    """The browser to start: the one that VIBRIDENT_CHROMIUM names, else the system's. None leaves it to playwright."""
    installed = map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))
    return os.environ.get("VIBRIDENT_CHROMIUM") or next(filter(None, installed), None)


@pytest.fixture(scope="session")
def browser():
    """Headless Chromium that asks the network for nothing of its own."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    with playwright.sync_playwright() as started:
        try:
            running = started.chromium.launch(executable_path=_chromium(), args=CHROMIUM_FLAGS)
        except playwright.Error as error:
            reason = str(error).splitlines()[0]
            pytest.skip(
                f"no Chromium ({reason}): install the system's, run playwright install chromium, or set "
                "VIBRIDENT_CHROMIUM"
            )
        yield running
        running.close()


@pytest.fixture
def visit(server, browser):
    """Open the page in a context of its own; every request that leaves the server's address fails the test."""
    contexts, foreign, complaints = [], [], []

    def open_page(width: int = 1280, height: int = 900, *, may_complain: bool = False):
        context = browser.new_context(viewport={"width": width, "height": height}, accept_downloads=True)
        contexts.append(context)
        page = context.new_page()
        here = (server.address, server.address.replace("http", "ws"), "data:", "blob:")
        page.on("request", lambda request: None if request.url.startswith(here) else foreign.append(request.url))
        if not may_complain:
            page.on("pageerror", lambda error: complaints.append(str(error)))
            page.on("console", lambda said: complaints.append(said.text) if said.type == "error" else None)
        page.goto(server.address)
        page.get_by_role("heading", name="Data").wait_for()
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert not foreign
    assert not complaints


def upload(page, *files: Path) -> None:
    """Choose files on the page."""
    page.locator("input[type=file][multiple]").first.set_input_files([str(file) for file in files])


def simulated(folder: Path, *arguments: str) -> list[Path]:
    """A short calibration of known truth, without what its columns mean."""
    made = ("simulate", "--out", ".", "--samples", "2000", "--rate", "12800", "--seed", "4")
    command = [*VIBRIDENT, *made, *arguments]
    folder.mkdir(exist_ok=True)
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    (folder / "calibration.toml").unlink()
    return sorted(folder.glob("*.csv"))


@pytest.fixture(scope="session")
def picture():
    """Take a picture of the whole page."""

    def take(page, name: str) -> None:
        PICTURES.mkdir(parents=True, exist_ok=True)
        page.screenshot(path=PICTURES / f"{name}.png", full_page=True)

    return take
