"""Build the elements that the steps of the page share: sections, buttons, errors, charts."""

from __future__ import annotations

import contextlib
import functools
import inspect
import json
import logging
import secrets
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from nicegui import ui

from vibrident.app.web.language import translate, translate_count
from vibrident.app.web.session import PageSession
from vibrident.app.web.user import User
from vibrident.app.web.words import LABELS, page_word
from vibrident.base.errors import InputError, VibridentError
from vibrident.base.escaping import html
from vibrident.base.fields import NamedTexts
from vibrident.base.process import WorkerError
from vibrident.show import views

_PLOTLY = ui.plotly  # naming it makes its library available to the browser
_LOG = logging.getLogger("vibrident.app.web")
_MAX_LOGGED_CHARACTERS = 20_000  # most characters of an unexpected error in the log
_MAX_LISTED_NAMES = 12  # most names in a list; the rest is counted


def show_error(
    element: ui.element,
    error: BaseException,
    session: PageSession | None = None,
    labels: NamedTexts = LABELS,
) -> None:
    """Show an error in a box, in the words of the form; for unexpected ones, the number in the log.

    ``labels``: by setting, or by option of a command.
    """
    to_show = _error_to_show(error)
    if element.is_deleted:  # the page was left meanwhile
        return
    element.clear()
    with element, ui.element("div").classes("error").props("role=alert"):
        if not isinstance(to_show, InputError):
            _show_untranslated(str(to_show)).classes("problem")
            return
        local = _for_page(to_show, session, labels)
        _show_untranslated(local.problem).classes("problem")
        for label, text in local.parts:
            with ui.element("p"):
                ui.label(f"{translate(label)}: ").classes("label")
                _show_untranslated(text)


def _show_untranslated(text: str) -> ui.label:
    """Show a text of the engine, marked as English where no catalogue translates it."""
    translated = translate(text)
    return ui.label(translated).props("lang=en" if translated == text else "")


@contextlib.contextmanager
def reporting(area: ui.element, user: User) -> Iterator[None]:
    """Show in an area, which is empty before, what is raised within the block."""
    area.clear()
    try:
        yield
    except Exception as error:
        show_error(area, error, user.session)


def reported(handler: Callable[..., Any]) -> Callable[..., Any]:
    """Decorate a handler of a step: what it raises is shown in ``errors`` of the step."""

    @functools.wraps(handler)
    async def reported_handler(step: Any, *args: Any, **kwargs: Any) -> Any:
        with reporting(step.errors, step.user):
            done = handler(step, *args, **kwargs)
            return await done if inspect.isawaitable(done) else done

    return reported_handler


def show_left_out(element: ui.element, left_out: Mapping[str, Sequence[str]]) -> None:
    """Show the omitted files, by reason."""
    if element.is_deleted or not left_out:
        return
    number = sum(map(len, left_out.values()))
    with element, ui.element("div").classes("warning").props('role=alert id="left-out"'):
        singular = "{count} file was left out; the rest is here."
        plural = "{count} files were left out; the rest is here."
        ui.label(translate_count(number, singular, plural)).classes("problem")
        for reason, names in left_out.items():
            ui.label(f"{translate(reason)}: {list_names(names)}")


def show_faults(element: ui.element, errors: Sequence[InputError], session: PageSession) -> None:
    """Show what is wrong in the files, each problem once with its places."""
    wheres: dict[str, list[str]] = {}
    for error in (_for_page(error, session) for error in errors):
        wheres.setdefault(
            f"{translate(error.problem).rstrip('.')} ({translate(error.remedy)})", []
        ).append(error.where)
    with element, ui.element("div").classes("warning").props("role=alert"):
        singular = "To mend before you identify, in {count} file:"
        plural = "To mend before you identify, in {count} files:"
        ui.label(translate_count(len(errors), singular, plural)).classes("problem")
        for problem, where in wheres.items():
            ui.label(f"{problem}: {list_names(where)}")


def list_names(names: Sequence[str]) -> str:
    """Return the first names as a list, and the number of the others."""
    count = views.listed(len(names), _MAX_LISTED_NAMES)
    first = ", ".join(names[:count])
    return (
        translate("{names} and {number} more", names=first, number=len(names) - count)
        if len(names) > count
        else first
    )


def add_step(title: str, name: str, mark: str = "") -> ui.element:
    """Add a section of the page with its heading.

    Its number is its place among the shown sections, or ``mark``. ``title``: in the page's
    language, as all words that are given to this module's functions.
    """
    section = (
        ui.element("section").classes("step").props(f'aria-labelledby="{name}-title" id="{name}"')
    )
    with section:
        ui.html(
            f'<h2 id="{name}-title" tabindex="-1"><span '
            f'aria-hidden="true">{mark}</span>{html(title)}</h2>',
            sanitize=False,
        )
    return section


def heading(title: str, level: int = 3) -> None:
    """Add a heading of this level."""
    ui.html(f"<h{level}>{html(title)}</h{level}>", sanitize=False)


def actions() -> ui.element:
    """Add a row of buttons, which are built within it."""
    return ui.element("div").classes("actions")


def add_button(
    label: str, on_click: Callable[..., Any], props: str = "outline", *, name: str = ""
) -> ui.button:
    """Add a button.

    ``props``: of Quasar; ``name``: for a screen reader, where the label alone would be ambiguous.
    """
    button = ui.button(label, on_click=on_click).props(props)
    if name:
        button.props["aria-label"] = name
    return button


def add_remove_button(on_click: Callable[..., Any], subject: str, size: str = "sm") -> None:
    """Add a cross that removes something; ``subject``: what it removes, for a screen reader."""
    name = translate("remove {thing}", thing=subject)
    add_button("", on_click, f"icon=close flat round size={size}", name=name)


def style_upload(upload: ui.upload) -> ui.upload:
    """Style an upload, and empty it after each transfer."""
    upload.classes("uploader").props("flat bordered")
    return upload.on("uploaded", js_handler=f"() => vibrident.sent({upload.id})")


def name_upload(upload: ui.upload, button: str, field: str) -> None:
    """Name the button and the field of an upload for a screen reader."""
    names = json.dumps([button, field])
    ui.run_javascript(f"vibrident.name({upload.id}, ...{names})")


def add_error_area() -> ui.element:
    """Add a place for errors, which a screen reader says as they come."""
    return ui.element("div").props("aria-live=assertive")


def hint(text: str) -> ui.label:
    """Add a text of less weight."""
    return ui.label(text).classes("hint")


def add_group(title: str, level: int = 3) -> ui.element:
    """Add a group of fields below a heading of this level.

    ``level``: 0 for a group that has its name for a screen reader alone.
    """
    if level:
        heading(title, level)
    group_element = ui.element("div").classes("fields w-full").props("role=group")
    group_element.props["aria-label"] = title
    return group_element


def scroll_to(section: ui.element) -> None:
    """Scroll to a step and focus its heading."""
    section.client.run_javascript(f"vibrident.go('{section.props['id']}')")


class Text:
    """Untrusted text, verbatim and monospaced, with a button to copy it."""

    def __init__(self, name: str, title: str, text: str = "") -> None:
        with ui.element("div").classes("code w-full").props(f"id={name}"):
            self._label = ui.label(text).classes("plain").props("tabindex=0 role=region")
            self._label.props["aria-label"] = title
            copy = (
                f"() => navigator.clipboard.writeText(document.querySelector('#{name} "
                ".plain').textContent)"
            )
            button = ui.button(icon="content_copy").props("round flat size=sm").classes("copy")
            button.props["aria-label"] = translate("Copy")
            button.on("click", js_handler=copy)

    def show(self, text: str) -> None:
        """Show another text."""
        self._label.text = text


class ChartView:
    """A chart from its JSON, which is passed to the browser unread.

    NiceGUI's own element would copy every number several times, and asks plotly to fit charts that
    are hidden or gone.
    """

    def __init__(self, figure: bytes, height: int) -> None:
        self.element = ui.element("div").classes("chart")
        self.element.style(f"min-height: {height}px")  # the layout stays when it is drawn
        self.show(figure)

    def show(self, figure: bytes) -> None:
        """Draw the chart, or draw it anew."""
        text = json.dumps(figure.decode())
        self.element.client.run_javascript(f"vibrident.draw('{self.element.html_id}', {text})")


class GrowingChart:
    """A chart that is made with its first points and drawn anew as they grow."""

    def __init__(self, element: ui.element, height: int) -> None:
        self.element = element
        self.height = height
        self.chart: ChartView | None = None
        self.points = 0

    def grows_to(self, points: int) -> bool:
        """Return whether there are other points than those drawn, and count them as drawn."""
        grows = points != self.points
        self.points = points
        return grows

    def show(self, figure: bytes) -> None:
        """Draw the chart, or draw it anew.

        Plotly draws nothing in a hidden element, so none is made before.
        """
        if self.chart is None:
            with self.element:
                self.chart = ChartView(figure, self.height)
        else:
            self.chart.show(figure)

    def forget(self) -> None:
        """Take the chart away."""
        self.element.clear()
        self.chart = None
        self.points = 0


def _for_page(
    error: InputError, session: PageSession | None, labels: NamedTexts = LABELS
) -> InputError:
    """Return the error in the words of the page, without the server's folders."""
    error_on_page = error.in_words(page_word(labels))
    return session.with_local_paths(error_on_page) if session else error_on_page


def _error_to_show(error: BaseException) -> VibridentError:
    """Return vibrident's own errors unchanged; log others, and return their number in the log."""
    if isinstance(error, VibridentError):
        return error
    number = secrets.token_hex(4)
    text = (
        str(error) if isinstance(error, WorkerError) else "".join(traceback.format_exception(error))
    )
    lines = (
        "".join(c if c.isprintable() else " " for c in line)
        for line in text[-_MAX_LOGGED_CHARACTERS:].splitlines()
    )
    _LOG.error(
        "something went wrong, %s\n%s", number, "\n".join(f"{number}  {line}" for line in lines)
    )
    return InputError(
        "Something went wrong.",
        expected="no error of the program",
        found=f"an unexpected error, number {number} in the server's log",
        remedy="your files and results are kept; try again, and report a repeated error with that "
        "number",
    )
