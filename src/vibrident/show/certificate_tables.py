"""Build the tables and the picture of a certificate, in its languages, from a result alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from vibrident.base.nominal import is_same_frequency
from vibrident.physics.naming import parameter_name
from vibrident.result import Result
from vibrident.show import deviation_points, figures, tables
from vibrident.show.certified import stated_parameters
from vibrident.show.coverage import parameter_factor
from vibrident.show.curves import column
from vibrident.show.deviation_points import deviation_columns, reference_hz
from vibrident.show.formulas import Mixed, Words
from vibrident.show.language import ENGLISH, Translator
from vibrident.show.numbers import (
    NONE,
    nominal_frequency,
    parameter_scale,
    plain,
    printed,
    sensitivity_scale,
    with_u,
)
from vibrident.show.points import (
    SensitivityPoint,
    measured_at,
    measured_band,
    nominal_points,
    reference_frequency,
    sensitivity_at,
)
from vibrident.show.setting_tables import point_budget
from vibrident.show.views import (
    Axis,
    Block,
    Column,
    Fact,
    Facts,
    Figure,
    K,
    Stack,
    Table,
    capitalised,
    columns,
    listed,
)

MAX_LISTED_FILES = 30  # data files listed; the result lists them all
MAX_LISTED_POINTS = 100  # measured points listed; more are thinned evenly
_MAGNITUDE_COLUMNS = 5  # columns of the magnitude, before those of the phase
_INSTRUMENT_CELLS = ("serial_number", "certificate", "calibrated_until")


def localised(block: Block | None, translate: Translator) -> Block | None:
    """Return a block with the document's decimal sign in the numbers of its tables and axes."""
    if isinstance(block, Figure):
        return replace(
            block, stacks=tuple(_localised_stack(stack, translate) for stack in block.stacks)
        )
    if not isinstance(block, Table):
        return block
    is_number = [column.kind == "number" for column in block.columns]
    rows = tuple(
        tuple(
            type(cell)(translate.number(cell)) if number else cell
            for cell, number in zip(row, is_number, strict=True)
        )
        for row in block.rows
    )
    return replace(block, rows=rows)


def _localised_stack(stack: Stack, translate: Translator) -> Stack:
    panels = (
        replace(panel, x=_localised_axis(panel.x, translate), y=_localised_axis(panel.y, translate))
        for panel in stack.panels
    )
    return replace(stack, panels=tuple(panels))


def _localised_axis(axis: Axis, translate: Translator) -> Axis:
    ticks = tuple((at, translate.number(text)) for at, text in axis.ticks)
    return replace(axis, label=translate.number(axis.label), ticks=ticks)


def instruments(result: Result, translate: Translator = ENGLISH) -> Table:
    """Return the instruments used; a table without rows is a blank to fill."""
    rows = []
    for item in result.certificate.get("instruments") or ():
        entry = item if isinstance(item, Mapping) else {"name": item}
        maker = " ".join(str(entry[key]) for key in ("manufacturer", "type") if entry.get(key))
        cells = (str(entry.get(key) or "") for key in _INSTRUMENT_CELLS)
        rows.append((str(entry.get("name", "")), maker, *cells))
    heads = (translate("head", key) for key in ("instrument", "maker", *_INSTRUMENT_CELLS))
    return Table(columns(*heads), tuple(rows)).telling()


def reference(result: Result, translate: Translator = ENGLISH) -> Facts:
    """Return the sensitivity at the reference frequency, and how that frequency was chosen."""
    nominal, why = reference_frequency(result)
    label = translate("label", "reference_frequency_hz")
    values = {}
    if nominal is not None:
        values = {
            "measured_value": measured_at(result, nominal),
            "model_value": sensitivity_at(result, nominal),
        }
    points = {source: point for source, point in values.items() if point is not None}
    if not points:
        stated_hz = result.certificate.get("reference_frequency_hz")
        if stated_hz is not None and measured_band(result) is not None:
            reason = translate("text", "outside", frequency=f"{stated_hz:.6g}")
        else:
            reason = Words(f"{capitalised(translate.phrase(why))}.")
        return Facts(((label, None), (translate("label", "reason"), reason)))
    point = next(iter(points.values()))
    is_exact = is_same_frequency(float(point.nominal), point.frequency_hz)

    def describe_choice(language: Translator) -> str:
        computed_at = (
            "" if is_exact else language("text", "computed_at", frequency=exact_frequency(point))
        )
        return f"{language.number(point.nominal)} Hz{computed_at}; {language.phrase(why)}"

    facts: list[Fact] = [(label, translate.each_language(describe_choice))]
    for source, value in points.items():
        facts += _reference_facts(result, value, source, translate)
    return Facts(tuple(facts))


def _reference_facts(
    result: Result, point: SensitivityPoint, source: str, translate: Translator
) -> list[Fact]:
    """Return magnitude and phase at the reference frequency; ``source``: key of their origin."""
    scale = sensitivity_scale(result)
    quantities = [
        ("magnitude", point.magnitude, point.magnitude_uncertainty, scale.factor, f" {scale.unit}")
    ]
    if point.phase_deg is not None:
        quantities.append(("phase", point.phase_deg, point.phase_deg_uncertainty, 1.0, "°"))
    facts: list[Fact] = []
    for key, value, u, factor, unit in quantities:
        number, expanded = with_u(value, u, factor)
        bar = "" if expanded == NONE else f", U = {expanded}{unit} (k = {K:g})"
        label = translate.each_language(
            lambda language, key=key: f"{language('label', key)}, {language('text', source)}"
        )
        facts.append((label, translate.number(f"{number}{unit}{bar}")))
    return facts


def sensitivity(result: Result, translate: Translator = ENGLISH) -> Table | None:
    """Return magnitude, phase and U at the nominal frequencies of the band; None without any."""
    points = nominal_points(result)
    if not points:
        return None
    scale = sensitivity_scale(result)
    has_phases = any(point.phase_deg is not None for point in points)
    rows = tuple(_point_row(point, scale.factor, has_phases) for point in points)
    notes = [translate("text", "curve_note")]
    if has_phases:
        notes.append(translate("text", "phase"))
    return Table(_point_columns(translate, scale.unit, has_phases), rows, notes=tuple(notes))


def _point_columns(translate: Translator, unit: str, has_phases: bool) -> tuple[Column, ...]:
    heads = [
        (translate("head", "nominal"), "Hz"),
        ("f", "Hz"),
        (translate("head", "magnitude"), unit),
        ("U", unit),
        ("U", "%"),
    ]
    heads += [(translate("head", "phase"), "°"), ("U", "°")] if has_phases else []
    return tuple(Column(title, "number", unit) for title, unit in heads)


def exact_frequency(point: SensitivityPoint) -> str:
    """Return the frequency to which a point's values belong, in Hz, five digits."""
    if point.frequency_hz >= 1e5:
        return f"{point.frequency_hz:.0f}"
    return f"{point.frequency_hz:#.5g}".rstrip(".")


def _point_row(point: SensitivityPoint, factor: float, has_phases: bool) -> tuple[str, ...]:
    u = point.magnitude_uncertainty
    relative = NONE
    if u is not None and point.magnitude:
        size = abs(point.magnitude)
        _, relative = with_u(size, u, 100.0 / size)
    cells = (
        point.nominal,
        exact_frequency(point),
        *with_u(point.magnitude, u, factor),
        relative,
    )
    return (
        (*cells, *with_u(point.phase_deg, point.phase_deg_uncertainty, 1.0))
        if has_phases
        else cells
    )


def measured(result: Result, translate: Translator = ENGLISH) -> Table | None:
    """Return the measured values at each frequency with their U; None without measured points.

    U covers noise and stated effects.
    """
    points = result.measured
    scale = sensitivity_scale(result)
    total = len(points.frequency_hz)
    if total == 0:
        return None
    has_phases = bool(np.isfinite(points.phase_deg).any())
    step = _thinning(total)
    names = ("magnitude", "phase_deg", "magnitude_uncertainty", "phase_deg_uncertainty")
    value_columns = [column(points, name) for name in names]
    extra_columns = deviation_columns(result, translate)
    rows = []
    for i in range(0, total, step):
        f = float(points.frequency_hz[i])
        values = (float(values[i]) for values in value_columns)
        point = SensitivityPoint(nominal_frequency(f) or NONE, f, *values)
        row = _point_row(point, scale.factor, has_phases)
        rows.append(_insert(row, tuple(extra_column.cell(i) for extra_column in extra_columns)))
    notes = [translate("text", "measured_note")]
    if step > 1:
        notes.append(translate("text", "thinned", step=step, total=total))
    if any(NONE in row[1:] for row in rows):
        notes.append(translate("text", "unstated"))
    if extra_columns:
        hz = plain(reference_hz(result), 5)
        notes.append(translate("text", "deviation_note", reference=hz))
    heads = _insert(
        _point_columns(translate, scale.unit, has_phases),
        tuple(extra_column.head for extra_column in extra_columns),
    )
    return Table(heads, tuple(rows), notes=tuple(notes))


def _thinning(total: int) -> int:
    """Return the least step by which at most ``MAX_LISTED_POINTS`` of ``total`` are listed."""
    return max(1, -(-total // MAX_LISTED_POINTS))


def _insert(cells: tuple[Any, ...], additional_cells: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return a row with additional cells between the magnitude's and the phase's."""
    return (*cells[:_MAGNITUDE_COLUMNS], *additional_cells, *cells[_MAGNITUDE_COLUMNS:])


def from_reference(result: Result, translate: Translator = ENGLISH) -> Figure | None:
    """Return the picture of the deviation from the reference value, without words."""
    figure = deviation_points.from_reference(result, translate)
    return None if figure is None else replace(figure, title="")


def curve(result: Result, translate: Translator = ENGLISH) -> Figure | None:
    """Return the picture of the sensitivity with symbols for words; None for a single frequency."""
    figure = figures.sensitivity(result)
    curves = (result.response, result.measured)
    if figure is None or max(len(curve.frequency_hz) for curve in curves) < 2:
        return None
    y_labels = (f"|S| / ({sensitivity_scale(result).unit})", "φ / °")
    stacks = []
    for stack in figure.stacks:
        panels = tuple(
            replace(
                panel,
                x=replace(panel.x, label="f / Hz"),
                y=replace(panel.y, label=y_label),
                series=tuple(replace(line, label="", band="") for line in panel.series),
                title="",
            )
            for panel, y_label in zip(stack.panels, y_labels, strict=False)
        )
        stacks.append(replace(stack, panels=panels, title=""))
    caption = translate("text", "caption" if result.response.magnitude.size else "caption_measured")
    return replace(figure, title="", subject="", note="", stacks=tuple(stacks), caption=caption)


def parameters(result: Result, translate: Translator = ENGLISH) -> Table:
    """Return the parameters, without the columns that a certificate does not need."""
    table = tables.parameters(stated_parameters(result))
    names = ["parameter", "symbol", "value", "u", "U", "unit", "remark"]
    if parameter_factor(result) != K:
        names.insert(names.index("U"), "k")
    selected = table.select(tuple(table.header.index(name) for name in names))
    heads = tuple(
        column
        if column.title in ("u", "k", "U")
        else replace(column, title=translate("head", column.title))
        for column in selected.columns
    )
    rows = []
    for name, *cells, remark in selected.rows:
        remarks = translate.each_language(
            lambda language, remark=remark: ", ".join(map(language.phrase, remark.split(", ")))
        )
        rows.append((translate.phrase(name), *cells, remarks))
    notes = tuple(filter(None, (tables.per_g(result, translate),)))
    return replace(selected, columns=heads, rows=tuple(rows), notes=notes).telling()


def point_budgets(result: Result, translate: Translator = ENGLISH) -> tuple[Table, ...]:
    """Return the budget of the measured points by frequency; empty without stated effects."""
    budgets = []
    for table in point_budget(result, translate):
        title = translate.each_language(
            lambda language, table=table: (
                replace(table.columns[-1], title=f"{language('head', table.name)}, u").heading
            )
        )
        rows = table.rows[:: _thinning(len(table.rows))]
        budgets.append(replace(table, rows=rows, title=Mixed(title)))
    return tuple(budgets)


def temperature(result: Result, translate: Translator = ENGLISH) -> Table | None:
    """Return temperature coefficients with U; None if the records are of one temperature."""
    settings = result.settings.get("temperature")
    if not isinstance(settings, Mapping) or not settings.get("coefficients"):
        return None
    rows = []
    for name, line in settings["coefficients"].items():
        parameter = result.parameters[name]
        scale = parameter_scale(result, parameter)
        number, _ = with_u(line["value_at_reference"], parameter.standard_uncertainty, scale.factor)
        rows.append(
            (
                translate.phrase(parameter_name(name).words),
                f"{number} {scale.printed}".strip(),
                *with_u(line["per_k"], line["standard_uncertainty"], 1e6),
                plain(line["probability"], 2),
            )
        )
    reference = printed(f"{settings['reference_c']:g}")
    number_heads = (
        translate("head", "at_reference", reference=reference),
        translate("head", "coefficient"),
        "U / (10⁻⁶/K)",
        "p",
    )
    note = translate(
        "text",
        "temperature",
        temperatures=", ".join(printed(f"{t:g}") for t in settings["temperatures_c"]),
        reference=reference,
        own=printed(f"{settings['of_result_c']:g}"),
    )
    heads = (Column(translate("head", "parameter")), *columns(*number_heads, kind="number"))
    return Table(heads, tuple(rows), notes=(note,))


def files(result: Result, translate: Translator = ENGLISH) -> Table | None:
    """Return the data files with their SHA-256; None if there are none."""
    rows = tuple(
        (str(entry.get("file") or NONE), str(entry.get("sha256") or NONE))
        for entry in result.provenance.get("files") or ()
        if isinstance(entry, Mapping) and (entry.get("file") or entry.get("sha256"))
    )
    if not rows:
        return None
    limit = listed(len(rows), MAX_LISTED_FILES)
    unlisted = len(rows) - limit
    notes = (translate("text", "more_files", count=unlisted),) if unlisted else ()
    return Table(columns(translate("head", "file"), "SHA-256"), rows[:limit], notes=notes)
