"""Pictures drawn by other processes, which load matplotlib while this one computes.

Loading matplotlib and drawing take about as long as an identification, and neither shares a core well with it.
"""

from __future__ import annotations

import contextlib
import gc
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from vibrident.workflow.interruption import tidied_up

if TYPE_CHECKING:
    from vibrident.result import Result

#: Pictures that one process draws; the other draws the rest, which takes about as long.
_FIRST_SHARE = ("signals", "training")
_WORKER = "from vibrident.cli.drawing import work; work()"


class Painters:
    """Processes waiting for a result to draw."""

    def __init__(self, processes: list[subprocess.Popen[bytes]]) -> None:
        self._processes = processes

    def draw(self, result: Result, file: Path) -> None:
        """Draw every picture of the result, saved as ``file``, as PNG beside it."""
        from vibrident import plots

        names = plots.applicable(result)
        shares = [[n for n in names if n in _FIRST_SHARE], [n for n in names if n not in _FIRST_SHARE]]
        if len(self._processes) == len(shares):
            for process, share in zip(self._processes, shares, strict=True):
                _ask(process, file, share)
            done = [process.wait() == 0 for process in self._processes]
            if all(done):
                return
        plots.save_all(result, file.parent)  # no processes, or they failed: draw here, where an error shows

    def kill(self) -> None:
        """End the processes without waiting."""
        for process in self._processes:
            process.kill()

    def dismiss(self) -> None:
        """End processes that are no longer needed."""
        self.kill()
        for process in self._processes:
            process.communicate()


@contextlib.contextmanager
def painters(*, wanted: bool = True) -> Iterator[Painters]:
    """Start the processes if there is a core for them; end them with the block."""
    started = Painters([])
    if wanted and _cores() > 1:
        with contextlib.suppress(OSError):  # no room for more processes: draw here
            started = Painters([_start(), _start()])
    try:
        with tidied_up(started.kill):
            yield started
    finally:
        started.dismiss()


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _start() -> subprocess.Popen[bytes]:
    # -P: no imports from the user's folder. A new session: Ctrl-C reaches only this process.
    command = [sys.executable, "-P", "-c", _WORKER]
    silent = subprocess.DEVNULL
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=silent, stderr=silent, start_new_session=True)


def _ask(process: subprocess.Popen[bytes], file: Path, pictures: list[str]) -> None:
    assert process.stdin is not None
    with contextlib.suppress(OSError):  # it died; its exit code shows that
        process.stdin.write(json.dumps({"result": str(file.resolve()), "pictures": pictures}).encode())
        process.stdin.close()


def work() -> None:
    """Main of a drawing process: load matplotlib, read one task from stdin, draw it; no task: end."""
    gc.disable()  # figures are full of cycles, and this process ends soon
    import matplotlib.backends.backend_agg
    import matplotlib.figure
    import matplotlib.style  # noqa: F401
    from pydantic import TypeAdapter

    from vibrident import plots
    from vibrident.result import Result

    TypeAdapter(Result)  # the slowest part of reading a result
    task = sys.stdin.buffer.read()
    if not task:
        return
    order = json.loads(task)
    file = Path(order["result"])
    result = Result.load(file)
    for name in order["pictures"]:
        plots.save(plots.PICTURES[name](result), file.with_name(f"{name}.png"))
