"""Build the fourth step: the result as curve, numbers and warnings, and its downloads."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from typing import Any, Protocol

from nicegui import ui

from vibrident.app.web import frame, sandboxed
from vibrident.app.web.form.certify import CertificateForm
from vibrident.app.web.language import page_language, translate
from vibrident.app.web.session import RESULT
from vibrident.app.web.state import NamedResult
from vibrident.app.web.user import User
from vibrident.app.web.words import LABELS
from vibrident.base.fields import Fields
from vibrident.data.io.certificate import CertificateData
from vibrident.show.report import FILE_NAMES

_MAX_EXPORT_BYTES = 200_000_000  # of a file that an export writes
#: A process that may write needs a limit, and the store's file may have any size.
MAX_STORE_BYTES = 1 << 42


class DraftReceiver(Protocol):
    """A step that takes drafts of certificates."""

    @property
    def is_offered(self) -> bool:
        """Return whether drafts can be handed in."""
        ...

    async def hand_in(self, named: NamedResult, data: CertificateData) -> None:
        """Hand in a draft of a result."""
        ...


class OutcomeStep:
    """The section of the latest result."""

    def __init__(self, user: User, hand_in: DraftReceiver) -> None:
        self.user = user
        self.hand_in = hand_in
        self.version = 0  # of the content; increases whenever it is replaced
        self.is_choice_set = False  # while the program, not the user, changes the choice

    def build(self) -> None:
        """Build the section, hidden until there is a result."""
        self.section = frame.add_step(translate("Result"), "result")
        with self.section:
            self.choice = ui.select([], label=translate("Shown")).classes("w-full")
            self.choice.props("dense outlined stack-label")
            self.choice.on_value_change(lambda: None if self.is_choice_set else self._show_chosen())
            self.notice = ui.label("").classes("warning").props("role=status")
            self.body = ui.element("div")
        self.section.visible = False

    async def show(self, *, go: bool = True) -> None:
        """Show the latest result."""
        names = [named.name for named in self.user.results]
        self.section.visible = bool(names)
        self.choice.visible = len(names) > 1
        self.notice.text = translate(self.user.notice)
        self.notice.visible = bool(self.user.notice)
        if not names:
            return
        self.is_choice_set = True
        self.choice.set_options(names, value=names[-1])
        self.is_choice_set = False
        await self._show_chosen(go=go)

    async def open(self, name: str) -> None:
        """Show a result by its name."""
        self.is_choice_set = True
        self.choice.value = name
        self.is_choice_set = False
        await self._show_chosen(go=True)

    async def _show_chosen(self, *, go: bool = False) -> None:
        chosen = [named for named in self.user.results if named.name == self.choice.value]
        if not chosen:
            return
        named = chosen[0]
        self.version += 1
        version = self.version
        outcome = None
        with frame.reporting(self.body, self.user):
            with self.body:
                ui.spinner(size="28px")
            look = (sandboxed.read_outcome, named.path, page_language().code)
            outcome = await self.user.run_sandboxed(*look)
        if outcome is None or version != self.version or self.body.is_deleted:
            return
        self.body.clear()
        with self.body:
            for table in ("verdict", "parameters", "warnings"):
                if outcome[table]:  # of ``sandboxed``, where untrusted text was escaped
                    ui.html(outcome[table], sanitize=False)
            self.certificate = CertificateForm(self.user, named, outcome["states"])
            self._build_downloads(named, *outcome["pdf"])
            self.certificate.build()
            self.errors = frame.add_error_area()
            _curves(outcome)
            self._build_exports(named)
            if go:  # before the history, which is read in a process of its own
                frame.scroll_to(self.section)
            if store := self.user.users.store:
                await HistoryPanel(self.user, named, store, self.certificate, self.hand_in).build()

    def _build_downloads(self, named: NamedResult, pdf_title: str, pdf_name: str) -> None:
        """Build the buttons of the documents; ``pdf_title``: what the PDF is."""
        frame.heading(translate(LABELS["report.form"]))
        reports = {
            "html": (translate("Report (HTML)"), FILE_NAMES["html"][0]),
            "pdf": (f"{translate(pdf_title)} (PDF)", pdf_name),
            "md": (translate("Report (Markdown)"), FILE_NAMES["md"][0]),
        }
        with frame.actions():
            frame.add_button(
                "result.json",
                lambda: ui.download.file(named.path, self.certificate.name_of_file(RESULT)),
                "id=get-json",
            )
            for form, (label, name) in reports.items():
                download = partial(self._download_report, named, form, name)
                frame.add_button(label, download, f"outline id=get-{form}")
            frame.add_button(
                translate("Everything (zip)"),
                partial(self._download_everything, named),
                "outline id=get-everything",
            )
        if named.request is not None:
            (name,) = named.request.files
            with ui.expansion(translate("The same in a shell")) as commands:
                frame.hint(translate("With {file} in the folder of the data:", file=name))
                frame.Text("command", translate("Command"), named.request.command)
                frame.add_button(
                    name, lambda: ui.download.file(named.calibration, name), "outline id=get-toml"
                )
            commands.classes("w-full").props("id=in-a-shell")

    def _build_exports(self, named: NamedResult) -> None:
        """Build the choice of other formats, each with its own options."""
        from vibrident.export.form import OPTIONS
        from vibrident.export.registry import EXPORTS

        forms = EXPORTS.all()
        plain = next(name for name, form in forms.items() if not (form.options or form.extra))
        titles = {name: f"{name}: {translate(form.title)}" for name, form in forms.items()}
        frame.heading(translate("Other formats"))
        with frame.actions():
            choice = ui.select(titles, value=plain, label=translate(LABELS["export.form"]))
            choice.style("min-width: min(15rem, 100%)")
            fields = {
                name: (ui.number if option.number else ui.input)(translate(option.label))
                for name, option in OPTIONS.items()
                if option.label
            }
            for element in (choice, *fields.values()):
                element.props("dense outlined stack-label")

            def show_fields() -> None:
                for name, field in fields.items():
                    field.visible = name in forms[choice.value].options

            async def export() -> None:
                options = {name: field.value or None for name, field in fields.items()}
                with frame.reporting(errors, self.user):
                    await self._download_export(named, choice.value, options)

            show_fields()
            choice.on_value_change(show_fields)
            frame.add_button(translate("Export"), export, "outline id=get-export")
        errors = frame.add_error_area()

    @frame.reported
    async def _download_report(self, named: NamedResult, form: str, name: str) -> None:
        name = self.certificate.name_of_file(name)
        await self.user.note("issued", named.path, document=name)
        stated = self.certificate.stated_data()
        report = (sandboxed.write_report, [named.path], form, [], stated)
        await offer_download(self.user, name, *report)

    @frame.reported
    async def _download_everything(self, named: NamedResult) -> None:
        await self.user.note("issued", named.path, document="everything.zip")
        calibration = named.calibration if named.request is not None else None
        name = self.certificate.name_of_file("calibration.zip")
        stated = self.certificate.stated_data()
        async with self.user.session.new_folder("export") as folder:
            archive = (sandboxed.write_everything, named.path, calibration, folder, stated)
            await offer_download(self.user, name, *archive, file_bytes=_MAX_EXPORT_BYTES)

    async def _download_export(self, named: NamedResult, form: str, options: Fields) -> None:
        await self.user.note("exported", named.path, form=form)
        full_name = self.certificate.name_of_file
        stated = self.certificate.stated_data()
        async with self.user.session.new_folder("export") as folder:
            export = (sandboxed.write_export, named.path, folder, form, options, stated)
            await offer_download(self.user, full_name, *export, file_bytes=_MAX_EXPORT_BYTES)


class HistoryPanel:
    """The history of a result's sensor in a store, with buttons that add and approve the result.

    ``store``: its URL.
    """

    def __init__(
        self,
        user: User,
        named: NamedResult,
        store: str,
        certificate: CertificateForm,
        hand_in: DraftReceiver,
    ) -> None:
        self.user = user
        self.named = named
        self.store = store
        self.certificate = certificate  # states date, number and approver
        self.hand_in = hand_in

    async def build(self) -> None:
        """Build the panel, and show what the store holds."""
        frame.heading(translate("History"))
        may_identify = self.user.may("identify")
        with frame.actions():
            self.button = frame.add_button(
                translate("Add to history"), self._add, "outline id=add-to-history"
            )
            self.button.visible = may_identify
            approve = frame.add_button(
                translate("Add and approve"), self._approve, "outline id=approve"
            )
            approve.visible = self.user.may("approve")
            draft = frame.add_button(
                translate("Hand in for review"), self._hand_in, "outline id=hand-in"
            )
            draft.visible = self.hand_in.is_offered and may_identify
        self.status = frame.hint("").props("role=status id=history-words")
        self.errors = frame.add_error_area()
        self.body = ui.element("div").props("id=history")
        await self._update()

    async def _add(self) -> None:
        self.button.disable()
        await self.user.note("added to history", self.named.path)
        await self._update("add")
        if not self.button.is_deleted:
            self.button.enable()

    @frame.reported
    async def _hand_in(self) -> None:
        await self.hand_in.hand_in(self.named, self.certificate.stated_data())

    @frame.reported
    async def _approve(self) -> None:
        self.user.require("approve", "approve")
        await self.user.note("approved", self.named.path)
        approver = self.user.owner if self.user.users.door else "the page"
        await self._update("approve", approver)

    @frame.reported
    async def _update(self, *change: str) -> None:
        """Change the history, as ``sandboxed.history`` does, and show it."""
        if change and not self.user.may("identify"):
            return
        outcome = await self.user.run_sandboxed(
            sandboxed.history,
            self.named.path,
            self.store,
            self.certificate.stated_data(),
            page_language().code,
            *change,
            file_bytes=MAX_STORE_BYTES,
        )
        if self.body.is_deleted:
            return
        self.status.text = outcome["words"]
        self.body.clear()
        with self.body:
            for _, figure, height in outcome["charts"]:
                frame.ChartView(figure, height)
            ui.html(outcome["tables"], sanitize=False)


async def offer_download(
    user: User, name: str | Callable[[str], str], function: Any, *args: Any, **limits: Any
) -> None:
    """Let the browser download the file that a function of ``sandboxed`` makes.

    ``name``: of the file; or a function from the name that the sandboxed function returns as well.
    """
    content = await user.run_sandboxed(function, *args, **limits)
    if not isinstance(name, str):
        content, plain = content
        name = name(plain)
    download = await asyncio.to_thread(user.session.download, content)
    if user.connected:
        ui.download.file(download, name)


def _curves(outcome: Fields) -> None:
    if outcome["left_out"]:
        frame.hint(translate("Not everything can be drawn here; see the report (HTML)."))
    for title, figure, height in outcome["charts"]:
        frame.heading(title)
        frame.ChartView(figure, height)
    if outcome["found"]:
        behind = ui.expansion(translate("How it was found")).classes("w-full").props("id=how")

        def draw() -> None:  # plotly draws nothing in a hidden element
            if behind.value and not behind.default_slot.children:
                with behind:
                    for _, figure, height in outcome["found"]:
                        frame.ChartView(figure, height)

        behind.on_value_change(draw)
    if signals := outcome["signals"]:
        frame.heading(translate("Signals"))
        if len(signals) > 1:
            names = {number: name for number, (name, *_) in enumerate(signals)}
            choice = ui.select(names, value=0, label=translate("Record")).props(
                "dense outlined stack-label"
            )
            choice.style("max-width: 20rem")
            choice.on_value_change(lambda event: plot.show(signals[event.value][1]))
        plot = frame.ChartView(*signals[0][1:])
