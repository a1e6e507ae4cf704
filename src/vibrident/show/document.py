"""The report of one result, and of several beside each other, as documents with their sections."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from vibrident.physics.naming import parameter_name
from vibrident.result import Result
from vibrident.show import (
    certificate,
    certificate_decisions,
    certificate_tables,
    deviation_points,
    figures,
    tables,
    weight_tables,
)
from vibrident.show.certified import RAISED, describe_raised, raised_to_measured
from vibrident.show.comparison import comparison_tables
from vibrident.show.comparison_curves import comparison_figure
from vibrident.show.coverage import parameter_factor, scatter_only
from vibrident.show.findings import findings
from vibrident.show.history import drift, drift_table, histories
from vibrident.show.numbers import NONE, parameter_scale, plain, rounded_parameter, sensor_name
from vibrident.show.residual_tests import residual_tests
from vibrident.show.setting_tables import budget, light, point_budget, regimes, repeats
from vibrident.show.views import (
    Block,
    Card,
    Cards,
    Document,
    Fact,
    Facts,
    Folded,
    Section,
    Sentence,
    Table,
    columns,
    count,
    document,
    listed,
    section,
)

# settings with a section of their own
_SETTINGS_WITH_SECTION = ("interferometer", "temperature", "repeats", "regimes", RAISED)
MAX_LISTED_FILES = 100  # data files listed in a report; the result lists them all


def report(result: Result, more: Sequence[Section] = ()) -> Document:
    """Return the report of one result, with more sections before its settings."""
    name = sensor_name(result.sensor)
    result = raised_to_measured(result)
    other_settings = {
        key: value
        for key, value in result.settings.items()
        if "budget" not in key and key not in _SETTINGS_WITH_SECTION
    }
    sections = [
        section("warnings", "Warnings", *(tables.doubts(result) or (Sentence("None."),))),
        findings(result),
        section(
            "parameters",
            "Parameters",
            tables.parameters(result),
            *map(Sentence, describe_raised(result)),
        ),
        # free decays alone have neither gain nor curve
        *(_curves(result) if result.has_gain else []),
        section("signals", "Signals", figures.signals(result)),
        section("residuals", "Residuals", residual_tests(result), figures.residuals(result)),
        section("fit", "Fit", tables.fit(result)),
        section("budget", "Uncertainty budget", *_budget(result)),
        section("temperature", "Temperature", certificate_tables.temperature(result)),
        section("repeats", "Runs", repeats(result)),
        section("regimes", "Regimes", regimes(result)),
        section("interferometer", "Interferometer", light(result)),
        section(
            "correlation", "Correlation of the estimated parameters", tables.correlation(result)
        ),
        section("training", "Training", *_training(result)),
        section(
            "certificate",
            "Statements of the laboratory",
            *(_certificate(result) if result.certificate else ()),
        ),
        *more,
        section("settings", "Settings", *tables.values(other_settings)),
        section("provenance", "Provenance", *_provenance(result)),
    ]
    return document(f"Calibration of {name}" if name else "Calibration", head(result), sections)


def comparison(results: Sequence[Result], names: Sequence[str]) -> Document:
    """Return the comparison of several results, with the drift of each recalibrated sensor."""
    sections = []
    for number, history in enumerate(histories(results, names), 1):
        drift_figure = drift(history, f"drift{number}")
        sections.append(
            section(
                f"drift{number}", f"Drift of {history.sensor}", drift_figure, drift_table(history)
            )
        )
    for number, (title, table) in enumerate(comparison_tables(results, names), 1):
        folded = title.startswith("Sensitivity of ")
        body: Block = Folded("Table at nominal frequencies", (table,)) if folded else table
        sections.append(section(f"table{number}", title, body))
        if number == 1:
            sections.append(section("curves", "Sensitivity", comparison_figure(results, names)))
    return document(f"Comparison of {len(results)} calibrations", (), sections)


def head(result: Result) -> tuple[Block, ...]:
    """Return the verdict, what was calibrated and how, and the numbers that most readers want."""
    return (verdict(result), *scatter_only(result), Facts(tables.facts(result)), cards(result))


def verdict(result: Result) -> Sentence:
    """Return whether the model describes the data, and the number of warnings."""
    fine = result.fit.adequate and not result.warnings
    sentence = (
        "The model is adequate for these data"
        if result.fit.adequate
        else "The model does not describe the data"
    )
    doubts = (
        f"{count(len(result.warnings), 'warning')}, explained below"
        if result.warnings
        else "no warnings"
    )
    return Sentence(f"{doubts}.", "fine" if fine else "doubt", f"{sentence};")


def cards(result: Result) -> Cards:
    """Return the sensitivity at the reference frequency, and the estimated parameters."""
    pairs = []
    (_, reference_text), *values = (
        certificate_tables.reference(result).rows if result.has_gain else (("", None),)
    )
    if reference_text:
        frequency = reference_text.split(";")[0]
        pairs += [(f"{label} at {frequency}", text or NONE) for label, text in values]
    k = parameter_factor(result)
    for name, parameter in result.parameters.items():
        if not parameter.derived:
            number = rounded_parameter(parameter, k, parameter_scale(result, parameter))
            value = f"{number.value} {number.unit}".strip()
            bar = (
                "" if number.expanded == NONE else f", U = {number.expanded} {number.unit}".rstrip()
            )
            pairs.append(
                (
                    parameter_name(name).words,
                    f"{value}{bar}{f' (k = {plain(k, 3)})' if bar else ''}",
                )
            )
    return Cards(tuple(_card(label, text) for label, text in pairs))


def _card(label: str, text: str) -> Card:
    value, _, uncertainty = text.partition(", U = ")
    return Card(
        label[:1].upper() + label[1:], value, f"U = {uncertainty}" if uncertainty else "U not known"
    )


def _curves(result: Result) -> list[Section]:
    nominal = _folded("Table at nominal frequencies", certificate_tables.sensitivity(result))
    measured = _folded("Table of measured points", tables.measured(result))
    return [
        section("sensitivity", "Sensitivity", figures.sensitivity(result), nominal),
        section("measured", deviation_points.TITLE, *_from_reference(result)),
        section("deviation", "Deviation", figures.deviation(result), measured),
    ]


def _from_reference(result: Result) -> tuple[Block | None, ...]:
    """Return the measured points beside the reference value and their limits."""
    figure = deviation_points.from_reference(result)
    if figure is None:
        return ()
    table = certificate_tables.measured(result)
    return figure, _folded("Table of measured points with deviations and limits", table)


def _folded(summary: str, table: Table | None) -> Folded | None:
    return None if table is None else Folded(summary, (table,))


def _budget(result: Result) -> Sequence[Block]:
    """Return the contribution of each source; a budget of another form is shown unchanged."""
    if (table := budget(result)) is not None:
        points = point_budget(result)
        return (table, *([Folded("Budget of the measured points", points)] if points else []))
    return tables.values(
        {key: value for key, value in result.settings.items() if "budget" in key and value}
    )


def _training(result: Result) -> tuple[Block | None, ...]:
    sentence = tables.training(result)
    weights = _folded("Weights of the network (the paper's Table 1)", weight_tables.weights(result))
    return Sentence(sentence) if sentence else None, figures.training(result), weights


def _certificate(result: Result) -> tuple[Block | None, ...]:
    """Return what the certificate says besides the numbers; blanks are left as blanks."""
    head = certificate.letterhead(result)
    instruments = certificate_tables.instruments(result)
    rows: list[Fact] = [("Number", head.number), ("Laboratory", ", ".join(head.lines) or None)]
    rows += [row for group in certificate.groups(result) for row in group.rows]
    rows += [
        ("Traceability", result.certificate.get("traceability")),
        *certificate.signatures(result),
    ]
    rows += [("Remark", remark) for remark in certificate.remarks(result)]
    judged = certificate_decisions.conformity(result)
    return Facts(tuple(rows)), (instruments if instruments.rows else None), *judged


def _provenance(result: Result) -> tuple[Block, ...]:
    """Return versions and times, and a table of the files."""
    files = [entry for entry in result.provenance.get("files") or () if isinstance(entry, Mapping)]
    other_entries = {
        key: value for key, value in result.provenance.items() if key != "files" or not files
    }
    limit = listed(len(files), MAX_LISTED_FILES)
    more = (f"and {len(files) - limit} more, listed in result.json",) if len(files) > limit else ()
    names_and_hashes = [
        (str(f.get("file") or NONE), str(f.get("sha256") or NONE)) for f in files[:limit]
    ]
    steps = ["; ".join(map(str, entry.get("history") or ())) for entry in files[:limit]]
    alike = len(steps) > 1 and len(set(steps)) == 1 and steps[0] != ""
    rows = tuple(
        (*names, "" if alike else history)
        for names, history in zip(names_and_hashes, steps, strict=True)
    )
    notes = (*more, *((f"History of each: {steps[0]}.",) if alike else ()))
    table = Table(columns("data file", "SHA-256", "history"), rows, notes=notes).telling()
    return (
        *tables.values(other_entries),
        *((Folded(f"Data files ({len(files)})", (table,)),) if files else ()),
    )
