"""Draw pictures in another process, which loads matplotlib while this one computes.

There is one such process, which draws with a copy of itself: a second one that loads matplotlib,
too, delays the identification by more than it saves on two cores.
"""

from __future__ import annotations

import contextlib
import gc
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from vibrident.app.workflow.interruption import tidied_up
from vibrident.base.process import Process, ProcessDied, WorkerError, processors

if TYPE_CHECKING:
    from vibrident.result import Result

DRAWN_BY_COPY = ("deviation", "signals")  # pictures that take about as long as the others


class Painter:
    """Draws results in a process that waits for them; in this one if there is none."""

    def __init__(self, process: Process | None) -> None:
        self._process = process

    def draw(self, result: Result, file: Path) -> None:
        """Draw every picture of the result, saved as ``file``, as PNG beside it."""
        if self._process is not None and self._process.alive:
            with contextlib.suppress(ProcessDied, WorkerError, OSError):
                return self._process.call(draw, file.resolve())
        from vibrident.show import plots

        # no process, or it failed: draw here, where an error shows
        plots.save_all(result, file.parent)
        return None


@contextlib.contextmanager
def painter(*, is_needed: bool = True) -> Iterator[Painter]:
    """Start the process if there is a core for it; end it with the block."""
    if not is_needed or processors() < 2:
        yield Painter(None)
        return
    with Process(prepare) as process, tidied_up(process.kill):
        with contextlib.suppress(OSError):  # no room for another process: draw here
            process.start()
        yield Painter(process)


def prepare() -> None:
    """Load matplotlib, and what reads a result, in the drawing process."""
    gc.disable()  # figures are full of cycles, and this process ends soon
    import matplotlib.backends.backend_agg
    import matplotlib.figure
    import matplotlib.style  # noqa: F401

    from vibrident.result.result import adapter
    from vibrident.show import plots  # noqa: F401
    from vibrident.show.media.drawing import content
    from vibrident.show.views import Figure

    adapter()
    content(Figure("", "", ()), "png")  # loads fonts and encoder


def draw(file: Path) -> None:
    """Draw every picture of a saved result beside it, in the drawing process.

    A copy of the process does about half of the work.
    """
    from vibrident.result import Result
    from vibrident.show import plots

    result = Result.load(file)
    remaining = [name for name in plots.PICTURES if name not in DRAWN_BY_COPY]
    copy = os.fork() if hasattr(os, "fork") else None
    if copy == 0:
        with contextlib.suppress(BaseException):  # then they are drawn below, where an error shows
            plots.save_all(result, file.parent, names=DRAWN_BY_COPY)
            os._exit(0)
        os._exit(1)
    plots.save_all(result, file.parent, names=remaining)
    if copy is None or os.waitpid(copy, 0)[1]:
        plots.save_all(result, file.parent, names=DRAWN_BY_COPY)
