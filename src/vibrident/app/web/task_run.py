"""Run a further task of a user's page: its progress, its output, and how it was broken off."""

from __future__ import annotations

import asyncio
import math
import shutil
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vibrident.app.web.language import Language, language, phrase
from vibrident.app.web.sandboxed import model_and_estimator
from vibrident.app.web.task_work import ARCHIVE, OUT, RESULT_FILE, work
from vibrident.app.web.tasks import TASKS, TaskRequest
from vibrident.app.web.worker import StoppedError, Worker

_MAX_RESULTS = 10  # results of a task that join those of the page
_MAX_POINTS = 2000  # of a growing chart


@dataclass
class TaskProgress:
    """A task under way, and what it made."""

    request: TaskRequest
    words: str = phrase("Reading the data, loading the libraries …")
    share: float | None = None
    lines: dict[str, list[list[float]]] = field(default_factory=dict)  # name → points of the chart
    across: str = ""  # what the chart is over: cost or time
    notes: list[str] = field(default_factory=list)
    over: bool = False
    error: Exception | None = None
    output: dict[str, Any] | None = None  # tables, charts, notes
    archive: Path | None = None
    kept_results: int = 0  # results that joined those of the page
    began: float = field(default_factory=time.monotonic)

    def record(self, words: str, share: float, kind: str, points: dict[str, list[float]]) -> None:
        """Take a progress message of the process: see ``task_work.ProcessProgress``."""
        if kind == "note":
            self.notes.append(words)
            return
        self.words = words or self.words
        self.share = share if share >= 0 else None if not points else self.share
        for name, (x, y) in points.items():
            self.across = kind
            line = self.lines.setdefault(name, [])
            if line and x <= line[-1][0]:  # another start
                line.clear()
            if math.isfinite(y) and len(line) < _MAX_POINTS:
                line.append([x, y])

    def status(self, language: Language) -> str:
        """Return the status, with the elapsed seconds."""
        words = language(self.words)
        return words if self.over else f"{words} ({time.monotonic() - self.began:.0f} s)"


class TaskRun:
    """The further task of ``user``, which holds it: one at a time."""

    def __init__(self, user: Any) -> None:
        self.user = user
        self.worker = Worker()
        self.progress: TaskProgress | None = None

    @property
    def busy(self) -> bool:
        """Return whether a task is under way."""
        return self.progress is not None and not self.progress.over

    @property
    def state(self) -> TaskRequest | None:
        """Return the request that the next server has to report as broken off; None for none."""
        now = self.progress
        broken_off = now is not None and (not now.over or isinstance(now.error, StoppedError))
        return now.request if now is not None and broken_off else None

    def restore(self, request: TaskRequest | None, error: StoppedError) -> None:
        """Take up a task that was broken off."""
        if request is not None:
            self.progress = TaskProgress(request, "", over=True, error=error)

    def start(self, request: TaskRequest) -> None:
        """Begin a task on a copy of the data; ``progress`` holds its outcome."""
        self.user.require("identify", "do that")
        self.progress = TaskProgress(request)
        self.user.changed()
        self._task = asyncio.get_running_loop().create_task(self._run(self.progress))

    async def _run(self, now: TaskProgress) -> None:
        user = self.user
        session = self.user.session
        request = now.request
        try:
            async with session.new_folder("tool") as folder:
                await asyncio.to_thread(session.copy_to, folder)
                if request.result:
                    selected = next(
                        result for result in user.results if result.name == request.result
                    )
                    await asyncio.to_thread(shutil.copyfile, selected.path, folder / RESULT_FILE)
                if user.users.identifying.locked():
                    now.words = phrase("Waiting for other computations …")
                async with user.users.identifying:
                    arguments = (
                        request.task,
                        request.options,
                        list(request.files),
                        request.language,
                    )
                    now.output = await self.worker.run(
                        work, *arguments, folder=folder, progress=now.record
                    )
                await user.note("ran", task=request.task, options=request.options)
                await self._keep(now, folder)
            now.words = phrase("Done.")
        except asyncio.CancelledError:
            now.words = phrase("Cancelled.")
        except StopIteration:
            now.words = phrase("The result is no longer there.")
        except Exception as error:
            now.words = ""
            now.error = error
        finally:
            now.over = True
            user.changed()

    async def _keep(self, now: TaskProgress, folder: Path) -> None:
        """Keep the archive, and the results that the task made."""
        assert now.output is not None
        if (folder / ARCHIVE).exists() and now.output["files"]:
            now.archive = await asyncio.to_thread(self.user.session.download, folder / ARCHIVE)
        for name in now.output["results"][:_MAX_RESULTS]:
            path = folder / OUT / name
            model, estimator = await self.user.run_sandboxed(model_and_estimator, path)
            title = language(now.request.language)(TASKS[now.request.task].title)
            self.user.keep_result(f"{title}: {path.parent.name}, {model}, {estimator}", path)
            now.kept_results += 1
