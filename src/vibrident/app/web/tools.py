"""Build the step of further tasks: options, progress, tables and charts."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from functools import partial
from typing import Any

from nicegui import ui

from vibrident.app.web import frame
from vibrident.app.web.form.entries import PLAIN
from vibrident.app.web.language import page_language, translate, translate_count
from vibrident.app.web.run_step import RunStep
from vibrident.app.web.task_run import TaskProgress
from vibrident.app.web.tasks import TASKS, Field, Task, TaskRequest
from vibrident.app.web.user import User
from vibrident.base.errors import InputError
from vibrident.base.fields import Fields, GivenFields, NamedTexts
from vibrident.fit.registry import ESTIMATORS
from vibrident.physics.models import ADD_ONS, CORES


class ToolsStep(RunStep):
    """A section that runs one of the tasks and shows what it made."""

    ids = "task-"

    def __init__(self, user: User) -> None:
        super().__init__(user, user.task)

    def build(self, on_result: Callable[..., Awaitable[Any]]) -> None:
        """Build the section, hidden until there are data or results."""
        with frame.add_step(translate("More with these data"), "more", mark="+") as self.section:
            titles = {name: translate(task.title) for name, task in TASKS.items()}
            first = self.run.progress.request.task if self.run.progress else "compare"
            self.task = ui.select(titles, value=first, label=translate("Task"))
            self.task.props("dense outlined stack-label").classes("w-full")
            self.task.on_value_change(lambda: self._show_options())
            self.hint = frame.hint("")
            self.fields = ui.element("div").classes("fields wide")
            self.build_controls(
                translate("Run the task"), translate("share of the task"), on_result
            )
            self.body = ui.element("div").props('aria-live=polite id="said"')
        self.timer.activate()
        self._show_options()
        self.update()
        self.show()

    def show(self) -> None:
        """Offer the results that there are."""
        self.section.visible = not self.user.empty
        if self.result is not None:
            names = [named.name for named in self.user.results]
            self.result.set_options(names, value=self.result.value or self._latest_name())

    def _latest_name(self) -> str | None:
        """Return the name of the latest identification, else of the latest result of any origin."""
        results = self.user.results
        names = [named.name for named in (*results, *(named for named in results if named.request))]
        return names[-1] if names else None

    def _show_options(self) -> None:
        """Build the elements for the options of the chosen task."""
        task = TASKS[self.task.value]
        self.hint.text = translate(task.hint)
        self.option_elements: Fields = {}
        self.result = None
        self.fields.clear()
        with self.fields:
            if "result" in task.takes:
                names = [named.name for named in self.user.results]
                self.result = ui.select(names, value=self._latest_name(), label=translate("Result"))
                self.result.props("dense outlined stack-label")
            for name, field in task.fields.items():
                self.option_elements[name] = _option_element(field)

    def make_request(self) -> TaskRequest:
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

    def begin(self, make_request: Callable[[], TaskRequest]) -> None:
        """Begin a task, and remove what the one before it made."""
        if not self.run.busy:
            self.body.clear()
        super().begin(make_request)

    def subject(self, request: TaskRequest) -> str:
        """Return the title of the task."""
        return translate(TASKS[request.task].title)

    def show_output(self, run: TaskProgress) -> None:
        """Show remarks, tables, charts and the button that downloads the files."""
        output = run.output or {}
        with self.body:
            for note in (*run.notes, *output["notes"]):
                ui.label(translate(note)).classes("doubt")
            # escaped in the process
            ui.html(output["tables"], sanitize=False).classes("scroll")
            for heading, chart, height in output["charts"]:
                frame.heading(heading)
                frame.ChartView(chart, height)
            if run.archive is not None:
                download = partial(ui.download.file, run.archive, f"{run.request.task}.zip")
                count = len(output["files"])
                label = translate_count(count, "The file (zip)", "All {count} files (zip)")
                frame.add_button(label, lambda: download(), "outline id=get-all")


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

    labels: NamedTexts = {}
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
            expected=f"a {'whole ' if is_whole else ''}number, {least}",
            found=f"{value:g}",
            where=f"“{field.label}”",
            remedy="give another number, or leave the field empty",
        )
    return int(value) if is_whole else float(value)


def _require_band(task: Task, options: GivenFields) -> None:
    """Refuse one end of a band without the other, or the higher one first."""
    low = options.get("low_hz")
    high = options.get("high_hz")
    if low is high is None or (low is not None and high is not None and low < high):
        return
    raise InputError(
        "The band needs a lower and a higher frequency.",
        expected="the lower frequency first, or neither",
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
