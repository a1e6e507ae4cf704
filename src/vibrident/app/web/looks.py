"""Access to uploaded files. Each function runs in a separate process (``vibrident.base.sandbox``).

The server never opens such a file; it receives text, figures as JSON, and bytes of bounded size.
"""

from __future__ import annotations

import io
import json
import os
import time
import zipfile
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibrident.app.web.form.description import ROLES, Description, described, mark, paired
from vibrident.app.web.language import Language, language, phrase
from vibrident.app.web.preview import preview
from vibrident.app.web.session import refuse_outside
from vibrident.app.web.translated import charts, fragment
from vibrident.app.web.words import page_word
from vibrident.base.errors import InputError, VibridentError
from vibrident.data.io import read
from vibrident.data.io.certificate import CertificateData, certificate_text
from vibrident.data.io.columns import require_room
from vibrident.data.io.guess import Columns, guess_columns
from vibrident.data.io.reader import open_columns
from vibrident.fit.response.motion import kind_of_motion
from vibrident.result import Result
from vibrident.show import certificate, document, figures, tables
from vibrident.show.certified import raised_to_measured, said_of_raised
from vibrident.show.comparison import beside, comparison_tables
from vibrident.show.coverage import chain_unstated, unstated
from vibrident.show.deviation_points import from_reference
from vibrident.show.findings import told
from vibrident.show.issue import Issue, issued
from vibrident.show.issue import stated as with_statements
from vibrident.show.report import content, file_name
from vibrident.show.views import Figure, Sentence

if TYPE_CHECKING:
    from vibrident.lab.history.store import Store

_MOST_EXAMINED = 5  # most files whose motion is examined, spread over all of them
MOST_COLUMNS = 60  # most columns offered in lists; otherwise names are typed
MOST_TEXT = 20_000  # most characters of a calibration file shown
MOST_BYTES = 4_000_000  # most bytes of charts sent to the browser at once
_LONGEST_LABEL = 200
_MOST_SECONDS = 40.0  # seconds after which no further file is examined


@dataclass(frozen=True)
class Guess:
    """The possible meaning of the columns."""

    columns: Columns  # by their names; at most what can be shown
    excitation: str | None  # by the file's name or the motion; None if undetermined
    all_columns: int  # number of the file's columns
    chart: bytes  # the guessed columns, as ``chart`` draws them; empty if that fails
    optical_part: str = ""  # what names of files with optical signals have beyond the others'; empty if there are none


def prepare() -> None:
    """What a process does while it waits for one of these functions: this module loads the libraries."""


def guess(folder: Path, files: Sequence[str], code: str = "en") -> Guess:
    """Guess the columns from the first file, and the excitation from several."""
    part = mark(files)
    columns, apart = _columns(folder, paired(files, part))
    part = part if apart else ""
    try:
        excitation = likely_excitation(columns, folder, [file for file, _ in paired(files, part)])
    except MemoryError:  # the files may be too large for a guess
        excitation = None
    try:
        drawn = chart(described(columns, excitation or "sine", part), folder, files, code)
    except (VibridentError, MemoryError):  # reported when the page requests the chart
        drawn = b""
    return Guess(_few(columns), excitation, len(columns.columns), drawn, part)


def _columns(folder: Path, pairs: Sequence[tuple[str, str | None]]) -> tuple[Columns, bool]:
    """The columns of the first file, with those of its optical signals; whether these are in another file."""
    first, other = pairs[0]
    columns = guess_columns(folder / first)
    light = columns if other is None else guess_columns(folder / other)
    signals = light.document["interferometer"]
    if light is columns or columns.document["interferometer"] or not signals:
        return columns, False
    more = [pair for pair in zip(light.columns, light.labels, strict=True) if pair[0] not in columns.columns]
    names, labels = (tuple(part) for part in zip(*more, strict=True)) if more else ((), ())
    both = {"columns": (*columns.columns, *names), "labels": (*columns.labels, *labels)}
    return replace(columns, **both, document={**columns.document, "interferometer": signals}), True


def likely_excitation(columns: Columns, folder: Path, files: Sequence[str]) -> str:
    """The excitation of most files; a sine if undetermined."""
    known = columns.document["records"].get("excitation")
    # raw light turns round at any motion
    motion_in = columns.document["response" if columns.document["interferometer"] else "reference"].get("column")
    if known is not None or columns.is_table or motion_in is None:
        return known or "sine"
    seen: Counter[str] = Counter()
    for file in files[:: -(-len(files) // _MOST_EXAMINED)]:
        try:
            source = open_columns(folder / file)
            (motion,) = source.load([source.position_of(motion_in, "columns and units")])
        except VibridentError:  # reported when the columns are drawn or confirmed
            continue
        seen[kind_of_motion(motion)] += 1
    return seen.most_common(1)[0][0] if seen else "sine"


def _few(columns: Columns) -> Columns:
    """The columns to offer: the first ones and the guessed ones."""
    given = described(columns)
    guessed = [given.get(role) for role in ROLES]
    pairs = list(zip(columns.columns, columns.labels, strict=True))
    kept = [pair for i, pair in enumerate(pairs) if i < MOST_COLUMNS or pair[0] in guessed]
    names, labels = zip(*kept, strict=True)
    return replace(columns, columns=names, labels=tuple(label[:_LONGEST_LABEL] for label in labels))


def calibration(folder: Path, name: str) -> str:
    """The text of a calibration file that names no other files than those uploaded; of a long one the beginning."""
    refuse_outside(folder / name)
    text = (folder / name).read_text(encoding="utf-8-sig")
    left = len(text) - MOST_TEXT
    return text if left <= 0 else f"{text[:MOST_TEXT]}\n# … and {left} characters more"


def chart(given: Description, folder: Path, files: Sequence[str], code: str = "en") -> bytes:
    """The beginning of the chosen columns, as JSON of a figure; ``code``: of its language."""
    return _json(preview(given, folder, files, language(code)))


def faults(given: Description, folder: Path, files: Sequence[str]) -> list[dict[str, str]]:
    """What an identification would refuse in the chosen columns of any file: the fields of the message, one a file."""
    found, until = [], time.monotonic() + _MOST_SECONDS
    points = [given.get(role) for role in ROLES if role.startswith("table.")]
    response = (given.get("sampling.time_column"), given.get("response.column"))
    for file, other in given.pairs(files):
        here = points if given.table else response if other else (*response, *given.motion)
        for name, columns in ((file, here), (other, given.motion)):
            try:
                if name is not None:
                    _require_numbers(folder / name, [column for column in columns if column is not None])
            except InputError as error:
                found.append(dict(vars(error)))
        if time.monotonic() > until:
            break
    return found


def _require_numbers(path: Path, columns: Sequence[int | str]) -> None:
    source = open_columns(path)
    places = [source.position_of(column, "columns and units") for column in columns]
    require_room(path, sum(source.length(place) for place in places))
    for place, values in zip(places, source.load(places), strict=True):
        source.require_finite(place, values, 0, "repair the file, or remove it")


def readable(folder: Path, name: str) -> None:
    """Read all that a calibration file names, to see whether it can be read."""
    read(folder / name)


def facts(path: Path) -> tuple[str, str]:
    """Model and estimator of a result."""
    result = Result.load(path)
    return result.model, result.estimator


def outcome(path: Path, code: str = "en") -> dict[str, Any]:
    """The view of a result in a language: verdict, numbers, warnings and findings as HTML, charts as JSON."""
    speak = language(code)
    fitted = Result.load(path)  # warnings and findings count in its own u, as their sentences do
    result = raised_to_measured(fitted)
    drawn = figures.sensitivity(result), from_reference(result), figures.deviation(result)
    shown, left = _fitting(_named(speak, *drawn), MOST_BYTES)
    found, left = _fitting(_named(speak, figures.training(result)), left)
    signals, left = _fitting(_charts(speak, figures.signals(result)), left)
    return {
        "verdict": fragment(speak, document.verdict(result), *_scatter_only(result, speak)),
        "pdf": (certificate.title(result), file_name(result, "pdf")),
        "states": {"certificate": result.certificate, "sensor": result.sensor, "parameters": [*result.parameters]},
        "parameters": fragment(speak, tables.parameters(result), *map(Sentence, said_of_raised(result))),
        "warnings": fragment(speak, *told(fitted, page_word(speak=speak))),
        "charts": shown,
        "found": found,
        "signals": signals,
        "left_out": left < 0,
    }


#: Sources by what they make known, in the words of the page.
_SOURCES = {
    ("gain",): phrase("To include it, add a source of kind gain under “{step}”, and identify again."),
    ("phase",): phrase("To include it, add a source of kind phase or timing under “{step}”, and identify again."),
    ("gain", "phase"): phrase(
        "To include it, add sources of kind gain and kind phase (or timing) under “{step}”, and identify again."
    ),
}


def _scatter_only(result: Result, speak: Language) -> tuple[Sentence, ...]:
    """Return that U covers scatter only, with what to state on the page; nothing where it is more."""
    lacking = unstated(result)
    if not lacking:
        return ()
    more = speak(_SOURCES[lacking], step=speak("Laboratory and uncertainty"))
    return tuple(replace(one, text=f"{speak(one.text)} {more}") for one in chain_unstated(result))


def _named(speak: Language, *drawn: Figure | None) -> list[tuple[str, Any]]:
    known = [figure for figure in drawn if figure is not None]
    return [(speak(figure.title), chart) for figure in known for _, chart in _charts(speak, figure)]


def _charts(speak: Language, figure: Figure | None) -> list[tuple[str, Any]]:
    return [] if figure is None else charts(speak, figure)


def _fitting(drawn: Sequence[tuple[str, Any]], most: int) -> tuple[list[tuple[str, bytes, int]], int]:
    """Charts that fit the limit, and the bytes left; negative if one did not fit.

    Each is its title, its JSON and its height in pixels.
    """
    found = []
    for title, figure in drawn:
        text = _json(figure)
        most -= len(text)
        if most < 0:
            break
        found.append((title, text, figure["layout"]["height"]))
    return found, most


def _issued(path: Path, stated: CertificateData) -> tuple[Result, Issue]:
    """A result with what is stated for its certificate, in the process of this task."""
    os.environ["HTTPS_PROXY"] = "http://127.0.0.1:9"  # nobody's: an uploaded template has typst fetch no packages
    return issued(Result.load(path), stated)


def report(paths: Sequence[Path], form: Any, names: Sequence[str], stated: CertificateData) -> bytes:
    """The file of a report of one result, with what is stated for its certificate, or of several."""
    if len(paths) > 1:
        return content([Result.load(path) for path in paths], form, names)
    result, issue = _issued(paths[0], stated)
    return content(result, form, issue=issue)


def exported(
    path: Path, folder: Path, form: str, options: dict[str, Any], stated: CertificateData
) -> tuple[bytes, str]:
    """One file as it is, several as an archive; with its name. The caller removes the folder."""
    from vibrident.export import export

    files = export(issued(Result.load(path), stated)[0], form, folder, **options)
    if len(files) == 1:
        return files[0].read_bytes(), files[0].name
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
        for file in files:
            packed.write(file, file.relative_to(folder))
    return archive.getvalue(), f"{form}.zip"


def everything(path: Path, calibration: Path | None, folder: Path, stated: CertificateData) -> bytes:
    """One archive: the result, calibration and certificate file, the reports, and each export that asks for nothing."""
    from vibrident.export import export
    from vibrident.export.registry import EXPORTS

    result, issue = _issued(path, stated)
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.write(path, "result.json")
        if calibration is not None:
            packed.write(calibration, "calibration.toml")
        if stated.certificate or stated.sensor:
            packed.writestr("certificate.toml", certificate_text(stated))
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


def comparison(paths: Sequence[Path], names: Sequence[str], code: str = "en") -> dict[str, Any]:
    """Results side by side: a chart as JSON or none, and tables as HTML with their titles."""
    results = [Result.load(path) for path in paths]
    speak = language(code)
    shown, _ = _fitting(_charts(speak, beside(results, names)), MOST_BYTES)
    tables_beside = [(speak(title), fragment(speak, table)) for title, table in comparison_tables(results, names)]
    return {"charts": shown, "tables": tables_beside}


def history(path: Path, store: str, stated: CertificateData, code: str) -> dict[str, Any]:
    """Return what a store holds of the sensor of a result: words, charts as JSON, and tables as HTML.

    ``stated``: what the form of the certificate states beside the result; ``code``: of the language.
    """
    return _history(path, store, stated, code, lambda opened, result: "")


def added_to_history(path: Path, store: str, stated: CertificateData, code: str) -> dict[str, Any]:
    """Return the same, once the result was added."""
    from vibrident.lab.history.entry import add_all

    def add(opened: Store, result: Result) -> str:
        (added,) = add_all(opened, [result])
        new = phrase("Calibration {number}.")
        known = phrase("Calibration {number} was there already.")
        return language(code)(new if added.new else known, number=added.number)

    return _history(path, store, stated, code, add)


def approved(path: Path, store: str, stated: CertificateData, code: str, by: str) -> dict[str, Any]:
    """Return the same, once the result's calibration was added and approved."""
    from vibrident.lab.history.approval import approve
    from vibrident.lab.history.entry import add_all

    def add(opened: Store, result: Result) -> str:
        (added,) = add_all(opened, [result])
        name = result.certificate.get("approved_by") or by
        approve(opened, added.number, by=name, note="" if name == by else f"entered by {by}")
        return language(code)(phrase("Calibration {number} is approved."), number=added.number)

    return _history(path, store, stated, code, add)


def _history(
    path: Path, store: str, stated: CertificateData, code: str, change: Callable[[Store, Result], str]
) -> dict[str, Any]:
    from vibrident.lab.history import page
    from vibrident.lab.history.document import of_result
    from vibrident.lab.history.store import Store

    result, speak = with_statements(Result.load(path), stated), language(code)
    with Store(store) as opened:
        before = change(opened, result)
        life = of_result(opened, result)
    if life is None:
        nothing = speak("The history holds no calibration of this sensor.")
        return {"words": f"{before} {nothing}".strip(), "charts": [], "tables": ""}
    blocks = [block for part in page.report(life).sections for block in part.blocks]
    drawn = [(one.title, chart) for one in blocks if isinstance(one, Figure) for _, chart in _charts(speak, one)]
    rest = fragment(speak, *(block for block in blocks if not isinstance(block, Figure)))
    one = "The history holds {count} calibration of this sensor."
    several = "The history holds {count} calibrations of this sensor."
    words = speak.count(len(life["calibrations"]), one, several)
    return {"words": f"{before} {words}".strip(), "charts": _fitting(drawn, MOST_BYTES)[0], "tables": rest}


def _json(tree: Any) -> bytes:
    try:
        return json.dumps(tree, separators=(",", ":"), allow_nan=False).encode()
    except ValueError as error:
        raise VibridentError("NaN or infinity cannot be drawn.") from error
