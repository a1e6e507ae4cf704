"""Read uploaded files and results. Each function runs in a separate process.

The server never opens such a file; it receives text, figures as JSON, and bytes of bounded size
from ``vibrident.base.sandbox``.
"""

from __future__ import annotations

import io
import os
import time
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibrident.app.web.form.description import ROLES, Description
from vibrident.app.web.language import Language, language, phrase
from vibrident.app.web.preview import preview
from vibrident.app.web.session import refuse_outside
from vibrident.app.web.translated import MAX_CHART_BYTES, charts, fitting, fragment
from vibrident.app.web.words import page_word
from vibrident.base.errors import InputError, VibridentError
from vibrident.base.fields import Fields, NamedTexts
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
    return preview(description, folder, files, language(code))


def find_faults(description: Description, folder: Path, files: Sequence[str]) -> list[NamedTexts]:
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


def read_outcome(path: Path, code: str = "en") -> Fields:
    """Return the view of a result: verdict, numbers, warnings as HTML, and charts as JSON."""
    speak = language(code)
    fitted = Result.load(path)  # warnings and findings count in its own u, as their sentences do
    result = raised_to_measured(fitted)
    drawn = figures.sensitivity(result), from_reference(result), figures.deviation(result)
    curves, remaining = fitting(charts(speak, *drawn), MAX_CHART_BYTES)
    training, remaining = fitting(charts(speak, figures.training(result)), remaining)
    signals, remaining = fitting(charts(speak, figures.signals(result)), remaining)
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
        "charts": curves,
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
    path: Path, folder: Path, form: str, options: Fields, data: CertificateData
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


def compare_results(paths: Sequence[Path], names: Sequence[str], code: str = "en") -> Fields:
    """Compare results: a chart as JSON or none, and tables as HTML with their titles."""
    results = [Result.load(path) for path in paths]
    speak = language(code)
    drawn = charts(speak, comparison_figure(results, names))
    tables_beside = [
        (speak(title), fragment(speak, table)) for title, table in comparison_tables(results, names)
    ]
    return {"charts": fitting(drawn, MAX_CHART_BYTES)[0], "tables": tables_beside}


def history(
    path: Path, store: str, data: CertificateData, code: str, action: str = "", by: str = ""
) -> Fields:
    """Return what a store holds of a result's sensor: words, charts as JSON, tables as HTML.

    Args:
        path: of the result.
        store: URL.
        data: what the form of the certificate states beside the result.
        code: of the language.
        action: ``add`` adds the result before, ``approve`` approves its calibration, too.
        by: who approves, unless the certificate states it.
    """
    from vibrident.lab.history import page
    from vibrident.lab.history.document import of_result
    from vibrident.lab.history.store import Store

    result = with_statements(Result.load(path), data)
    speak = language(code)
    with Store(store) as opened:
        words = [_change(opened, result, speak, action, by)] if action else []
        life = of_result(opened, result)
    if life is None:
        words.append(speak("The history holds no calibration of this sensor."))
        return {"words": " ".join(words), "charts": [], "tables": ""}
    blocks = [block for section in page.report(life).sections for block in section.blocks]
    drawn = (block for block in blocks if isinstance(block, Figure))
    singular = "The history holds {count} calibration of this sensor."
    plural = "The history holds {count} calibrations of this sensor."
    words.append(speak.count(len(life["calibrations"]), singular, plural))
    return {
        "words": " ".join(words),
        "charts": fitting(charts(speak, *drawn), MAX_CHART_BYTES)[0],
        "tables": fragment(
            speak, *(shown_block for shown_block in blocks if not isinstance(shown_block, Figure))
        ),
    }


def _change(opened: Store, result: Result, speak: Language, action: str, by: str) -> str:
    """Add a result to a store, and approve it where asked for; return what was done."""
    from vibrident.lab.history.approval import approve
    from vibrident.lab.history.entry import add_all

    (added,) = add_all(opened, [result])
    done = "Calibration {number}." if added.new else "Calibration {number} was there already."
    if action == "approve":
        name = result.certificate.get("approved_by") or by
        approve(opened, added.number, by=name, note="" if name == by else f"entered by {by}")
        done = "Calibration {number} is approved."
    return speak(done, number=added.number)
