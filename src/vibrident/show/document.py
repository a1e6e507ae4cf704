"""Build the report of one result and the comparison of several, as documents with sections."""

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
    capitalised,
    columns,
    count,
    document,
    listed,
    section,
)

#: Settings that have a section of their own.
_SETTINGS_WITH_SECTION = ("interferometer", "temperature", "repeats", "regimes", RAISED)
MAX_LISTED_FILES = 100  # data files listed in a report; the result lists them all


def report(result: Result, extra_sections: Sequence[Section] = ()) -> Document:
    """Return the report of one result, with extra sections before its settings."""
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
        *extra_sections,
        section("settings", "Settings", *tables.values(other_settings)),
        section("provenance", "Provenance", *_provenance(result)),
    ]
    return document(f"Calibration of {name}" if name else "Calibration", head(result), sections)


def comparison(results: Sequence[Result], names: Sequence[str]) -> Document:
    """Return the comparison of several results, with the drift of each recalibrated sensor."""
    sections = [
        section(
            f"drift{number}",
            f"Drift of {history.sensor}",
            drift(history, f"drift{number}"),
            drift_table(history),
        )
        for number, history in enumerate(histories(results, names), 1)
    ]
    for number, (title, table) in enumerate(comparison_tables(results, names), 1):
        is_folded = title.startswith("Sensitivity of ")
        body = _folded("Table at nominal frequencies", table) if is_folded else table
        sections.append(section(f"table{number}", title, body))
        if number == 1:
            sections.append(section("curves", "Sensitivity", comparison_figure(results, names)))
    return document(f"Comparison of {len(results)} calibrations", (), sections)


def head(result: Result) -> tuple[Block, ...]:
    """Return the verdict, what was calibrated and how, and the numbers that most readers want."""
    return (verdict(result), *scatter_only(result), Facts(tables.facts(result)), cards(result))


def verdict(result: Result) -> Sentence:
    """Return whether the model describes the data, and the number of warnings."""
    sentence = (
        "The model is adequate for these data"
        if result.fit.adequate
        else "The model does not describe the data"
    )
    doubts = "no warnings"
    if result.warnings:
        doubts = f"{count(len(result.warnings), 'warning')}, explained below"
    is_fine = result.fit.adequate and not result.warnings
    return Sentence(f"{doubts}.", "fine" if is_fine else "doubt", f"{sentence};")


def cards(result: Result) -> Cards:
    """Return the sensitivity at the reference frequency, and the estimated parameters."""
    labelled = []
    if result.has_gain:
        (_, reference_text), *values = certificate_tables.reference(result).rows
        if reference_text:
            frequency = reference_text.split(";")[0]
            labelled += [_card(f"{label} at {frequency}", text or NONE) for label, text in values]
    k = parameter_factor(result)
    for name, parameter in result.parameters.items():
        if parameter.derived:
            continue
        number = rounded_parameter(parameter, k, parameter_scale(result, parameter))
        text = f"{number.value} {number.unit}".strip()
        if number.expanded != NONE:
            text += f", U = {number.expanded} {number.unit}".rstrip() + f" (k = {plain(k, 3)})"
        labelled.append(_card(parameter_name(name).words, text))
    return Cards(tuple(labelled))


def _card(label: str, text: str) -> Card:
    value, _, expanded = text.partition(", U = ")
    return Card(capitalised(label), value, f"U = {expanded}" if expanded else "U not known")


def _curves(result: Result) -> list[Section]:
    nominal = _folded("Table at nominal frequencies", certificate_tables.sensitivity(result))
    measured = _folded("Table of measured points", tables.measured(result))
    return [
        section("sensitivity", "Sensitivity", figures.sensitivity(result), nominal),
        section("measured", deviation_points.TITLE, *_from_reference(result)),
        section("deviation", "Deviation", figures.deviation(result), measured),
    ]


def _from_reference(result: Result) -> tuple[Block | None, ...]:
    """Return picture and table of the measured points' deviations from the reference value."""
    figure = deviation_points.from_reference(result)
    if figure is None:
        return ()
    table = certificate_tables.measured(result)
    return figure, _folded("Table of measured points with deviations and limits", table)


def _folded(summary: str, *blocks: Block | None) -> Folded | None:
    contents = tuple(block for block in blocks if block is not None)
    return Folded(summary, contents) if contents else None


def _budget(result: Result) -> Sequence[Block | None]:
    """Return the contribution of each source; a budget of another form is shown unchanged."""
    if (table := budget(result)) is not None:
        return table, _folded("Budget of the measured points", *point_budget(result))
    return tables.values(
        {key: value for key, value in result.settings.items() if "budget" in key and value}
    )


def _training(result: Result) -> tuple[Block | None, ...]:
    sentence = tables.training(result)
    weights = _folded("Weights of the network (the paper's Table 1)", weight_tables.weights(result))
    return Sentence(sentence) if sentence else None, figures.training(result), weights


def _certificate(result: Result) -> tuple[Block | None, ...]:
    """Return the entries of the certificate besides its numbers; blanks are left as blanks."""
    letterhead = certificate.letterhead(result)
    instruments = certificate_tables.instruments(result)
    facts: list[Fact] = [
        ("Number", letterhead.number),
        ("Laboratory", ", ".join(letterhead.lines) or None),
        *(fact for group in certificate.groups(result) for fact in group.rows),
        ("Traceability", result.certificate.get("traceability")),
        *certificate.signatures(result),
        *(("Remark", remark) for remark in certificate.remarks(result)),
    ]
    return (
        Facts(tuple(facts)),
        instruments if instruments.rows else None,
        *certificate_decisions.conformity(result),
    )


def _provenance(result: Result) -> tuple[Block | None, ...]:
    """Return versions and times, and the table of the data files."""
    entries = dict(result.provenance)
    files = [entry for entry in entries.get("files") or () if isinstance(entry, Mapping)]
    if not files:
        return tables.values(entries)
    del entries["files"]
    limit = listed(len(files), MAX_LISTED_FILES)
    steps = ["; ".join(map(str, entry.get("history") or ())) for entry in files[:limit]]
    notes = []
    if limit < len(files):
        notes.append(f"and {len(files) - limit} more, listed in result.json")
    if len(steps) > 1 and steps[0] and len(set(steps)) == 1:
        notes.append(f"History of each: {steps[0]}.")
        steps = [""] * limit
    rows = tuple(
        (str(entry.get("file") or NONE), str(entry.get("sha256") or NONE), step)
        for entry, step in zip(files[:limit], steps, strict=True)
    )
    table = Table(columns("data file", "SHA-256", "history"), rows, notes=tuple(notes))
    return *tables.values(entries), _folded(f"Data files ({len(files)})", table.telling())
