"""Build the step of further tasks: options, progress, tables and charts."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping
from typing import Any

from nicegui import ui

from vibrident.app.web import frame
from vibrident.app.web.form.entries import PLAIN
from vibrident.app.web.language import page_language, phrase, translate, translate_count
from vibrident.app.web.task_run import TaskProgress
from vibrident.app.web.tasks import TASKS, Field, Task, TaskRequest
from vibrident.app.web.translated import charts
from vibrident.app.web.user import User
from vibrident.app.web.worker import StoppedError
from vibrident.base.errors import InputError
from vibrident.fit.registry import ESTIMATORS
from vibrident.physics.models import ADD_ONS, CORES

_PACE_S = 0.25  # seconds between two looks at the progress
_LIVE_HEIGHT_PX = 230  # of the growing chart, pixels


class ToolsStep:
    """A section that runs one of the tasks and shows what it made."""

    def __init__(self, user: User) -> None:
        self.user = user
        self.over: TaskProgress | None = None

    def build(self, on_result: Callable[..., Awaitable[Any]]) -> None:
        """Build the section, hidden until there are data or results."""
        self.on_result = on_result
        now = self.user.task.progress
        with frame.add_step(translate("More with these data"), "more", mark="+") as self.section:
            titles = {name: translate(task.title) for name, task in TASKS.items()}
            first = now.request.task if now else "compare"
            self.task = ui.select(titles, value=first, label=translate("Task"))
            self.task.props("dense outlined stack-label").classes("w-full")
            self.task.on_value_change(lambda: self._ask())
            self.hint = frame.hint("")
            self.fields = ui.element("div").classes("fields wide")
            with frame.actions():
                self.start = ui.button(translate("Run the task"), on_click=self._run).props(
                    "id=run"
                )
                self.stop = ui.button(translate("Cancel"), on_click=self.user.task.worker.cancel)
                self.stop.props("outline color=negative id=cancel-task")
                self.spinner = ui.spinner(size="28px")
                self.status = ui.label("").props("role=status id=task-status")
            self.share = ui.linear_progress(0.0, show_value=False, size="8px")
            self.share.props("id=task-share").props["aria-label"] = translate("share of the task")
            self.errors = frame.add_error_area()
            chart_element = ui.element("div").classes("chart").props("id=task-live")
            self.live = frame.GrowingChart(chart_element, _LIVE_HEIGHT_PX)
            self.body = ui.element("div").props('aria-live=polite id="said"')
        self.timer = ui.timer(_PACE_S, self._follow, active=now is not None)
        self._ask()
        self._renew()
        self.show()

    def show(self) -> None:
        """Offer the results that there are."""
        self.section.visible = not self.user.empty
        if self.result is not None:
            names = [named.name for named in self.user.results]
            self.result.set_options(names, value=self.result.value or self._usual())

    def _usual(self) -> str | None:
        """Return the name of the latest identification, else of the latest result of any origin."""
        results = self.user.results
        names = [named.name for named in (*results, *(named for named in results if named.choices))]
        return names[-1] if names else None

    def _ask(self) -> None:
        """Ask for the options of the chosen task."""
        task = TASKS[self.task.value]
        self.hint.text = translate(task.hint)
        self.option_elements: dict[str, Any] = {}
        self.result = None
        self.fields.clear()
        with self.fields:
            if "result" in task.takes:
                names = [named.name for named in self.user.results]
                self.result = ui.select(names, value=self._usual(), label=translate("Result"))
                self.result.props("dense outlined stack-label")
            for name, field in task.fields.items():
                self.option_elements[name] = _option_element(field)

    def _request(self) -> TaskRequest:
        """Return the task with its options; InputError where something is missing."""
        name = self.task.value
        task = TASKS[self.task.value]
        user = self.user
        files: tuple[str, ...] = ()
        if "data" in task.takes:
            confirmed = _require(user.confirmed, "confirmed columns", "confirm the columns first")
            files = (confirmed.name,)
        elif "all" in task.takes:
            calibration_files = [
                file for file in user.session.names if file.lower().endswith(".toml")
            ]
            files = tuple(
                _require(calibration_files, "calibration files", "upload them, with their data")
            )
        result = ""
        if self.result is not None:
            remedy = "identify first, or upload an earlier one"
            result = str(_require(self.result.value, "a result", remedy))
        options: dict[str, object] = {}
        for option, element in self.option_elements.items():
            value = element.value
            field = task.fields[option]
            if value in (None, "", [], False):
                continue
            options[option] = _number(field, value) if field.is_number else value
        _require_band(task, options)
        return TaskRequest(name, options, result, files, page_language().code)

    async def _run(self) -> None:
        self._begin(self._request)

    def _begin(self, make_request: Callable[[], TaskRequest]) -> None:
        if self.user.task.busy:
            return
        self.errors.clear()
        self.body.clear()
        self.live.forget()
        try:
            request = make_request()
            self.user.write_form()
            self.user.task.start(request)
        except Exception as error:
            frame.show_error(self.errors, error, self.user.session)
            return
        self._renew()
        self.timer.activate()

    def _renew(self) -> None:
        busy = self.user.task.busy
        self.start.set_enabled(not busy)
        self.stop.visible = self.spinner.visible = busy
        self.share.visible = False

    async def _follow(self) -> None:
        """Update from the task."""
        now = self.user.task.progress
        if now is None or now is self.over:
            self.timer.deactivate()
            return
        self.status.text = now.status(page_language())
        self.share.visible = now.share is not None and not now.over
        self.share.value = now.share or 0.0
        if not now.over and self.live.grows_to(sum(map(len, now.lines.values()))):
            self.live.show(live_chart(now.lines, now.across))
        if not now.over:
            return
        self.over = now
        self.timer.deactivate()
        self._renew()
        self.live.forget()
        self._tell(now)
        if now.kept_results:
            now.kept_results = 0
            await self.on_result(go=False)

    def _tell(self, now: TaskProgress) -> None:
        """Show what a task made, or why it failed."""
        title = translate(TASKS[now.request.task].title)
        if now.error is not None:
            frame.show_error(self.errors, now.error, self.user.session)
            if isinstance(now.error, StoppedError) and not self.errors.is_deleted:
                with self.errors:
                    broken_off = translate("Broken off: {what}", what=title)
                    frame.hint(broken_off).props("id=task-broken-off")
                    again = ui.button(
                        translate("Repeat"), on_click=lambda: self._begin(lambda: now.request)
                    )
                    again.props("outline id=repeat-task")
        if now.output is None:
            return
        with self.body:
            for note in (*now.notes, *now.output["notes"]):
                ui.label(translate(note)).classes("doubt")
            # escaped in the process
            ui.html(now.output["tables"], sanitize=False).classes("scroll")
            for heading, chart, height in now.output["charts"]:
                frame.heading(heading)
                frame.ChartView(chart, height)
            if now.archive is not None:
                count = len(now.output["files"])
                archive = now.archive
                label = translate_count(count, "The file (zip)", "All {count} files (zip)")
                name = f"{now.request.task}.zip"
                get = ui.button(label, on_click=lambda: ui.download.file(archive, name))
                get.props("outline id=get-all")


def live_chart(lines: dict[str, list[list[float]]], across: str) -> dict[str, Any]:
    """Return the chart of a task under way: costs over iterations, or a parameter over time."""
    import numpy as np

    from vibrident.show import axes
    from vibrident.show.views import LINES, Figure, Panel, Series, Stack

    named = {name: np.array(points, dtype=float) for name, points in lines.items() if points}
    series = tuple(
        Series(points[:, 0], points[:, 1], name, LINES[number % len(LINES)])
        for number, (name, points) in enumerate(named.items())
    )
    x = np.concatenate([np.zeros(0), *(line.x for line in series)])
    y = np.concatenate([np.zeros(0), *(line.y for line in series)])
    if across == "cost":
        x_axis = axes.linear(
            phrase("Iteration"), np.append(x, [0.0, 2.0]), whole_numbers=True, most=8
        )
        y_axis = axes.size(phrase("Cost"), y)
    else:
        x_axis = axes.linear(phrase("Time in s"), x)
        y_axis = axes.linear("", y)
    panel = Panel(x_axis, y_axis, series, 1.1)
    ((_, chart),) = charts(page_language(), Figure("live", "", (Stack((panel,)),)))
    return chart


def _option_element(field: Field) -> Any:
    """Return the element of an option."""
    several = {"models": models(), "estimators": _estimators(), "shared": shared_parameters()}
    label = translate(field.label)
    if field.kind in several:
        element = ui.select(several[field.kind], value=[], multiple=True, label=label)
        return element.props(f"{PLAIN} options-dense use-chips")
    if field.kind == "model":
        element = ui.select({"": translate("that of each"), **models()}, value="", label=label)
        return element.props(f"{PLAIN} options-dense")
    if field.kind == "flag":
        return ui.checkbox(label).props("dense")
    return ui.number(label, format="%.12g").props(f"{PLAIN} step=any")


def models() -> dict[str, str]:
    """Return the models to choose from: each core, alone, with an add-on, and with a delay too."""
    delay = next((addon.name for addon in ADD_ONS.values() if addon.is_delay), "")
    names = []
    for core in CORES:
        names += [core, *(f"{core}+{addon}" for addon in ADD_ONS)]
        names += [f"{core}+{delay}+{addon}" for addon in ADD_ONS if delay and addon != delay]
    return {name: name for name in names}


def _estimators() -> dict[str, str]:
    return {
        name: f"{name}: {translate(estimator.title)}"
        for name, estimator in ESTIMATORS.all().items()
    }


def shared_parameters() -> dict[str, str]:
    """Return the parameters that calibrations may share."""
    from vibrident.physics.naming import in_words

    labels: dict[str, str] = {}
    for kind in (*CORES.values(), *ADD_ONS.values()):
        for parameter in kind.parameters:
            labels[parameter.name] = translate(in_words(parameter.name))
    return labels


def _number(field: Field, value: float) -> float | int:
    is_whole = field.kind == "whole"
    if value < field.least or (is_whole and value != int(value)) or value <= 0:
        least = f"{field.least:g} or above" if field.least else "above 0"
        raise InputError(
            f"“{field.label}” is out of range.",
            expected=f"a {'is_whole ' if is_whole else ''}number, {least}",
            found=f"{value:g}",
            where=f"“{field.label}”",
            remedy="give another number, or leave the field empty",
        )
    return int(value) if is_whole else float(value)


def _require_band(task: Task, options: Mapping[str, Any]) -> None:
    """Refuse one end of a band without the other, or the higher one first."""
    low = options.get("low_hz")
    high = options.get("high_hz")
    if low is high is None or (low is not None and high is not None and low < high):
        return
    raise InputError(
        "The band is not a band.",
        expected="a lower and a higher frequency, or neither",
        found=f"from {low or 'nothing'} to {high or 'nothing'}",
        where=f"“{task.fields['low_hz'].label}”, “{task.fields['high_hz'].label}”",
        remedy="fill in both, or leave both empty",
    )


def _require(value: Any, what: str, remedy: str) -> Any:
    if not value:
        raise InputError(
            "Something is missing for this task.", expected=what, found="none", remedy=remedy
        )
    return value
