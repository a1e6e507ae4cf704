"""Read uploaded files and results. Each function runs in a separate process.

The server never opens such a file; it receives text, figures as JSON, and bytes of bounded size
from ``vibrident.base.sandbox``.
"""

from __future__ import annotations

import io
import json
import os
import time
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibrident.app.web.form.description import ROLES, Description
from vibrident.app.web.language import Language, language, phrase
from vibrident.app.web.preview import preview
from vibrident.app.web.session import refuse_outside
from vibrident.app.web.translated import charts, fragment
from vibrident.app.web.words import page_word
from vibrident.base.errors import InputError, VibridentError
from vibrident.data.io import read
from vibrident.data.io.certificate import CertificateData, certificate_text
from vibrident.data.io.columns import require_room
from vibrident.data.io.reader import open_columns
from vibrident.result import Result
from vibrident.show import certificate, document, figures, tables
from vibrident.show.certified import describe_raised, raised_to_measured
from vibrident.show.comparison import comparison_tables
from vibrident.show.comparison_curves import comparison_figure
from vibrident.show.coverage import chain_unstated, unstated
from vibrident.show.deviation_points import from_reference
from vibrident.show.findings import describe_findings
from vibrident.show.issue import Issue, issued, with_statements
from vibrident.show.report import content, file_name
from vibrident.show.views import Figure, Sentence

if TYPE_CHECKING:
    from vibrident.lab.history.store import Store

MAX_TEXT_LENGTH = 20_000  # most characters of a calibration file shown
MAX_CHART_BYTES = 4_000_000  # most bytes of charts sent to the browser at once
_MAX_CHECK_S = 40.0  # seconds after which no further file is examined


def read_calibration_text(folder: Path, name: str) -> str:
    """Return the text of a calibration file, of a long one the beginning.

    InputError if it names files outside the folder of the upload.
    """
    refuse_outside(folder / name)
    text = (folder / name).read_text(encoding="utf-8-sig")
    surplus = len(text) - MAX_TEXT_LENGTH
    return text if surplus <= 0 else f"{text[:MAX_TEXT_LENGTH]}\n# … and {surplus} characters more"


def draw_chart(
    description: Description, folder: Path, files: Sequence[str], code: str = "en"
) -> bytes:
    """Return the beginning of the chosen columns as JSON of a figure; ``code``: of its language."""
    return _json(preview(description, folder, files, language(code)))


def find_faults(
    description: Description, folder: Path, files: Sequence[str]
) -> list[dict[str, str]]:
    """Return the fields of a message for each file whose columns an identification would refuse."""
    messages = []
    until = time.monotonic() + _MAX_CHECK_S
    points = [description.get(role) for role in ROLES if role.startswith("table.")]
    response = (description.get("sampling.time_column"), description.get("response.column"))
    for file, reference_file in description.pairs(files):
        own_columns = (
            points
            if description.table
            else response
            if reference_file
            else (*response, *description.motion)
        )
        for name, columns in ((file, own_columns), (reference_file, description.motion)):
            try:
                if name is not None:
                    _require_numbers(
                        folder / name, [column for column in columns if column is not None]
                    )
            except InputError as error:
                messages.append(dict(vars(error)))
        if time.monotonic() > until:
            break
    return messages


def _require_numbers(path: Path, columns: Sequence[int | str]) -> None:
    source = open_columns(path)
    positions = [source.position_of(column, "columns and units") for column in columns]
    require_room(path, sum(source.length(position) for position in positions))
    for position, values in zip(positions, source.load(positions), strict=True):
        source.require_finite(position, values, 0, "repair the file, or remove it")


def require_readable(folder: Path, name: str) -> None:
    """Read all that a calibration file names; InputError if it cannot be read."""
    read(folder / name)


def model_and_estimator(path: Path) -> tuple[str, str]:
    """Return the model and the estimator of a result."""
    result = Result.load(path)
    return result.model, result.estimator


def read_outcome(path: Path, code: str = "en") -> dict[str, Any]:
    """Return the view of a result: verdict, numbers, warnings as HTML, and charts as JSON."""
    speak = language(code)
    fitted = Result.load(path)  # warnings and findings count in its own u, as their sentences do
    result = raised_to_measured(fitted)
    drawn = figures.sensitivity(result), from_reference(result), figures.deviation(result)
    fitting, remaining = _fitting(_named(speak, *drawn), MAX_CHART_BYTES)
    training, remaining = _fitting(_named(speak, figures.training(result)), remaining)
    signals, remaining = _fitting(_charts(speak, figures.signals(result)), remaining)
    return {
        "verdict": fragment(speak, document.verdict(result), *_scatter_only(result, speak)),
        "pdf": (certificate.title(result), file_name(result, "pdf")),
        "states": {
            "certificate": result.certificate,
            "sensor": result.sensor,
            "parameters": [*result.parameters],
        },
        "parameters": fragment(
            speak, tables.parameters(result), *map(Sentence, describe_raised(result))
        ),
        "warnings": fragment(speak, *describe_findings(fitted, page_word(speak=speak))),
        "charts": fitting,
        "found": training,
        "signals": signals,
        "left_out": remaining < 0,
    }


#: Sources by what they make known, in the words of the page.
_SOURCES = {
    ("gain",): phrase(
        "To include it, add a source of kind gain under “{step}”, and identify again."
    ),
    ("phase",): phrase(
        "To include it, add a source of kind phase or timing under “{step}”, and identify again."
    ),
    ("gain", "phase"): phrase(
        "To include it, add sources of kind gain and kind phase (or timing) under “{step}”, and "
        "identify again."
    ),
}


def _scatter_only(result: Result, speak: Language) -> tuple[Sentence, ...]:
    """Return that U covers scatter only, with what to state; nothing where it covers more."""
    lacking = unstated(result)
    if not lacking:
        return ()
    more = speak(_SOURCES[lacking], step=speak("Laboratory and uncertainty"))
    return tuple(
        replace(sentence, text=f"{speak(sentence.text)} {more}")
        for sentence in chain_unstated(result)
    )


def _named(speak: Language, *drawn: Figure | None) -> list[tuple[str, Any]]:
    figures = [figure for figure in drawn if figure is not None]
    return [
        (speak(figure.title), chart) for figure in figures for _, chart in _charts(speak, figure)
    ]


def _charts(speak: Language, figure: Figure | None) -> list[tuple[str, Any]]:
    return [] if figure is None else charts(speak, figure)


def _fitting(
    drawn: Sequence[tuple[str, Any]], max_bytes: int
) -> tuple[list[tuple[str, bytes, int]], int]:
    """Return the charts that fit the limit, and the bytes left; negative if one did not fit.

    Each is its title, its JSON and its height in pixels.
    """
    fitting = []
    for title, figure in drawn:
        text = _json(figure)
        max_bytes -= len(text)
        if max_bytes < 0:
            break
        fitting.append((title, text, figure["layout"]["height"]))
    return fitting, max_bytes


def _issued(path: Path, data: CertificateData) -> tuple[Result, Issue]:
    """Return a result with what is stated for its certificate, in the process of this task."""
    # nobody's: an uploaded template has typst fetch no packages
    os.environ["HTTPS_PROXY"] = "http://127.0.0.1:9"
    return issued(Result.load(path), data)


def write_report(
    paths: Sequence[Path], form: Any, names: Sequence[str], data: CertificateData
) -> bytes:
    """Return the report of one result with its certificate's statements, or of several results."""
    if len(paths) > 1:
        return content([Result.load(path) for path in paths], form, names)
    result, issue = _issued(paths[0], data)
    return content(result, form, issue=issue)


def write_export(
    path: Path, folder: Path, form: str, options: dict[str, Any], data: CertificateData
) -> tuple[bytes, str]:
    """Return one file as it is, several as an archive, with its name.

    The caller removes the folder.
    """
    from vibrident.export import export

    files = export(issued(Result.load(path), data)[0], form, folder, **options)
    if len(files) == 1:
        return files[0].read_bytes(), files[0].name
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
        for file in files:
            packed.write(file, file.relative_to(folder))
    return archive.getvalue(), f"{form}.zip"


def write_everything(
    path: Path, calibration: Path | None, folder: Path, data: CertificateData
) -> bytes:
    """Return an archive of the result, its calibration and certificate files, reports and exports.

    Exports that need options or extras are left out.
    """
    from vibrident.export import export
    from vibrident.export.registry import EXPORTS

    result, issue = _issued(path, data)
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.write(path, "result.json")
        if calibration is not None:
            packed.write(calibration, "calibration.toml")
        if data.certificate or data.sensor:
            packed.writestr("certificate.toml", certificate_text(data))
        for form in ("html", "pdf", "md"):
            packed.writestr(file_name(result, form), content(result, form, issue=issue))
        for name, form in EXPORTS.all().items():
            if form.options or form.extra:
                continue
            try:
                for file in export(result, name, folder / name):
                    packed.write(file, f"exports/{file.relative_to(folder)}")
            except VibridentError:  # a format that cannot hold this sensor
                continue
    return archive.getvalue()


def compare_results(
    paths: Sequence[Path], names: Sequence[str], code: str = "en"
) -> dict[str, Any]:
    """Compare results: a chart as JSON or none, and tables as HTML with their titles."""
    results = [Result.load(path) for path in paths]
    speak = language(code)
    fitting, _ = _fitting(_charts(speak, comparison_figure(results, names)), MAX_CHART_BYTES)
    tables_beside = [
        (speak(title), fragment(speak, table)) for title, table in comparison_tables(results, names)
    ]
    return {"charts": fitting, "tables": tables_beside}


def read_history(path: Path, store: str, data: CertificateData, code: str) -> dict[str, Any]:
    """Return what a store holds of a result's sensor: words, charts as JSON, tables as HTML.

    ``data``: what the form of the certificate states beside the result; ``code``: of the
    language.
    """
    return _history(path, store, data, code, lambda opened, result: "")


def add_to_history(path: Path, store: str, data: CertificateData, code: str) -> dict[str, Any]:
    """Add the result to the store, and return the same as ``read_history``."""
    from vibrident.lab.history.entry import add_all

    def add(opened: Store, result: Result) -> str:
        (added,) = add_all(opened, [result])
        new = phrase("Calibration {number}.")
        present = phrase("Calibration {number} was there already.")
        return language(code)(new if added.new else present, number=added.number)

    return _history(path, store, data, code, add)


def approve_in_history(
    path: Path, store: str, data: CertificateData, code: str, by: str
) -> dict[str, Any]:
    """Add and approve the result's calibration, and return the same as ``read_history``."""
    from vibrident.lab.history.approval import approve
    from vibrident.lab.history.entry import add_all

    def add(opened: Store, result: Result) -> str:
        (added,) = add_all(opened, [result])
        name = result.certificate.get("approved_by") or by
        approve(opened, added.number, by=name, note="" if name == by else f"entered by {by}")
        return language(code)(phrase("Calibration {number} is approved."), number=added.number)

    return _history(path, store, data, code, add)


def _history(
    path: Path,
    store: str,
    data: CertificateData,
    code: str,
    change: Callable[[Store, Result], str],
) -> dict[str, Any]:
    from vibrident.lab.history import page
    from vibrident.lab.history.document import of_result
    from vibrident.lab.history.store import Store

    result = with_statements(Result.load(path), data)
    speak = language(code)
    with Store(store) as opened:
        before = change(opened, result)
        life = of_result(opened, result)
    if life is None:
        nothing = speak("The history holds no calibration of this sensor.")
        return {"words": f"{before} {nothing}".strip(), "charts": [], "tables": ""}
    blocks = [block for section in page.report(life).sections for block in section.blocks]
    drawn = [
        (figure.title, chart)
        for figure in blocks
        if isinstance(figure, Figure)
        for _, chart in _charts(speak, figure)
    ]
    table_html = fragment(speak, *(block for block in blocks if not isinstance(block, Figure)))
    singular = "The history holds {count} calibration of this sensor."
    plural = "The history holds {count} calibrations of this sensor."
    words = speak.count(len(life["calibrations"]), singular, plural)
    return {
        "words": f"{before} {words}".strip(),
        "charts": _fitting(drawn, MAX_CHART_BYTES)[0],
        "tables": table_html,
    }


def _json(tree: Any) -> bytes:
    try:
        return json.dumps(tree, separators=(",", ":"), allow_nan=False).encode()
    except ValueError as error:
        raise VibridentError("NaN or infinity cannot be drawn.") from error
