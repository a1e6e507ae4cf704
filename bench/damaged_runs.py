"""Commands on damaged files, in a long-lived process; one that ends it is run again alone."""

from __future__ import annotations

import contextlib
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.damaged_bombs import GROUPS, write_bomb
from bench.damaged_files import DAMAGES, ROOT, WRITERS, whole_files, whole_result, write_damaged

FILES = (*WRITERS, "c.toml", "result.json")
CASE_LIMIT_S = 20  # time limit of a case in the long-lived process
COMMAND_LIMIT_S = 150  # time limit of a command
MAX_MEMORY_BYTES = 1_000_000_000
_ROOM_BYTES = 2_500_000_000
_COMMAND = "from vibrident.app.cli import main; main()"
_SERVE = "from bench.damaged_runs import serve; serve()"


@dataclass(frozen=True)
class Cell:
    """Kind of file and kind of damage; or a group of bombs."""

    file: str
    damage: str

    @property
    def name(self) -> str:
        """Return the name for files and the command line."""
        return f"{self.file}/{self.damage}"

    def runs(self, requested: int) -> int:
        """Return the requested number; each bomb once."""
        return len(GROUPS[self.file]) if self.damage == "bombs" else requested


CELLS = (
    *(Cell(file, damage) for file in FILES for damage in DAMAGES),
    *(Cell(group, "bombs") for group in GROUPS),
)


def block(name: str, runs: range) -> dict[str, Any]:
    """Some files of a cell: a command's outcome for each."""
    cell = next(cell for cell in CELLS if cell.name == name)
    return {"runs": [run(cell, number) for number in runs]}


def run(cell: Cell, number: int) -> dict[str, Any]:
    """Run a file: ``outcome`` (read, refused, or what must not be), ``peak_bytes``, ``said``."""
    with tempfile.TemporaryDirectory(prefix="damaged-") as temporary:
        folder = Path(temporary) / "case"
        folder.mkdir()
        bomb = cell.damage == "bombs"
        if bomb:
            target = write_bomb(folder, GROUPS[cell.file][number])
        else:
            target = write_damaged(
                folder,
                cell.file,
                cell.damage,
                number,
                _undamaged(result=cell.file == "result.json"),
            )
        before = _paths_in(folder)
        outcome_of_run: dict[str, Any] = (
            {"outcome": "as a command"} if bomb else WORKER.ask({"target": str(target)})
        )
        if outcome_of_run["outcome"] not in ("read", "refused"):
            first = outcome_of_run["outcome"]
            shutil.rmtree(folder / "out", ignore_errors=True)
            outcome_of_run = {**_as_a_command(target), "first": first}
        strays = sorted(name for name in _paths_in(folder) - before if not name.startswith("out"))
        if strays:
            outcome_of_run = {
                **outcome_of_run,
                "outcome": "a file outside --out",
                "said": ", ".join(strays),
            }
        return {"number": number, **outcome_of_run}


def _paths_in(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


_UNDAMAGED_FILES: dict[str, bytes] = {}


def _undamaged(*, result: bool) -> dict[str, bytes]:
    if not _UNDAMAGED_FILES:
        with tempfile.TemporaryDirectory() as folder:
            _UNDAMAGED_FILES.update(whole_files(Path(folder)))
    if result and "result.json" not in _UNDAMAGED_FILES:
        with tempfile.TemporaryDirectory() as folder:
            _UNDAMAGED_FILES["result.json"] = whole_result(Path(folder))
    return _UNDAMAGED_FILES


def arguments(target: Path) -> list[str]:
    """Return what the command is given."""
    words = ["report", "--format", "html"] if target.suffix == ".json" else ["inspect"]
    return [*words, str(target), "--out", str(target.parent / "out")]


class _Worker:
    """A process that runs commands one after another, in itself."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[str] | None = None

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()

    def ask(self, case: dict[str, Any]) -> dict[str, Any]:
        if self._process is None or self._process.poll() is not None:
            self._process = subprocess.Popen(
                [sys.executable, "-c", _SERVE],
                cwd=ROOT,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
            )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(json.dumps(case) + "\n")
        self._process.stdin.flush()
        answer = self._process.stdout.readline()
        if answer:
            return json.loads(answer)
        return {"outcome": f"crash ({self._process.wait()})", "said": ""}


WORKER = _Worker()


class _OutOfTime(BaseException):
    pass


def serve() -> None:
    """Main of the worker: a case a line, an answer a line."""
    import vibrident.data.io
    from vibrident.base.process import Limits, set_limits

    # Without the separate process, which would hide failures.
    vibrident.data.io.read_guarded = vibrident.data.io.read
    stream = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    set_limits(Limits(memory_bytes=_ROOM_BYTES))
    signal.signal(signal.SIGALRM, _ring)
    for line in sys.stdin:
        answer = _in_here(Path(json.loads(line)["target"]))
        stream.write(json.dumps(answer) + "\n")
        stream.flush()
        if answer["outcome"] == "time" or answer["peak_bytes"] > MAX_MEMORY_BYTES:
            return  # with what it still holds


def _ring(*_: Any) -> None:
    raise _OutOfTime


def _in_here(target: Path) -> dict[str, Any]:
    from vibrident.app.cli import app

    output = io.StringIO()
    _forget_peak()
    signal.setitimer(signal.ITIMER_REAL, CASE_LIMIT_S)
    outcome = "time"
    more = ""
    with (
        contextlib.redirect_stdout(output),
        contextlib.redirect_stderr(output),
        contextlib.suppress(_OutOfTime),
    ):
        try:
            app(arguments(target))
        except SystemExit as end:
            outcomes: dict[object, str] = {0: "read", None: "read", 2: "refused"}
            outcome = outcomes.get(end.code, f"exit {end.code}")
        except Exception as error:
            outcome = "traceback"
            more = traceback.format_exc()[-1500:] or repr(error)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
    peak = _peak_bytes()
    if outcome in ("read", "refused") and peak > MAX_MEMORY_BYTES:
        outcome = "memory"
    return {"outcome": outcome, "peak_bytes": peak, "said": (more or output.getvalue())[-1500:]}


def _forget_peak() -> None:
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _peak_bytes() -> int:
    lines: Iterator[str] = iter(Path("/proc/self/status").read_text().splitlines())
    return 1024 * int(next(line for line in lines if line.startswith("VmHWM")).split()[1])


def _as_a_command(target: Path) -> dict[str, Any]:
    command = [sys.executable, "-c", _COMMAND, *arguments(target)]
    child = [sys.executable, "-I", "-S", str(ROOT / "bench" / "child.py"), *command]
    with tempfile.TemporaryFile("w+") as output:
        try:
            done = subprocess.run(
                child,
                stdout=subprocess.PIPE,
                stderr=output,
                text=True,
                timeout=COMMAND_LIMIT_S,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return {"outcome": "time", "peak_bytes": 0, "said": ""}
        output.seek(0)
        text = output.read()[-1500:]
    outcome_of_run = json.loads(done.stdout)
    outcome = {0: "read", 2: "refused"}.get(
        outcome_of_run["status"], f"exit {outcome_of_run['status']}"
    )
    if "Traceback" in text:
        outcome = "traceback"
    elif outcome_of_run["peak_bytes"] > MAX_MEMORY_BYTES and outcome in ("read", "refused"):
        outcome = "memory"
    return {"outcome": outcome, "peak_bytes": outcome_of_run["peak_bytes"], "said": text}
