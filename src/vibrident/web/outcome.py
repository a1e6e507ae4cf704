"""Fourth step: the result as curve, numbers and warnings, and everything that can be taken home."""

from __future__ import annotations

import io
import tempfile
import zipfile
from pathlib import Path
from typing import Any

from nicegui import run, ui

from vibrident.cli.options import EXPORTS
from vibrident.errors import InputError, VibridentError
from vibrident.report import FILE_NAMES, content, figures, tables, words
from vibrident.report import page as written
from vibrident.result import Result
from vibrident.web import frame
from vibrident.web.session import RESULT


class OutcomeStep:
    """The latest result."""

    def __init__(self, user: frame.User) -> None:
        self.user = user

    def build(self) -> None:
        """Build the section, hidden until there is a result."""
        self.section = frame.step(4, "Result", "result")
        with self.section:
            self.choice = (
                ui.select([], label="Shown", on_change=self._draw).props("dense outlined stack-label").classes("w-full")
            )
            self.body = ui.element("div")
        self.section.visible = False

    def show(self) -> None:
        """Show the latest result."""
        names = [named.name for named in self.user.results]
        self.section.visible = True
        self.choice.visible = len(names) > 1
        if self.choice.value == names[-1]:
            self._draw()
        self.choice.set_options(names, value=names[-1])
        ui.run_javascript("document.getElementById('result').scrollIntoView({behavior: 'smooth'})")

    def _draw(self) -> None:
        named = next((named for named in self.user.results if named.name == self.choice.value), None)
        if named is None:
            return
        self.body.clear()
        with self.body:
            _verdict(named.result)
            self._downloads(named)
            self.errors = ui.element("div").props("aria-live=assertive")
            _curves(named.result)
            self._exports(named)
            self.export_errors = ui.element("div").props("aria-live=assertive")

    def _downloads(self, named: frame.Named) -> None:
        ui.html("<h3>Download</h3>", sanitize=False)
        with ui.element("div").classes("actions"):
            ui.button("result.json", on_click=lambda: ui.download.content(named.content, RESULT)).props("id=get-json")
            for form, label in (("html", "Report (HTML)"), ("pdf", "Certificate (PDF)"), ("md", "Report (Markdown)")):
                ui.button(label, on_click=lambda form=form: self._report(named, form)).props(f"outline id=get-{form}")
            if named.calibration is not None and named.choices is not None:
                text, name = named.calibration.encode(), named.choices.calibration
                ui.button(name, on_click=lambda: ui.download.content(text, name)).props("outline id=get-toml")
        if named.choices is not None:
            ui.label(f"With {named.choices.calibration} in the folder of the data, the same in a shell:").classes(
                "hint"
            )
            ui.code(named.choices.command, language="bash").classes("w-full").props("id=command")

    def _exports(self, named: frame.Named) -> None:
        """Other formats, each with the option that it alone needs."""
        from vibrident.export.formats import FORMATS

        titles = {name: f"{name}: {FORMATS[name].title}" for name in EXPORTS}
        ui.html("<h3>Other formats</h3>", sanitize=False)
        with ui.element("div").classes("actions"):
            form = ui.select(titles, value="csv", label="Export as").style("min-width: 15rem")
            options = (
                (rate := ui.number("Sampling rate in Hz"), ("c", "fmu")),
                (channel := ui.input("Channel, NET.STA.LOC.CHA"), ("stationxml", "sacpz")),
                (country := ui.input("Country, two letters"), ("dcc",)),
            )
            for field, forms in options:
                field.bind_visibility_from(form, "value", backward=lambda value, forms=forms: value in forms)
            for field in (form, rate, channel, country):
                field.props("dense outlined stack-label")
            ui.button(
                "Export", on_click=lambda: self._export(named, form.value, rate.value, channel.value, country.value)
            ).props("outline id=get-export")

    async def _report(self, named: frame.Named, form: Any) -> None:
        self.errors.clear()
        try:
            made = await run.io_bound(content, named.result, form)
        except VibridentError as error:
            frame.show_error(self.errors, error)
            return
        ui.download.content(made or b"", FILE_NAMES[form][0])

    async def _export(self, named: frame.Named, form: str, rate: Any, channel: Any, country: Any) -> None:
        self.export_errors.clear()
        try:
            made = await run.io_bound(_exported, named.result, form, rate, channel or None, country or None)
        except InputError as error:
            frame.show_error(self.export_errors, error)
            return
        if made is not None:
            ui.download.content(*made)


def _exported(
    result: Result, form: str, rate: float | None, channel: str | None, country: str | None
) -> tuple[bytes, str]:
    """One file as it is, several as an archive; with its name."""
    from vibrident.export import export

    with tempfile.TemporaryDirectory(prefix="vibrident-") as folder:
        files = export(result, form, folder, rate_hz=rate, channel=channel, country=country)
        if len(files) == 1:
            return files[0].read_bytes(), files[0].name
        archive = io.BytesIO()
        with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
            for file in files:
                packed.write(file, file.relative_to(Path(folder)))
        return archive.getvalue(), f"{form}.zip"


def _verdict(result: Result) -> None:
    fine = result.fit.adequate and not result.warnings
    verdict = "The model is adequate for these data" if result.fit.adequate else "The model does not describe the data"
    doubts = f"{tables.count(len(result.warnings), 'warning')}, below" if result.warnings else "no warnings"
    kind = "verdict" if fine else "doubt"
    ui.html(f'<p class="{kind}"><b>{verdict}</b>; {doubts}.</p>', sanitize=False)
    ui.html(f'<div class="scroll">{written.table(tables.parameters(result))}</div>', sanitize=False)
    for code in result.warning_codes:
        explained = words.explain(code)
        messages = [warning.message for warning in result.warnings if warning.code == code]
        ui.html(
            f'<div class="warning"><h3>{written.text(explained.title.capitalize())} <code>({written.text(code)})</code>'
            f"</h3>{written.paragraphs([*messages, explained.meaning])}<p><b>What to do:</b> "
            f"{written.text(explained.action).replace('`', '')}</p></div>",
            sanitize=False,
        )


def _curves(result: Result) -> None:
    drawn = (
        ("Sensitivity", figures.sensitivity(result)),
        ("Deviation of the model from the measurement", figures.deviation(result)),
        ("Training", figures.training(result)),
    )
    for title, figure in drawn:
        if figure is not None:
            ui.html(f"<h3>{title}</h3>", sanitize=False)
            ui.plotly(figure).classes("chart")
    if signals := figures.signals(result):
        ui.html("<h3>Signals</h3>", sanitize=False)
        shown = dict(signals)
        if len(signals) > 1:
            choice = ui.select(list(shown), value=signals[0][0], label="Record").props("dense outlined stack-label")
            choice.style("max-width: 20rem").on_value_change(lambda event: plot.update_figure(shown[event.value]))
        plot = ui.plotly(signals[0][1]).classes("chart")
