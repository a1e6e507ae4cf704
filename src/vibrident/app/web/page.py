"""Build the page of one browser tab: its steps in order, with the state of an earlier visit."""

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
from vibrident.app.web.language import (
    LANGUAGES,
    LOCALES,
    page_language,
    phrase,
    translate,
    translate_count,
)
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
_STATE_LOST = "The server no longer has the data, the form and the results of this page."
_REASON_OF_LOSS = (
    "It needed the room, or the page was left for longer than it keeps them. Load the files again."
)
_MAX_OFFERED_TABS = 4  # earlier tabs whose work a new one is offered
_SCRIPT = (_FOLDER / "page.js").read_text(encoding="utf-8")


async def page(users: Users) -> None:
    """Build the page.

    Expensive parts wait until a browser has connected; a bare request gets a heading.
    """
    ui.colors(primary="#0a4b78", positive="#14632f", negative="#a1001a", warning="#7a4b00")
    ui.add_css(_STYLE)
    ui.add_body_html(f"<script>{_SCRIPT}</script>")
    client = ui.context.client
    client.page = copy.copy(client.page)  # this visitor's language also for Quasar's own words
    client.page.language = LOCALES[page_language().code]  # type: ignore[assignment]
    _add_html(f'<a class="skip" href="#main">{html(translate("To the content"))}</a>')
    with ui.element("header").classes("top"):
        _add_html(f"<h1>vibrident</h1><p>{html(translate(_SUBTITLE))}</p>")
        _build_visitor_menu(client.request.scope.get(ACCOUNT))
    contents = html(translate("Contents"))
    _add_html(  # filled by the script
        f'<nav class="contents" aria-label="{contents}" id="contents" hidden></nav>'
    ).classes("w-full")
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
            await _report_lost_state()
            _offer_earlier_work(user)
        await _build_steps(user)


def _add_html(trusted: str) -> ui.html:
    """Add HTML whose texts of others are escaped already."""
    return ui.html(trusted, sanitize=False)


def _build_visitor_menu(account: Any) -> None:
    """Build the choice of language, and the button to sign out for who has signed in."""
    current = page_language().code
    options = "".join(
        f'<option value="{code}" '
        f'lang="{LOCALES[code]}"{" selected" * (code == current)}>{name}</option>'
        for code, name in LANGUAGES.items()
    )
    label = html(translate("Language"))
    content = f'<select id="language" aria-label="{label}">{options}</select>'
    if account:
        content += f"<span>{html(account.name)}</span>"
        if account.hash:
            button = html(translate("Sign out"))
            content += f'<form method="post" action="{SIGN_OUT}"><button>{button}</button></form>'
    _add_html(f'<div class="who">{content}</div>')


async def _report_lost_state() -> None:
    """Report that the state of this tab is lost, if the browser remembers that it had one.

    To be called before the steps, which tell the browser that the tab is empty.
    """
    try:
        had_state = await ui.run_javascript("sessionStorage.vibridentHeld === 'yes'", timeout=5.0)
    except TimeoutError:
        return
    if had_state:
        with ui.element("div").classes("warning").props("role=alert id=gone"):
            ui.label(translate(_STATE_LOST)).classes("problem")
            ui.label(translate(_REASON_OF_LOSS))


def _offer_earlier_work(user: User) -> None:
    """Offer the work of this user's closed tabs."""
    if not (closed_tabs := user.users.closed_tabs_of(user.owner)):
        return

    def take_over(earlier: User) -> None:
        user.users.hand_over(earlier, user)
        ui.navigate.reload()

    with ui.element("div").classes("actions").props("id=left-work role=group") as row:
        row.props["aria-label"] = translate("Earlier work")
        ui.label(translate("Go on with earlier work:"))
        for earlier in closed_tabs[:_MAX_OFFERED_TABS]:
            last_seen = time.strftime("%Y-%m-%d %H:%M", time.localtime(earlier.last_seen_s))
            files = translate_count(len(earlier.session.names), "{count} file", "{count} files")
            results = translate_count(len(earlier.results), "{count} result", "{count} results")
            label = f"{files}, {results}, {last_seen}"
            frame.add_button(label, partial(take_over, earlier))


async def _build_steps(user: User) -> None:
    """Build the steps in their order, and show the tab's earlier state."""
    issue = IssueStep(user)
    outcome = OutcomeStep(user, issue)
    compare = CompareStep(user)
    fit = FitStep(user)
    data = DataStep(user)
    tools = ToolsStep(user)
    sensors = SensorsStep(user)
    laboratory = LaboratoryStep(user, fit)
    columns = ColumnsStep(user, data, laboratory, fit)

    async def show_results(*, go: bool = True) -> None:
        data.save_state()
        await outcome.show(go=go)
        await compare.show()
        tools.show()
        if not user.session.names:  # with data it is shown with their form
            laboratory.show()
        await sensors.show()

    async def show_data() -> None:
        tools.show()
        await columns.show()

    data.build(on_data=show_data, on_result=show_results)
    await asyncio.sleep(0)  # yield between the steps
    columns.build()
    laboratory.build()
    fit.build(on_result=show_results)
    await asyncio.sleep(0)
    outcome.build()
    compare.build()
    tools.build(on_result=show_results)
    issue.build()
    sensors.build(on_open=outcome.open)
    data.save_state()
    if not user.empty:
        await columns.restore()  # with the laboratory
        await fit.restore()
        if user.results:
            await outcome.show(go=False)
            await compare.show()
    await issue.show()  # these two last: they read the store, and meanwhile data may come
    await sensors.show()
