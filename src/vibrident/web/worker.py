"""Identification in a separate process, so that the page stays responsive, can cancel, and survives crashes.

The process works in the folder of the data, as the command line does, and writes one JSON object a line: progress, then
``done`` or ``error``.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import sys
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from vibrident.errors import InputError
from vibrident.sandbox import WorkerError, raise_told, set_limits, told

_WORK = "from vibrident.web.worker import work; work()"
#: Most bytes of one message: an error may quote its input.
_LONGEST_MESSAGE = 16_000_000
#: Bytes of a dead process's last output, for the log.
_LAST_BYTES = 20_000
#: Memory of an identification, bytes.
_MEMORY = 4_000_000_000
#: Further memory for each byte of data.
_MEMORY_A_BYTE = 20
_MOST_SECONDS = 7200.0
_MOST_FILE_BYTES = 1_000_000_000


class Worker:
    """A process for one task at a time."""

    def __init__(self) -> None:
        self._process: asyncio.subprocess.Process | None = None
        self._cancelled = False

    @property
    def busy(self) -> bool:
        """Whether it is working."""
        return self._process is not None

    def cancel(self) -> None:
        """End the process; the task ends with None."""
        self._cancelled = True
        if self._process is not None and self._process.returncode is None:
            self._process.kill()

    async def run(self, task: dict[str, Any], folder: Path) -> AsyncIterator[tuple[int, int, float]]:
        """Work on a task; yields iteration, the most there can be, and cost.

        Raises:
            InputError, NotConverged: as the task does, or it needs more memory than it may have (InputError).
        WorkerError: any other failure in the process.
            asyncio.CancelledError: it was cancelled.
        """
        self._cancelled = False
        pipe = asyncio.subprocess.PIPE
        self._process = process = await asyncio.create_subprocess_exec(
            sys.executable, "-P", "-c", _WORK, cwd=folder, stdin=pipe, stdout=pipe, stderr=pipe, limit=_LONGEST_MESSAGE
        )
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        last = asyncio.create_task(_tail(process.stderr))
        outcome: dict[str, Any] = {}
        try:
            process.stdin.write(json.dumps({**task, "memory_bytes": _memory(folder)}).encode())
            process.stdin.close()
            async for line in process.stdout:
                outcome = json.loads(line)
                if "progress" in outcome:
                    yield tuple(outcome["progress"])
            await process.wait()
        except (ValueError, ConnectionError) as error:  # not a message, or an endless one
            if not self._cancelled:
                raise WorkerError(f"a message of the process cannot be read: {error}") from error
        finally:
            if process.returncode is None:
                with contextlib.suppress(ProcessLookupError):
                    process.kill()
                await process.wait()
            self._process = None
        if self._cancelled:
            raise asyncio.CancelledError
        printed = await last
        raise_told(outcome)
        if "done" not in outcome:
            raise WorkerError(f"the process ended with status {process.returncode}\n{printed}")


async def _tail(stream: asyncio.StreamReader) -> str:
    """The end of the output; the rest is dropped."""
    kept = b""
    while piece := await stream.read(_LAST_BYTES):
        kept = (kept + piece)[-_LAST_BYTES:]
    return kept.decode(errors="replace")


def _memory(folder: Path) -> int:
    return _MEMORY + _MEMORY_A_BYTE * sum(path.stat().st_size for path in folder.iterdir())


def work() -> None:
    """Main of a worker: one task from stdin, its progress and outcome on stdout."""
    task = json.loads(sys.stdin.buffer.read())
    stream = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # keep what libraries print out of the answer
    set_limits(task["memory_bytes"], _MOST_SECONDS, _MOST_FILE_BYTES)

    def say(**message: Any) -> None:
        stream.write(json.dumps(message) + "\n")
        stream.flush()

    try:
        (_demo if task["task"] == "demo" else _identify)(task, say)
    except MemoryError:
        say(**told(_too_large(task["memory_bytes"])))
    except Exception as error:
        say(**told(error))
    else:
        say(done=True)


def _too_large(memory_bytes: int) -> InputError:
    return InputError(
        "The identification needs more memory than the page allows.",
        expected=f"at most {memory_bytes / 1e9:.1f} GB",
        found="more",
        remedy="leave out records or parts of them, or use vibrident identify in a shell",
    )


def _identify(task: dict[str, Any], say: Any) -> None:
    from vibrident.io import read
    from vibrident.workflow.identification import Request, run

    request = Request(
        task["estimator"],
        {"discretisation": task.get("discretisation")},
        None if task.get("model") is None else [task["model"]],
        task.get("uncertainty", "auto"),
    )
    request.check()
    calibration = read(task["calibration"])
    (result,) = run(request, [calibration], lambda iteration, most, cost: say(progress=(iteration, most, float(cost))))
    result.save(task["result"])


def _demo(task: dict[str, Any], say: Any) -> None:
    from vibrident.workflow.simulated import write_demo

    write_demo(Path.cwd())
    for name in ("calibration.toml", "truth.json"):  # the user confirms the columns
        Path(name).unlink()
