"""The HTML report of one result, and of several side by side: one self-contained file each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from vibrident.naming import parameter_name
from vibrident.plots.units import sensor_name
from vibrident.report import figures, figures_beside, page, tables, words
from vibrident.report.budget import budget
from vibrident.report.certificate import certificate
from vibrident.report.coverage import parameter_factor
from vibrident.report.history import drift_table, histories
from vibrident.report.light import light
from vibrident.report.numbers import COVERAGE_FACTOR, NONE, plain, stated
from vibrident.report.page import Page
from vibrident.report.residual_tests import residual_tests
from vibrident.report.side_by_side import comparison_tables
from vibrident.result import Result

#: Rows of the table of measured points in a page, where they are folded away.
MOST_ROWS = 800
#: Data files listed in a page; the result lists them all.
MOST_FILES = 100


def report_html(result: Result) -> str:
    """The report of one result.

    Raises:
        InputError: plotly is not installed.
    """
    name = sensor_name(result.sensor)
    made = Page(f"Calibration of {name}" if name else "Calibration")
    made.head = _verdict(result) + _cards(result)
    made.add("warnings", "Warnings", _warnings(result))
    made.add("parameters", "Parameters", page.table(tables.parameters(result)))
    if result.has_gain:  # free decays alone have neither gain nor curve
        made.add("sensitivity", "Sensitivity", *_sensitivity(made, result))
        made.add("deviation", "Deviation", *_deviation(made, result))
    made.add("signals", "Signals", _signals(made, result))
    made.add("residuals", "Residuals", *_residuals(made, result))
    made.add("budget", "Uncertainty budget", *_budget(result))
    made.add("interferometer", "Interferometer", page.table(light(result)))
    correlation = page.table(tables.correlation(result))
    made.add("correlation", "Correlation", correlation)
    made.add("training", "Training", *_training(made, result))
    if result.has_gain:
        made.add("certificate", "Certificate", *_certificate(result))
    others = {key: value for key, value in result.settings.items() if "budget" not in key and key != "interferometer"}
    made.add("settings", "Settings", page.tree(others) if others else "")
    made.add("provenance", "Provenance", *_provenance(result))
    return made.html()


def comparison_html(results: Sequence[Result], names: Sequence[str]) -> str:
    """Several results side by side, and the drift of each sensor that was calibrated more than once.

    Raises:
        InputError: plotly is not installed.
    """
    made = Page(f"Comparison of {len(results)} calibrations")
    for number, history in enumerate(histories(results, names), 1):
        caption = "Change from the first date; bars: U (k = 2). Calibrations agree where E_n, below, is within ±1."
        chart = made.figure(f"drift{number}", figures_beside.drift(history), caption)
        made.add(f"drift{number}", f"Drift of {history.sensor}", chart, page.table(drift_table(history)))
    caption = f"Sensitivity of each result's model, and its difference from {names[0]}."
    curves = made.figure("curves", figures_beside.beside(results, names), caption)
    for number, (title, table) in enumerate(comparison_tables(results, names), 1):
        body = page.table(table)
        made.add(f"table{number}", title, body if number < 3 else page.folded("Show the table", body))
        if number == 1:
            made.add("curves", "Sensitivity", curves)
    return made.html()


def _verdict(result: Result) -> str:
    fine = result.fit.adequate and not result.warnings
    verdict = "The model is adequate for these data" if result.fit.adequate else "The model does not describe the data"
    doubts = f"{tables.count(len(result.warnings), 'warning')}, explained below" if result.warnings else "no warnings"
    rows = page.pairs(tables.facts(result))
    return f'<p class="verdict{"" if fine else " doubt"}"><b>{verdict}</b>; {doubts}.</p>\n{rows}'


def _cards(result: Result) -> str:
    """The numbers that most readers look for: at the reference frequency, and the estimated parameters."""
    found = []
    content = certificate(result).reference
    if len(content) > 1 and content[0].text:
        frequency = content[0].text.split(";")[0]
        found += [(f"{field.label} at {frequency}", field.text or NONE) for field in content[1:]]
    k = parameter_factor(result)
    for name, parameter in result.parameters.items():
        if not parameter.derived:
            number = stated(parameter, k)
            value = f"{number.value} {number.unit}".strip()
            bar = "" if number.expanded == NONE else f", U = {number.expanded} {number.unit}".rstrip()
            found.append((parameter_name(name).words, f"{value}{bar}{f' (k = {plain(k, 3)})' if bar else ''}"))
    cards = []
    for label, content_text in found:
        value, _, rest = content_text.partition(", U = ")
        below = f"U = {rest}" if rest else "U not known"
        cards.append(
            f'<div class="card"><span>{page.text(label[:1].upper() + label[1:])}</span><b>{page.text(value)}</b>'
            f"<span>{page.text(below)}</span></div>"
        )
    return f'<div class="cards">{"".join(cards)}</div>' if cards else ""


def _warnings(result: Result) -> str:
    if not result.warnings:
        return "<p>None.</p>"
    parts = []
    for code in result.warning_codes:
        explained = words.explain(code)
        title = explained.title[:1].upper() + explained.title[1:]
        messages = [warning.message for warning in result.warnings if warning.code == code]
        parts.append(
            f'<div class="warning"><h3>{page.text(title)} <code>({page.text(code)})</code></h3>'
            f"{page.paragraphs(messages)}{page.paragraphs([explained.meaning])}"
            f"<p><b>What to do:</b> {page.text(explained.action).replace('`', '')}</p></div>"
        )
    return "\n".join(parts)


def _thinned(result: Result) -> str:
    shown, total = len(figures.thinned(result)), len(result.measured.frequency_hz)
    return f" {shown} of {total} measured points are drawn." if shown < total else ""


def _sensitivity(made: Page, result: Result) -> list[str]:
    caption = "Model with its band U (k = 2), and the measured points with bars U (k = 2)." + _thinned(result)
    has_phase = any(phase is not None for phase in (*result.response.phase_deg, *result.measured.phase_deg))
    caption += f" {words.PHASE}" if has_phase else ""
    nominal = certificate(result).sensitivity
    return [
        made.figure("sensitivity", figures.sensitivity(result), caption),
        page.folded("Table at nominal frequencies", page.table(nominal)),
    ]


def _deviation(made: Page, result: Result) -> list[str]:
    caption = (
        "Model − measured, of the magnitude relative to the measured one; bars: U of the deviation, band: U of the "
        f"model, both k = {COVERAGE_FACTOR:g}."
    )
    return [
        made.figure("deviation", figures.deviation(result), caption + _thinned(result)),
        page.folded("Table of measured points", page.table(tables.measured(result, MOST_ROWS))),
    ]


def _signals(made: Page, result: Result) -> str:
    found = figures.signals(result)
    caption = "Measured and predicted response of a part of the record, and the residual on a scale of its own."
    if len(found) < len(result.signals):
        caption += f" {len(found)} of {len(result.signals)} records can be chosen."
    return made.figure("signals", [chart for _, chart in found], caption, [name for name, _ in found])


def _residuals(made: Page, result: Result) -> list[str]:
    caption = (
        "Distribution of the residuals beside the normal one; values beyond the ends are counted in the last bars."
    )
    return [
        page.table(residual_tests(result)),
        made.figure("residuals", figures.residuals(result), caption),
        "<h3>Fit</h3>",
        page.table(tables.fit(result)),
    ]


def _budget(result: Result) -> list[str]:
    """What each source adds; a budget of another form as it stands."""
    if (table := budget(result)) is not None:
        return [page.table(table)]
    return [page.tree(value) for key, value in result.settings.items() if "budget" in key and value]


def _training(made: Page, result: Result) -> list[str]:
    sentence = tables.training(result)
    return [
        page.paragraphs([sentence]) if sentence else "",
        made.figure("training", figures.training(result), "Loss by iteration."),
        page.folded("Weights of the network (paper's Table 1)", page.table(tables.weights(result))),
    ]


def _provenance(result: Result) -> list[str]:
    """Versions and times, and the files in a table of their own."""
    files = [entry for entry in result.provenance.get("files") or () if isinstance(entry, Mapping)]
    others = {key: value for key, value in result.provenance.items() if key != "files"}
    more = [f"and {len(files) - MOST_FILES} more, listed in result.json"] if len(files) > MOST_FILES else []
    rows = tuple(
        (
            str(e.get("file") or NONE),
            str(e.get("sha256") or NONE),
            "; ".join(str(step) for step in e.get("history") or ()),
        )
        for e in files[:MOST_FILES]
    )
    table = tables.Table(("data file", "SHA-256", "history"), rows, notes=tuple(more))
    listing = page.folded(f"Data files ({len(files)})", page.table(table)) if files else ""
    return [page.tree(others) if others else "", listing]


def _certificate(result: Result) -> list[str]:
    """What the certificate says besides the numbers; blanks are left as blanks."""
    if not result.certificate:
        return []
    content = certificate(result)
    rows: list[tuple[str, str | None]] = [
        ("Number", content.number),
        ("Laboratory", ", ".join(content.laboratory) or None),
    ]
    rows += [(field.label, field.text) for _, group in content.groups for field in group]
    rows += [("Traceability", content.traceability), *((field.label, field.text) for field in content.signatures)]
    rows += [("Remark", remark) for remark in content.remarks]
    instruments = page.table(content.instruments) if content.instruments.rows else ""
    return [page.pairs(rows), "<h3>Instruments</h3>" if instruments else "", instruments]
