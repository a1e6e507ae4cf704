"""Pictures drawn by another process, which loads matplotlib while this one computes.

One process: a second one that loads matplotlib, too, delays the identification by more than it saves on two cores.
"""

from __future__ import annotations

import contextlib
import gc
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from vibrident.workflow.interruption import tidied_up

if TYPE_CHECKING:
    from vibrident.result import Result

_WORKER = "from vibrident.cli.drawing import work; work()"


class Painter:
    """A process waiting for a result to draw; None: there is none."""

    def __init__(self, process: subprocess.Popen[bytes] | None) -> None:
        self._process = process

    def draw(self, result: Result, file: Path) -> None:
        """Draw every picture of the result, saved as ``file``, as PNG beside it."""
        if self._process is not None:
            _ask(self._process, file)
            if self._process.wait() == 0:
                return
        from vibrident import plots

        plots.save_all(result, file.parent)  # no process, or it failed: draw here, where an error shows

    def kill(self) -> None:
        """End the process without waiting."""
        if self._process is not None:
            self._process.kill()

    def dismiss(self) -> None:
        """End the process, which is no longer needed."""
        self.kill()
        if self._process is not None:
            self._process.communicate()


@contextlib.contextmanager
def painter(*, wanted: bool = True) -> Iterator[Painter]:
    """Start the process if there is a core for it; end it with the block."""
    started = Painter(None)
    if wanted and cores() > 1:
        with contextlib.suppress(OSError):  # no room for another process: draw here
            started = Painter(_start())
    try:
        with tidied_up(started.kill):
            yield started
    finally:
        started.dismiss()


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _start() -> subprocess.Popen[bytes]:
    # -P: no imports from the user's folder. A new session: Ctrl-C reaches only this process.
    command = [sys.executable, "-P", "-c", _WORKER]
    silent = subprocess.DEVNULL
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=silent, stderr=silent, start_new_session=True)


def _ask(process: subprocess.Popen[bytes], file: Path) -> None:
    assert process.stdin is not None
    with contextlib.suppress(OSError):  # it died; its exit code shows that
        process.stdin.write(os.fsencode(file.resolve()))
        process.stdin.close()


def work() -> None:
    """Main of a drawing process: load matplotlib, read the name of a result from stdin, draw it; no name: end."""
    gc.disable()  # figures are full of cycles, and this process ends soon
    import matplotlib.backends.backend_agg
    import matplotlib.figure
    import matplotlib.style  # noqa: F401
    from pydantic import TypeAdapter

    from vibrident import plots
    from vibrident.present.drawing import content
    from vibrident.present.views import Figure
    from vibrident.result import Result

    TypeAdapter(Result)  # the slowest part of reading a result
    content(Figure("", "", ()), "png")  # loads fonts and encoder
    task = sys.stdin.buffer.read()
    if not task:
        return
    file = Path(os.fsdecode(task))
    plots.save_all(Result.load(file), file.parent)
