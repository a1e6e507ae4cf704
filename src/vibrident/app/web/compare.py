"""Build the last step: results side by side, of this page and uploaded ones."""

from __future__ import annotations

from pathlib import Path

from nicegui import ui

from vibrident.app.web import frame, sandboxed
from vibrident.app.web.language import page_language, translate
from vibrident.app.web.outcome import offer_download
from vibrident.app.web.user import User
from vibrident.base.escaping import html
from vibrident.data.io.certificate import CertificateData
from vibrident.show.report import FILE_NAMES


class CompareStep:
    """The section that compares several results."""

    def __init__(self, user: User) -> None:
        self.user = user
        self.version = 0

    def build(self) -> None:
        """Build the section, hidden until there are two results."""
        self.section = frame.add_step(translate("Compare"), "compare")
        with self.section:
            self.choice = ui.select([], label=translate("Results"), multiple=True)
            self.choice.props("dense outlined stack-label use-chips").classes("w-full")
            self.choice.on_value_change(self._draw)
            self.errors = frame.add_error_area()
            self.body = ui.element("div")
        self.section.visible = False

    async def show(self) -> None:
        """Offer all results."""
        names = [named.name for named in self.user.results]
        self.section.visible = len(names) > 1
        if self.section.visible:
            self.choice.set_options(names, value=names)

    def _selected(self) -> tuple[list[Path], list[str]]:
        results = [named for named in self.user.results if named.name in (self.choice.value or [])]
        return [named.path for named in results], [named.name for named in results]

    @frame.reported
    async def _draw(self) -> None:
        paths, names = self._selected()
        self.version += 1
        version = self.version
        self.body.clear()
        if len(paths) < 2:
            return
        outcome = await self.user.run_sandboxed(
            sandboxed.compare_results, paths, names, page_language().code
        )
        if version != self.version or self.body.is_deleted:
            return
        with self.body:
            for _, figure, height in outcome["charts"]:
                frame.ChartView(figure, height)
            for title, table in outcome["tables"]:
                ui.html(f"<h3>{html(title)}</h3>{table}", sanitize=False)
            with frame.actions():
                frame.add_button(translate("Comparison (HTML)"), lambda: self._report("html"))
                frame.add_button(translate("Comparison (PDF)"), lambda: self._report("pdf"))

    @frame.reported
    async def _report(self, form: str) -> None:
        paths, names = self._selected()
        report = (sandboxed.write_report, paths, form, names, CertificateData())
        await offer_download(self.user, FILE_NAMES[form][1], *report)
