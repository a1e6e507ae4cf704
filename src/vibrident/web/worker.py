"""Identification in a process of its own, so that the page stays alive, can cancel, and survives what goes wrong there.

The process works in the folder of the data, as the command line would, and says one JSON object a line: progress, then
``done`` or ``error``.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from vibrident.errors import InputError, NotConverged, VibridentError

_WORK = "from vibrident.web.worker import work; work()"
#: Lines of what a dead process said last, for the message.
_LAST_LINES = 5


class Worker:
    """A process for one task at a time."""

    def __init__(self) -> None:
        self._process: asyncio.subprocess.Process | None = None
        self._cancelled = False

    @property
    def busy(self) -> bool:
        """Whether it works."""
        return self._process is not None

    def cancel(self) -> None:
        """End the process; the task ends with None."""
        self._cancelled = True
        if self._process is not None and self._process.returncode is None:
            self._process.kill()

    async def run(self, task: dict[str, Any], folder: Path) -> AsyncIterator[tuple[int, int, float]]:
        """Work on a task; yields iteration, the most there can be, and cost.

        Raises:
            InputError, NotConverged: as the task does.
            asyncio.CancelledError: it was cancelled.
        """
        self._cancelled = False
        pipe = asyncio.subprocess.PIPE
        self._process = await asyncio.create_subprocess_exec(
            sys.executable, "-P", "-c", _WORK, cwd=folder, stdin=pipe, stdout=pipe, stderr=pipe
        )
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        assert process.stderr is not None
        said = asyncio.create_task(process.stderr.read())
        outcome: dict[str, Any] = {}
        try:
            process.stdin.write(json.dumps(task).encode())
            process.stdin.close()
            async for line in process.stdout:
                outcome = json.loads(line)
                if "progress" in outcome:
                    yield tuple(outcome["progress"])
            await process.wait()
        finally:
            if process.returncode is None:
                process.kill()
                await process.wait()
            self._process = None
        if self._cancelled:
            raise asyncio.CancelledError
        if "error" in outcome:
            raise _error(outcome["error"])
        if "done" not in outcome:
            last = (await said).decode(errors="replace").strip().splitlines()[-_LAST_LINES:]
            raise NotConverged("\n".join(("The identification ended unexpectedly.", *last)))


def work() -> None:
    """A worker's life: one task from stdin, its progress and outcome on stdout."""
    task = json.loads(sys.stdin.buffer.read())
    stream = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what libraries print is no answer

    def say(**message: Any) -> None:
        stream.write(json.dumps(message) + "\n")
        stream.flush()

    try:
        (_demo if task["task"] == "demo" else _identify)(task, say)
    except VibridentError as error:
        fields = vars(error) if isinstance(error, InputError) else {"message": str(error)}
        say(error=fields)
    else:
        say(done=True)


def _identify(task: dict[str, Any], say: Any) -> None:
    from vibrident.cli.estimators import EstimatorOptions, checked, estimator
    from vibrident.io import read

    options = EstimatorOptions(discretisation=task.get("discretisation"))
    checked(task["estimator"], options)
    calibration = read(task["calibration"])
    from vibrident.identification import identify

    result = identify(
        calibration,
        task.get("model"),
        estimator(task["estimator"], options),
        uncertainty=task.get("uncertainty", "auto"),
        progress=lambda iteration, most, cost: say(progress=(iteration, most, float(cost))),
    )
    result.save(task["result"])


def _demo(task: dict[str, Any], say: Any) -> None:
    from vibrident.cli.commands import demo
    from vibrident.cli.commands.simulate import write

    write(
        Path.cwd(),
        demo.SENSOR,
        "sine",
        sampling_rate_hz=demo.RATE_HZ,
        samples=demo.SAMPLES,
        excitation_snr_db=demo.SNR_DB,
        response_noise=demo.RESPONSE_NOISE,
        seed=demo.SEED,
    )
    for name in ("calibration.toml", "truth.json"):  # what the columns mean is for the user to confirm
        Path(name).unlink()


def _error(fields: dict[str, str]) -> VibridentError:
    return NotConverged(fields["message"]) if "message" in fields else InputError(**fields)
