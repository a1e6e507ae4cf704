"""Run an identification or a further task: its progress, its output, and what broke it off."""

from __future__ import annotations

import asyncio
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from vibrident.app.web.language import Language, language, phrase
from vibrident.app.web.sandboxed import model_and_estimator
from vibrident.app.web.task_work import ARCHIVE, OUT, RESULT_FILE, work
from vibrident.app.web.tasks import IDENTIFY, TASKS, TaskRequest
from vibrident.app.web.worker import StoppedError, Worker
from vibrident.base.fields import Fields

_MAX_RESULTS = 10  # results of a task that join those of the page


@dataclass
class TaskProgress:
    """A task under way, and what it made."""

    request: TaskRequest
    words: str = phrase("Reading the data, loading the libraries …")
    step: str = ""  # that is under way, in words
    share: float | None = None
    most_left_s: float | None = None  # that the present line of the chart can still take
    lines: list[tuple[str, list[list[float]]]] = field(default_factory=list)  # name, points
    across: str = ""  # what the chart is over: cost or time
    notes: list[str] = field(default_factory=list)
    over: bool = False
    error: Exception | None = None
    output: Fields | None = None  # tables, charts, notes
    archive: Path | None = None
    kept_results: int = 0  # results that joined those of the page
    began: float = field(default_factory=time.monotonic)

    def receive(self, kind: str, *values: Any) -> None:
        """Take a progress message of the process: see ``task_work.ProcessProgress``."""
        match kind, *values:
            case "note", words:
                self.notes.append(words)
            case "step", words:
                self.step = words
                self.words = ""
                self.share = self.most_left_s = None
            case "share", words, done, most:
                self.step = ""
                self.words = words
                self.share = done / most if most else None
            case "iteration", iteration, most, cost:
                self._iterate(iteration, most, cost)
            case "estimate", name, time_s, value:
                self._add_point("time", name, time_s, value)

    def _iterate(self, iteration: int, most: int, cost: float) -> None:
        """Take an iteration; if the count does not increase, another start has begun."""
        points = self._add_point("cost", self.step, iteration, cost)
        self.share = iteration / most if most else None
        done = len(points) - 1
        elapsed_s = time.monotonic() - self._line_began
        self.most_left_s = elapsed_s / done * (most - iteration) if done else None
        facts = {"iteration": iteration, "most": most, "cost": f"{cost:.4g}"}
        self.words = phrase("Iteration {iteration} of at most {most}, cost {cost}", **facts)

    def _add_point(self, across: str, name: str, x: float, y: float) -> list[list[float]]:
        """Add a point to the chart, to another line if x does not increase; return the line."""
        self.across = across
        if not self.lines or self.lines[-1][0] != name or x <= self.lines[-1][1][-1][0]:
            self.lines.append((name, []))
            self._line_began = time.monotonic()
        points = self.lines[-1][1]
        points.append([x, y])
        return points

    @property
    def line_names(self) -> list[str]:
        """Return the name of each line: its step, else the number of the start."""
        numbered = enumerate(self.lines, 1)
        return [name or phrase("start {number}", number=number) for number, (name, _) in numbered]

    def status(self, language: Language) -> str:
        """Return the status, with the elapsed seconds, and those that this start can still take."""
        is_later_start = len(self.lines) > 1 and not (self.step or self.over)
        step = self.line_names[-1] if is_later_start and self.across == "cost" else self.step
        words = ": ".join(language(part) for part in (step, self.words) if part)
        if self.over:
            return words
        lasted = f"{time.monotonic() - self.began:.0f} s"
        if self.most_left_s is not None:
            seconds = f"{self.most_left_s:.0f}"
            more = language(phrase("this start: at most {seconds} s more"), seconds=seconds)
            lasted = f"{lasted}; {more}"
        return f"{words} ({lasted})"


class TaskRun:
    """The runs of one step for ``user``, which holds it, one at a time.

    ``name``: what runs, in English.
    """

    def __init__(self, user: Any, name: str) -> None:
        self.user = user
        self.name = name
        self.worker = Worker()
        self.progress: TaskProgress | None = None

    @property
    def busy(self) -> bool:
        """Return whether a task is under way."""
        return self.progress is not None and not self.progress.over

    @property
    def state(self) -> Fields | None:
        """Return what the next server has to report as broken off; None for nothing."""
        now = self.progress
        if now is None or (now.over and not isinstance(now.error, StoppedError)):
            return None
        error = now.error or StoppedError(
            f"The server was stopped during {self.name}.",
            expected="a computation that runs to its end",
            found="a server that was started again",
            remedy="repeat it; the data and the form are here",
        )
        return {"request": now.request, "error": dict(vars(error))}

    def restore(self, state: Fields | None) -> None:
        """Take up a task that was broken off."""
        if state is not None:
            error = StoppedError(**state["error"])
            self.progress = TaskProgress(state["request"], "", over=True, error=error)

    def start(self, request: TaskRequest) -> None:
        """Begin a task on a copy of the data; ``progress`` holds its outcome.

        One that is repeated takes the calibration file of then, whatever the form says since.
        """
        self.user.require("identify", "identify")
        if len(request.files) == 1 and not request.content:
            content = (self.user.session.data / request.files[0]).read_bytes()
            request = replace(request, content=content)
        self.progress = TaskProgress(request)
        self.user.changed()
        self._task = asyncio.get_running_loop().create_task(self._run(self.progress))

    async def _run(self, now: TaskProgress) -> None:
        user = self.user
        request = now.request
        begin = now.words
        try:
            async with user.session.new_folder("run") as folder:
                if request.result:
                    named = (result for result in user.results if result.name == request.result)
                    (folder / RESULT_FILE).write_bytes(next(named).path.read_bytes())
                await asyncio.to_thread(user.session.copy_to, folder)
                if request.content:
                    calibration = folder / request.files[0]
                    calibration.unlink(missing_ok=True)  # a hard link to the present one
                    calibration.write_bytes(request.content)
                if user.users.identifying.locked():
                    now.words = phrase("Waiting for other computations …")
                async with user.users.identifying:
                    now.words = begin
                    options = request.options
                    task = (work, request.task, options, list(request.files), request.language)
                    now.output = await self.worker.run(*task, folder=folder, progress=now.receive)
                if request.task != IDENTIFY:
                    await user.note("ran", task=request.task, options=options)
                await self._keep(now, folder)
            now.words = phrase("Identified.") if request.task == IDENTIFY else phrase("Done.")
        except asyncio.CancelledError:
            now.words = phrase("Cancelled.")
        except StopIteration:
            now.words = phrase("The result is no longer there.")
        except Exception as error:
            now.words = ""
            now.error = error
        finally:
            now.step = ""
            now.over = True
            user.changed()

    async def _keep(self, now: TaskProgress, folder: Path) -> None:
        """Keep the archive, and the results that the task made."""
        assert now.output is not None
        user = self.user
        request = now.request
        for name in now.output["results"][:_MAX_RESULTS]:
            path = folder / OUT / name
            model, estimator = await user.run_sandboxed(model_and_estimator, path)
            if request.task == IDENTIFY:
                await user.note("identified", path, model=model, estimator=estimator)
                prefixes = (named.name.partition(":")[0] for named in user.results)
                number = (
                    max((int(prefix) for prefix in prefixes if prefix.isdecimal()), default=0) + 1
                )
                calibration = folder / request.files[0]
                made_by = replace(request, content=b"")
                user.keep_result(f"{number}: {model}, {estimator}", path, calibration, made_by)
            else:
                title = language(request.language)(TASKS[request.task].title)
                user.keep_result(f"{title}: {path.parent.name}, {model}, {estimator}", path)
            now.kept_results += 1
        if request.task != IDENTIFY and now.output["files"]:
            now.archive = await asyncio.to_thread(user.session.download, folder / ARCHIVE)
