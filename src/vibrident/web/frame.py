"""What the steps of the page share: the user, the frame of a section, and the box of an error."""

from __future__ import annotations

from dataclasses import dataclass, field

from nicegui import ui

from vibrident.errors import InputError, VibridentError
from vibrident.result import Result
from vibrident.web.choices import Choices
from vibrident.web.session import Session
from vibrident.web.worker import Worker


@dataclass
class Named:
    """A result and what to call it; where it was made here, with the calibration file and the choices made."""

    name: str
    result: Result
    content: bytes
    calibration: str | None = None
    choices: Choices | None = None


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
