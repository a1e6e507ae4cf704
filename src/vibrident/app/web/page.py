"""Build one user's page: the steps in their order. A tab that reconnects finds its state."""

from __future__ import annotations

import asyncio
import copy
import time
from functools import partial
from pathlib import Path
from typing import Any

from nicegui import ui

from vibrident.app.web import frame
from vibrident.app.web.authentication import SIGN_OUT
from vibrident.app.web.compare import CompareStep
from vibrident.app.web.data import DataStep
from vibrident.app.web.fit import FitStep
from vibrident.app.web.form.columns import ColumnsStep
from vibrident.app.web.form.laboratory import LaboratoryStep
from vibrident.app.web.guard import ACCOUNT, OWNER
from vibrident.app.web.issue import IssueStep
from vibrident.app.web.language import LANGUAGES, LOCALES, phrase, say, say_count, spoken
from vibrident.app.web.outcome import OutcomeStep
from vibrident.app.web.sensors import SensorsStep
from vibrident.app.web.tools import ToolsStep
from vibrident.app.web.user import User
from vibrident.app.web.users import Users
from vibrident.base.errors import InputError
from vibrident.base.escaping import html

_FOLDER = Path(__file__).parent
_STYLE = (_FOLDER / "page.css").read_text(encoding="utf-8")
_SUBTITLE = phrase("From calibration records to a sensor's dynamic model")
_MAX_OFFERED_TABS = 4  # most earlier tabs whose work a new one is offered
_SCRIPT = (_FOLDER / "page.js").read_text(encoding="utf-8")


async def page(users: Users) -> None:
    """Build the page.

    Expensive parts wait until a browser has connected; a bare request gets a heading.
    """
    ui.colors(primary="#0a4b78", positive="#14632f", negative="#a1001a", warning="#7a4b00")
    ui.add_css(_STYLE)
    ui.add_body_html(f"<script>{_SCRIPT}</script>")
    client = ui.context.client
    client.page = copy.copy(client.page)  # Quasar's own words are in the language of this visitor
    client.page.language = LOCALES[spoken().code]  # type: ignore[assignment]
    ui.html(f'<a class="skip" href="#main">{html(say("To the content"))}</a>', sanitize=False)
    with ui.element("header").classes("top"):
        ui.html(f"<h1>vibrident</h1><p>{html(say(_SUBTITLE))}</p>", sanitize=False)
        _visitor(client.request.scope.get(ACCOUNT))
    called = html(say("Contents"))
    # filled by the script
    contents = f'<nav class="contents" aria-label="{called}" id="contents" hidden></nav>'
    ui.html(contents, sanitize=False).classes("w-full")
    main = ui.element("div").classes("steps").props("id=main")  # within the main of NiceGUI
    await client.connected()
    if client.is_deleted:
        return
    with main:
        errors = ui.element("div").props("aria-live=assertive id=errors")
        ui.on_exception(lambda error: frame.show_error(errors, error))
        try:
            user = users.attach(client, client.request.scope.get(OWNER, ""))
        except InputError as error:
            frame.show_error(errors, error)
            return
        if user.empty:
            await _say_if_gone()
            _offer(user)
        await _steps(user)


def _visitor(account: Any) -> None:
    """Offer the languages, and to sign out where somebody has signed in."""
    current = spoken().code
    options = "".join(
        f'<option value="{code}" '
        f'lang="{LOCALES[code]}"{" selected" * (code == current)}>{name}</option>'
        for code, name in LANGUAGES.items()
    )
    content = f'<select id="language" aria-label="{html(say("Language"))}">{options}</select>'
    if account:
        content += f"<span>{html(account.name)}</span>"
        if account.hash:
            button = html(say("Sign out"))
            content += f'<form method="post" action="{SIGN_OUT}"><button>{button}</button></form>'
    ui.html(f'<div class="who">{content}</div>', sanitize=False)


async def _say_if_gone() -> None:
    """Say that the state of this tab is lost, if the browser remembers that it had one.

    To be called before the steps, which tell the browser that the tab is empty.
    """
    try:
        was_held = await ui.run_javascript("sessionStorage.vibridentHeld === 'yes'", timeout=5.0)
    except TimeoutError:
        return
    if was_held:
        with ui.element("div").classes("warning").props("role=alert id=gone"):
            gone = say("The server no longer has the data, the form and the results of this page.")
            ui.label(gone).classes("problem")
            ui.label(
                say(
                    "It needed the room, or the page was left for longer than it keeps them. Load "
                    "the files again."
                )
            )


def _offer(user: User) -> None:
    """Offer the work of this user's closed tabs."""
    if not (closed_tabs := user.users.closed_tabs_of(user.owner)):
        return

    def take(earlier: User) -> None:
        user.users.hand_over(earlier, user)
        ui.navigate.reload()

    with ui.element("div").classes("actions").props("id=left-work role=group") as row:
        row.props["aria-label"] = say("Earlier work")
        ui.label(say("Go on with earlier work:"))
        for earlier in closed_tabs[:_MAX_OFFERED_TABS]:
            at = time.strftime("%Y-%m-%d %H:%M", time.localtime(earlier.seen))
            files = say_count(len(earlier.session.names), "{count} file", "{count} files")
            results = say_count(len(earlier.results), "{count} result", "{count} results")
            named = f"{files}, {results}, {at}"
            ui.button(named, on_click=partial(take, earlier)).props("outline")


async def _steps(user: User) -> None:
    issue = IssueStep(user)
    outcome = OutcomeStep(user, issue)
    compare = CompareStep(user)
    fit = FitStep(user)
    data = DataStep(user)
    tools = ToolsStep(user)
    sensors = SensorsStep(user)
    laboratory = LaboratoryStep(user, fit)
    columns = ColumnsStep(user, data, laboratory, fit)

    async def results(*, go: bool = True) -> None:
        data.hold()
        await outcome.show(go=go)
        await compare.show()
        tools.show()
        if not user.session.names:  # with data it is shown with their form
            laboratory.show()
        await sensors.show()

    async def came() -> None:
        tools.show()
        await columns.show()

    data.build(on_data=came, on_result=results)
    await asyncio.sleep(0)  # yield between the steps
    columns.build()
    laboratory.build()
    fit.build(on_result=results)
    await asyncio.sleep(0)
    outcome.build()
    compare.build()
    tools.build(on_result=results)
    issue.build()
    sensors.build(on_open=outcome.open)
    data.hold()
    if not user.empty:
        await _restore(user, columns, fit, outcome, compare)
    await issue.show()  # these two last: they read the store, and meanwhile data may come
    await sensors.show()


async def _restore(
    user: User, columns: ColumnsStep, fit: FitStep, outcome: OutcomeStep, compare: CompareStep
) -> None:
    """Show the earlier state of the tab."""
    await columns.restore()  # with the laboratory
    await fit.restore()
    if user.results:
        await outcome.show(go=False)
        await compare.show()
