"""Last step: results side by side, those of this page and those brought along."""

from __future__ import annotations

from nicegui import run, ui

from vibrident.errors import VibridentError
from vibrident.report import FILE_NAMES, content, figures_beside
from vibrident.report import page as written
from vibrident.report.side_by_side import comparison_tables
from vibrident.web import frame


class CompareStep:
    """Several results."""

    def __init__(self, user: frame.User) -> None:
        self.user = user

    def build(self) -> None:
        """Build the section, hidden until there are two results."""
        self.section = frame.step(5, "Compare", "compare")
        with self.section:
            self.choice = ui.select([], label="Results", multiple=True, on_change=self._draw)
            self.choice.props("dense outlined stack-label use-chips").classes("w-full")
            self.body = ui.element("div")
        self.section.visible = False

    def show(self) -> None:
        """Offer all results."""
        names = [named.name for named in self.user.results]
        self.section.visible = len(names) > 1
        if self.section.visible:
            self.choice.set_options(names, value=names)

    def _chosen(self) -> tuple[list, list[str]]:
        chosen = [named for named in self.user.results if named.name in (self.choice.value or [])]
        return [named.result for named in chosen], [named.name for named in chosen]

    def _draw(self) -> None:
        results, names = self._chosen()
        self.body.clear()
        if len(results) < 2:
            return
        with self.body:
            if (figure := figures_beside.beside(results, names)) is not None:
                ui.plotly(figure).classes("chart")
            for title, table in comparison_tables(results, names):
                ui.html(
                    f'<h3>{written.text(title)}</h3><div class="scroll">{written.table(table)}</div>', sanitize=False
                )
            with ui.element("div").classes("actions"):
                ui.button("Comparison (HTML)", on_click=lambda: self._report("html")).props("outline")
                ui.button("Comparison (PDF)", on_click=lambda: self._report("pdf")).props("outline")
            self.errors = ui.element("div").props("aria-live=assertive")

    async def _report(self, form) -> None:
        self.errors.clear()
        results, names = self._chosen()
        try:
            made = await run.io_bound(content, results, form, names)
        except VibridentError as error:
            frame.show_error(self.errors, error)
            return
        ui.download.content(made or b"", FILE_NAMES[form][1])
