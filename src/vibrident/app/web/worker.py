"""Run long work in a separate process, so that the page stays responsive and can cancel it.

The process works in the folder of the data, as the command line does. A crash leaves the page
alive.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from vibrident.app.web.confinement import confinement_command
from vibrident.base.errors import InputError
from vibrident.base.process import Limits, Process, ProcessDied, ProcessEnded, WorkerError

#: Memory of an identification, bytes, and further memory for each byte of data.
_BASE_MEMORY_BYTES = 4_000_000_000
_MEMORY_BYTES_PER_DATA_BYTE = 20
_MAX_SECONDS = 7200.0
_MAX_FILE_BYTES = 1_000_000_000
_LOG = logging.getLogger("vibrident.app.web")


class StoppedError(InputError):
    """The process was ended before its task was done: by a limit or a signal."""


class Worker:
    """A process for one task at a time."""

    def __init__(self) -> None:
        self._process: Process | None = None

    def cancel(self) -> None:
        """End the running task."""
        if self._process is not None:
            self._process.end()

    async def run(
        self,
        task: Callable[..., Any],
        *args: Any,
        folder: Path,
        progress: Callable[..., object] | None = None,
    ) -> Any:
        """Run a function of this module in the folder and return its result.

        Raises:
            InputError, NotConverged: as the task does.
            StoppedError: the process was ended by a limit or a signal.
            WorkerError: any other failure in the process.
            asyncio.CancelledError: it was cancelled.
        """
        loop = asyncio.get_running_loop()
        memory_bytes = _BASE_MEMORY_BYTES + _MEMORY_BYTES_PER_DATA_BYTE * sum(
            path.stat().st_size for path in folder.iterdir()
        )
        limits = Limits(_MAX_SECONDS, memory_bytes, _MAX_FILE_BYTES)
        report = None if progress is None else partial(loop.call_soon_threadsafe, progress)
        self._process = process = Process(
            folder=folder, wrapper=confinement_command(folder, writable=True)
        )
        try:
            return await asyncio.to_thread(
                process.call, task, *args, limits=limits, progress=report
            )
        except ProcessEnded:
            raise asyncio.CancelledError from None
        except ProcessDied as death:
            raise _stopped_error(death, limits) from None
        finally:
            self._process = None
            process.end()


def simulate_demo() -> None:
    """Write the records of the demo; the user confirms what their columns mean."""
    from vibrident.app.workflow.simulated import write_demo

    write_demo(Path.cwd())
    for name in ("calibration.toml", "truth.json"):
        Path(name).unlink()


def _stopped_error(death: ProcessDied, limits: Limits) -> Exception:
    if death.reason == "crash" and "signal" not in death.ending:
        return WorkerError(str(death))
    if death.reason == "crash":
        _LOG.error("%s", death)
        return StoppedError(
            "The computation was ended before it was done.",
            expected="a computation that runs to its end",
            found=death.ending,
            where="the process of the computation, on the server",
            remedy="repeat it; if it is ended again, leave out records: the system may be short of "
            "memory",
        )
    most = (
        f"{(limits.memory_bytes or 0) / 1e9:.1f} GB"
        if death.reason == "memory"
        else f"{limits.seconds:g} s"
    )
    return StoppedError(
        f"The computation was ended: it needs more {death.reason} than the page allows.",
        expected=f"at most {most}",
        found="more",
        remedy="leave out records or parts of them, then repeat it; the command line has no such "
        "limit",
    )
