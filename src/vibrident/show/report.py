"""Write reports of a result from its values alone; heavy libraries load where needed.

``write`` makes any of them: Markdown with pictures, one self-contained HTML file (plotly), a
calibration certificate as PDF (typst); and of several results a comparison, with the drift of a
sensor that was calibrated more than once.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, get_args

from vibrident.base.errors import InputError, unknown
from vibrident.result import Result
from vibrident.result.loading import GivenResult
from vibrident.show import document, plots
from vibrident.show.certificate import certificate
from vibrident.show.certified import raised_to_measured
from vibrident.show.coverage import document_kind
from vibrident.show.issue import NOTHING_MORE, GivenCertificate, Issue, issued
from vibrident.show.media import markdown
from vibrident.show.views import Section

__all__ = [
    "FILE_NAMES",
    "Form",
    "content",
    "file_name",
    "name_of_sensor",
    "render",
    "report",
    "write",
]

Form = Literal["html", "pdf", "md"]
#: File name of each form: of one result, and of several side by side.
FILE_NAMES: dict[str, tuple[str, str]] = {
    "html": ("report.html", "comparison.html"),
    "pdf": ("certificate.pdf", "comparison.pdf"),
    "md": ("report.md", "comparison.md"),
}


def report(
    results: GivenResult | Sequence[GivenResult],
    path: str | os.PathLike[str],
    *,
    form: Form | None = None,
    certificate: GivenCertificate = (),
    names: Sequence[str] = (),
) -> Path:
    """Write a report of one result, or a comparison of several.

    Args:
        results: a result or several, or paths of their ``result.json``.
        path: the file; or a folder, made if missing, for a file of the usual name.
        form: ``html`` (interactive, one file), ``pdf`` (certificate, measurement report or
            comparison) or ``md`` (one result with pictures); None: by the ending of the path.
        certificate: what the certificate states, given after the fit: a certificate file (TOML) or
            several, or the entries of [certificate] by key. What ISO/IEC 17025 asks for and is
            missing makes it a draft (:func:`vibrident.check_certificate`).
        names: what to call each of several results; none: 1, 2, ….

    Returns:
        The path of the file.

    Raises:
        InputError: the form is not known or what it needs is not installed, a file cannot be read,
            or a certificate of several results is asked for.

    Examples:
        >>> import vibrident
        >>> hz = [100, 300, 650, 1000]
        >>> calibration = vibrident.simulate(frequencies_hz=hz, samples=2000, response_noise=1e-3)
        >>> result = vibrident.identify(calibration)
        >>> vibrident.report(result, "report.html").name
        'report.html'
    """
    sources = [results] if isinstance(results, Result | str | os.PathLike) else list(results)
    pairs = [issued(result, certificate) for result in sources]
    results_given = [result for result, _ in pairs]
    if not results_given:
        raise InputError(
            "There is nothing to report.",
            expected="a result, or several",
            found="none",
            where="report",
            remedy="give a result",
        )
    return write(results_given, form or _form_of(path), path, names, issue=pairs[0][1])


def _form_of(path: str | os.PathLike[str]) -> Form:
    """Return the form that the ending of a path says."""
    ending = Path(path).suffix.lower().removeprefix(".")
    for form in get_args(Form):
        if ending == form:
            return form
    raise InputError(
        "The path does not say the form of the report.",
        expected="a name that ends in .html, .pdf or .md, or form=…",
        found=os.fspath(path),
        where="report",
        remedy="give one of the two",
    )


def file_name(result: Result, form: Form) -> str:
    """Return the default file name of the report of one result."""
    names = {"report": "measurement-report.pdf", "tracking": "tracking-report.pdf"}
    usual = FILE_NAMES[form][0]
    return names.get(document_kind(result), usual) if form == "pdf" else usual


def name_of_sensor(name: str, sensor: Mapping[str, Any], certificate: Mapping[str, Any]) -> str:
    """Return the name of a file with serial number and date of calibration, where stated.

    ``certificate.pdf`` becomes ``certificate-4711-2026-03-01.pdf``; what file systems forbid is a
    dash.
    """
    stem, dot, ending = name.rpartition(".")
    words = (sensor.get("serial_number"), certificate.get("date_of_calibration"))
    parts_of_name = [re.sub(r"[^\w.]+", "-", str(word)).strip("-.") for word in words if word]
    return "-".join([stem, *filter(None, parts_of_name)]) + dot + ending


def content(
    results: Result | Sequence[Result],
    form: Form,
    names: Sequence[str] = (),
    more: Sequence[Section] = (),
    issue: Issue = NOTHING_MORE,
) -> bytes:
    """Return the report as bytes: Markdown without pictures; results are called 1, 2, … by default.

    Raises:
        InputError: the form is not known, or what it needs is not installed (``pip install
            'vibrident[report]'``).
    """
    if form not in get_args(Form):
        raise unknown(
            f"Reports in the form {form!r} do not exist.",
            form,
            get_args(Form),
            "form of the report",
        )
    alone = [results] if isinstance(results, Result) else list(results)
    called = list(names) or [str(number) for number in range(1, len(alone) + 1)]
    single = alone[0] if len(alone) == 1 else None
    if form == "pdf":
        from vibrident.show.media import pdf

        for result in alone:
            result.require_gain("a certificate")
        view = certificate(single, issue) if single else document.comparison(alone, called)
        return pdf.render(view, issue.template if single else None, issue.fonts)
    view = document.report(single, more) if single else document.comparison(alone, called)
    if form == "html":
        from vibrident.show.media import html

        return html.render(view).encode()
    return markdown.render(view).encode()


def render(
    result: Result,
    pictures: str | os.PathLike[str] | None = None,
    relative_to: str | os.PathLike[str] | None = None,
    more: Sequence[Section] = (),
) -> str:
    """Write the report as Markdown text (GitHub tables).

    Args:
        result: any result.
        pictures: folder in which ``plots.save_all`` has drawn; the pictures found there are linked.
        relative_to: folder in which the report will lie, for the links; by default the folder of
            pictures.
        more: sections that it has as well.

    Returns:
        the text, ending in a line end.
    """
    if pictures is None:
        return markdown.render(document.report(result, more))
    links = markdown.links(
        plots.PICTURES, pictures, pictures if relative_to is None else relative_to
    )
    return markdown.render(document.report(result, more), links)


def write(
    results: Result | Sequence[Result],
    form: Form,
    path: str | os.PathLike[str],
    names: Sequence[str] = (),
    more: Sequence[Section] = (),
    issue: Issue = NOTHING_MORE,
) -> Path:
    """Write a report.

    Args:
        results: one result, or several to be set side by side.
        form: ``html`` (interactive, one file), ``pdf`` (certificate, comparison) or ``md`` (one
            result with pictures).
        path: the file, where it has the ending of the form; else a folder, made if missing, for a
            file of the usual name.
        names: what to call each of several.
        more: sections that the report of one result has as well, such as its sensor's history.
        issue: of a certificate, from ``vibrident.show.issue.issued``.

    Returns:
        path of the file.

    Raises:
        InputError: the form is not known, or what it needs is not installed.
    """
    single = results if isinstance(results, Result) else results[0] if len(results) == 1 else None
    target = Path(path)
    if target.suffix.lower() != f".{form}" and form in FILE_NAMES:
        target = target / (file_name(single, form) if single else FILE_NAMES[form][1])
    if form == "md" and single is not None:
        target.parent.mkdir(parents=True, exist_ok=True)
        plots.save_all(raised_to_measured(single), target.parent)
        content_bytes = render(single, pictures=target.parent, more=more).encode()
    else:
        content_bytes = content(results, form, names, more, issue)
        target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(content_bytes)
    return target
