"""``vibrident report``: a report, a certificate or a comparison from results alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from vibrident.app.cli import options
from vibrident.app.cli.console import distinct_names, note, show_written
from vibrident.app.cli.options import choice, option
from vibrident.app.workflow.folder import load_result, written_whole
from vibrident.base.errors import InputError

if TYPE_CHECKING:
    from vibrident.result import Result
    from vibrident.show.views import Section


def report(
    results: list[Path] = options.RESULT_FILES,
    folder: Path | None = option(
        "--out",
        "DIR",
        "Folder for the report. Several results: a subfolder each, and a comparison.",
        default="beside each result",
    ),
    form: str = choice(
        "--format",
        options.FORMATS,
        "html: interactive, one file; pdf: calibration certificate or measurement report; md: "
        "Markdown with pictures.",
        "md",
    ),
    certificate: list[Path] | None = options.CERTIFICATE_FILES,
    store: str | None = option(
        "--store", "URL", "Add what this history holds of the sensor; not in a certificate."
    ),
) -> None:
    """Write a report; of several results also a comparison, with the drift of a sensor. It \
needs results alone."""
    _refuse_file_name(folder)
    from vibrident.show.issue import check_numbers, issued

    issues = [issued(load_result(path), certificate or []) for path in results]
    _note_serial_numbers(results, [result for result, _ in issues])
    everything = [result for result, _ in issues]
    is_single = len(issues) == 1
    more = _histories(results, everything, store, form)
    names = distinct_names(results)
    if form == "pdf":
        check_numbers(everything, [str(path) for path in results])
    # By folder: the results of one report, its place in the folder, and its further sections.
    jobs: dict[Path, list[tuple[list[Result], str, Sequence[Section]]]] = {}
    for path, result, name, sections in zip(results, everything, names, more, strict=True):
        subfolder = "" if folder is None or is_single else name
        jobs.setdefault(folder or path.parent, []).append(([result], subfolder, sections))
    if not is_single:
        jobs.setdefault(folder or Path("vibrident-comparison"), []).append((everything, "", ()))
    from vibrident.show.report import write

    written: list[Path] = []
    for target, documents in jobs.items():
        with written_whole(target) as output:
            for document, subfolder, sections in documents:
                target_file = output.path / subfolder
                issue = issues[0][1]
                write(document, form, target_file, names, sections, issue)  # type: ignore[arg-type]
        written += output.files
    show_written([file for file in written if file.suffix == f".{form}"])


def _note_serial_numbers(paths: list[Path], stated: list[Result]) -> None:
    """Say where a certificate file states another serial number than the calibration did."""
    for path, result in zip(paths, stated, strict=True):
        identified = load_result(path).sensor.get("serial_number")
        certified = result.sensor.get("serial_number")
        if identified not in (None, "", certified):
            note(
                f"Note: the certificate is of serial number {certified}, as its file states; "
                f"{path} is of {identified}."
            )


def _refuse_file_name(folder: Path | None) -> None:
    """Raise InputError where a report's file is named in place of its folder."""
    ending = "" if folder is None else folder.suffix.lower().removeprefix(".")
    if folder is not None and ending in options.FORMATS and not folder.is_dir():
        raise InputError(
            "The name of a folder is expected.",
            expected="a folder, and the form of the report by --format",
            found=folder.name,
            where="--out",
            remedy=f"give --out {folder.parent} --format {ending}",
        )


def _histories(
    paths: list[Path], results: list[Result], store: str | None, form: str
) -> Sequence[Sequence[Section]]:
    """Return what a store holds of the sensor of each result, as sections; empty without one."""
    if store is None:
        return [()] * len(results)
    if form == "pdf":
        raise InputError(
            "A certificate states one calibration, and no history.",
            expected="html or md",
            found="pdf",
            where="--format, --store",
            remedy="leave --store out, or choose another form",
        )
    from vibrident.lab.history import page
    from vibrident.lab.history.document import of_result
    from vibrident.lab.history.store import Store

    with Store(store) as opened:
        with opened.reading():  # a misspelt store is no empty one
            pass
        lives = [of_result(opened, result) for result in results]
    for path, life in zip(paths, lives, strict=True):
        if life is None:
            note(f"{path}: the history holds no calibration of this sensor")
    return [() if life is None else page.sections(life) for life in lives]
