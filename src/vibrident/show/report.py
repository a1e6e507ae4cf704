"""Write reports from results alone; heavy libraries load where they are needed.

Of one result: Markdown with pictures, one self-contained HTML file (plotly), or a calibration
certificate as PDF (typst). Of several: a comparison, with the drift of each recalibrated sensor.
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
    if not sources:
        raise InputError(
            "There is nothing to report.",
            expected="a result, or several",
            found="none",
            where="report",
            remedy="give a result",
        )
    pairs = [issued(source, certificate) for source in sources]
    stated_results = [result for result, _ in pairs]
    return write(stated_results, form or _form_of(path), path, names, issue=pairs[0][1])


def _form_of(path: str | os.PathLike[str]) -> Form:
    """Return the form of a report by the suffix of its path."""
    suffix = Path(path).suffix.lower().removeprefix(".")
    for form in get_args(Form):
        if suffix == form:
            return form
    raise InputError(
        "The path does not say the form of the report.",
        expected="a name that ends in .html, .pdf or .md, or form=…",
        found=os.fspath(path),
        where="report",
        remedy="end the name in .html, .pdf or .md, or pass form='html', 'pdf' or 'md'",
    )


def file_name(result: Result, form: Form) -> str:
    """Return the default file name of the report of one result."""
    pdf_names = {"report": "measurement-report.pdf", "tracking": "tracking-report.pdf"}
    usual_name, _ = FILE_NAMES[form]
    return pdf_names.get(document_kind(result), usual_name) if form == "pdf" else usual_name


def name_of_sensor(name: str, sensor: Mapping[str, Any], certificate: Mapping[str, Any]) -> str:
    """Add serial number and date of calibration to the name of a file, where they are stated.

    ``certificate.pdf`` becomes ``certificate-4711-2026-03-01.pdf``. A dash replaces characters
    that a file system may forbid.
    """
    stem, dot, suffix = name.rpartition(".")
    entries = (sensor.get("serial_number"), certificate.get("date_of_calibration"))
    suffixes = (re.sub(r"[^\w.]+", "-", str(entry)).strip("-.") for entry in entries if entry)
    return "-".join([stem, *filter(None, suffixes)]) + dot + suffix


def content(
    results: Result | Sequence[Result],
    form: Form,
    names: Sequence[str] = (),
    extra_sections: Sequence[Section] = (),
    issue: Issue = NOTHING_MORE,
) -> bytes:
    """Return a report as bytes; Markdown without pictures.

    Args:
        results: one result, or several to be compared.
        form: of the report.
        names: of several results; 1, 2, … by default.
        extra_sections: that the report of one result has as well.
        issue: what belongs to a certificate alone.

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
    reported = [results] if isinstance(results, Result) else list(results)
    names = names or [str(number) for number in range(1, len(reported) + 1)]
    single = reported[0] if len(reported) == 1 else None
    if form == "pdf":
        from vibrident.show.media import pdf

        for result in reported:
            result.require_gain("a certificate")
        if single is None:
            return pdf.render(document.comparison(reported, names), None, issue.fonts)
        return pdf.render(certificate(single, issue), issue.template, issue.fonts)
    view = (
        document.comparison(reported, names)
        if single is None
        else document.report(single, extra_sections)
    )
    if form == "html":
        from vibrident.show.media import html

        return html.render(view).encode()
    return markdown.render(view).encode()


def render(
    result: Result,
    pictures: str | os.PathLike[str] | None = None,
    extra_sections: Sequence[Section] = (),
) -> str:
    """Render the report of one result as Markdown text (GitHub tables).

    Args:
        result: any result.
        pictures: folder of the report, in which ``plots.save_all`` has drawn; the pictures there
            are linked.
        extra_sections: that the report has as well.
    """
    links = None if pictures is None else markdown.links(plots.PICTURES, pictures)
    return markdown.render(document.report(result, extra_sections), links)


def write(
    results: Result | Sequence[Result],
    form: Form,
    path: str | os.PathLike[str],
    names: Sequence[str] = (),
    extra_sections: Sequence[Section] = (),
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
        extra_sections: that the report of one result has as well, such as its sensor's history.
        issue: what belongs to a certificate alone, from ``vibrident.show.issue.issued``.

    Returns:
        The path of the file.

    Raises:
        InputError: the form is not known, or what it needs is not installed.
    """
    reported = [results] if isinstance(results, Result) else results
    single = reported[0] if len(reported) == 1 else None
    target = Path(path)
    if target.suffix.lower() != f".{form}" and form in FILE_NAMES:
        target = target / (file_name(single, form) if single else FILE_NAMES[form][1])
    if form == "md" and single is not None:
        target.parent.mkdir(parents=True, exist_ok=True)
        plots.save_all(raised_to_measured(single), target.parent)
        report_bytes = render(single, target.parent, extra_sections).encode()
    else:
        report_bytes = content(reported, form, names, extra_sections, issue)
        target.parent.mkdir(parents=True, exist_ok=True)
    target.write_bytes(report_bytes)
    return target
