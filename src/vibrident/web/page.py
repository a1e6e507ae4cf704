"""One user's page: the steps in their order, and what they share."""

from __future__ import annotations

from dataclasses import dataclass, field

from nicegui import app, ui

from vibrident.errors import InputError, VibridentError
from vibrident.result import Result
from vibrident.web.look import STYLE
from vibrident.web.session import Session
from vibrident.web.worker import Worker


@dataclass
class Named:
    """A result and what to call it, with the calibration file that reproduces it, where it was made here."""

    name: str
    result: Result
    content: bytes
    calibration: str | None = None


@dataclass
class User:
    """What one open page knows. Nothing of it is shared with another page."""

    session: Session
    worker: Worker = field(default_factory=Worker)
    results: list[Named] = field(default_factory=list)

    def close(self) -> None:
        """End what runs, remove the files."""
        self.worker.cancel()
        self.session.close()


def page(limit_mb: float) -> None:
    """Build the page for a new user."""
    from vibrident.web.columns import ColumnsStep
    from vibrident.web.compare import CompareStep
    from vibrident.web.data import DataStep
    from vibrident.web.fit import FitStep
    from vibrident.web.outcome import OutcomeStep

    user = User(Session(limit_mb))
    ui.context.client.on_delete(user.close)
    app.on_shutdown(user.close)
    ui.colors(primary="#0a4b78", positive="#14632f", negative="#a1001a", warning="#7a4b00")
    ui.add_css(STYLE)
    ui.html('<a class="skip" href="#main">To the content</a>', sanitize=False)
    with ui.element("header").classes("top"):
        ui.html("<h1>vibrident</h1><p>From calibration records to a sensor's dynamic model</p>", sanitize=False)
    with ui.element("main").props("id=main"):
        outcome = OutcomeStep(user)
        compare = CompareStep(user)
        fit = FitStep(user)
        columns = ColumnsStep(user)
        data = DataStep(user)
        data.build(on_data=columns.show, on_result=lambda: (outcome.show(), compare.show()))
        columns.build(on_confirmed=fit.show, on_doubt=fit.hide)
        fit.build(on_result=lambda: (outcome.show(), compare.show()))
        outcome.build()
        compare.build()


def show_error(place: ui.element, error: VibridentError, session: Session | None = None) -> None:
    """The message of the command line, in a box."""
    local = session.local(error) if session else error
    place.clear()
    with place, ui.element("div").classes("error").props("role=alert"):
        if not isinstance(local, InputError):
            ui.label(str(local)).classes("problem")
            return
        ui.label(local.problem).classes("problem")
        for label in ("expected", "found", "where", "remedy"):
            if text := getattr(local, label):
                with ui.element("p"):
                    ui.label(f"{label}: ").classes("label")
                    ui.label(text)


def step(number: int, title: str, name: str) -> ui.element:
    """A section of the page with its heading."""
    section = ui.element("section").classes("step").props(f'aria-labelledby="{name}-title" id="{name}"')
    with section:
        ui.html(f'<h2 id="{name}-title"><span aria-hidden="true">{number}</span>{title}</h2>', sanitize=False)
    return section
