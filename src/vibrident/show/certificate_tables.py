"""The tables of a certificate, in its languages: every number is the result's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from vibrident.base.nominal import is_same_frequency
from vibrident.physics.naming import parameter_name
from vibrident.result import Result
from vibrident.show import deviation_points, figures, tables
from vibrident.show.certified import stated_parameters
from vibrident.show.coverage import parameter_factor
from vibrident.show.curves import column
from vibrident.show.deviation_points import columns_of_points, reference_hz
from vibrident.show.formulas import Mixed, Words
from vibrident.show.language import ENGLISH, Say
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
    columns,
    listed,
)

MAX_LISTED_FILES = 30  # data files listed; the result lists them all
_BEFORE_PHASE = 5  # columns of the magnitude, before those of the phase
MAX_LISTED_POINTS = 100  # measured points listed; more are thinned evenly


def localised(block: Block | None, say: Say) -> Block | None:
    """Return a block with the document's decimal sign in the numbers of its tables and axes."""
    if isinstance(block, Figure):
        return replace(block, stacks=tuple(_localised_stack(stack, say) for stack in block.stacks))
    if not isinstance(block, Table):
        return block
    numeric = [column.kind == "number" for column in block.columns]
    rows = tuple(
        tuple(
            type(cell)(say.number(cell)) if ours else cell
            for cell, ours in zip(row, numeric, strict=True)
        )
        for row in block.rows
    )
    return replace(block, rows=rows)


def _localised_stack(stack: Stack, say: Say) -> Stack:
    panels = (
        replace(panel, x=_localised_axis(panel.x, say), y=_localised_axis(panel.y, say))
        for panel in stack.panels
    )
    return replace(stack, panels=tuple(panels))


def _localised_axis(axis: Axis, say: Say) -> Axis:
    ticks = tuple((at, say.number(text)) for at, text in axis.ticks)
    return replace(axis, label=say.number(axis.label), ticks=ticks)


def instruments(result: Result, say: Say = ENGLISH) -> Table:
    """Return the instruments used; no rows are a blank to fill."""
    header = (
        say("head", key)
        for key in ("instrument", "maker", "serial_number", "certificate", "calibrated_until")
    )
    rows = []
    for item in result.certificate.get("instruments") or ():
        entry = item if isinstance(item, Mapping) else {"name": item}
        maker = " ".join(str(entry[key]) for key in ("manufacturer", "type") if entry.get(key))
        cells = (
            str(entry.get(key) or "")
            for key in ("serial_number", "certificate", "calibrated_until")
        )
        rows.append((str(entry.get("name", "")), maker, *cells))
    return Table(columns(*header), tuple(rows)).telling()


def reference(result: Result, say: Say = ENGLISH) -> Facts:
    """Return the sensitivity at the reference frequency, and how that was chosen."""
    reference_hz, why = reference_frequency(result)
    label = say("label", "reference_frequency_hz")
    model = None if reference_hz is None else sensitivity_at(result, reference_hz)
    measured_point = None if reference_hz is None else measured_at(result, reference_hz)
    point = measured_point or model
    if point is None:
        wanted_hz = result.certificate.get("reference_frequency_hz")
        reason = say.translate(why)
        reason = Words(f"{reason[:1].upper()}{reason[1:]}.")
        if wanted_hz is not None and measured_band(result) is not None:
            reason = say("text", "outside", frequency=f"{wanted_hz:.6g}")
        return Facts(((label, None), (say("label", "reason"), reason)))
    exact = is_same_frequency(float(point.nominal), point.frequency_hz)

    def choice(words: Say) -> str:
        at_exact = "" if exact else words("text", "computed_at", frequency=exact_frequency(point))
        return f"{words.number(point.nominal)} Hz{at_exact}; {words.translate(why)}"

    rows: list[Fact] = [(label, say.each(choice))]
    for value, source in ((measured_point, "measured_value"), (model, "model_value")):
        rows += [] if value is None else _reference_rows(result, value, source, say)
    return Facts(tuple(rows))


def _reference_rows(result: Result, point: SensitivityPoint, source: str, say: Say) -> list[Fact]:
    """Return magnitude and phase at the reference frequency, measured or of the model."""

    def label(key: str) -> Words:
        return say.each(lambda words: f"{words('label', key)}, {words('text', source)}")

    scale = sensitivity_scale(result)
    magnitude, expanded = with_u(point.magnitude, point.magnitude_uncertainty, scale.factor)
    rows: list[Fact] = [
        (label("magnitude"), say.number(f"{magnitude} {scale.unit}{_bar(expanded, scale.unit)}"))
    ]
    if point.phase_deg is not None:
        phase, phase_u = with_u(point.phase_deg, point.phase_deg_uncertainty, 1.0)
        rows.append((label("phase"), say.number(f"{phase}°{_bar(phase_u, '°')}")))
    return rows


def _bar(expanded: str, unit: str) -> str:
    space = "" if unit == "°" else " "
    return "" if expanded == NONE else f", U = {expanded}{space}{unit} (k = {K:g})"


def sensitivity(result: Result, say: Say = ENGLISH) -> Table | None:
    """Return magnitude, phase and U at the nominal frequencies of the band; None without any."""
    points = nominal_points(result)
    if not points:
        return None
    scale = sensitivity_scale(result)
    phases = any(point.phase_deg is not None for point in points)
    rows = tuple(_row(point, scale.factor, phases) for point in points)
    notes = (say("text", "curve_note"), *((say("text", "phase"),) if phases else ()))
    return Table(_heads(say, scale.unit, phases), rows, notes=notes)


def _heads(say: Say, unit: str, phases: bool) -> tuple[Column, ...]:
    heads = [
        (say("head", "nominal"), "Hz"),
        ("f", "Hz"),
        (say("head", "magnitude"), unit),
        ("U", unit),
        ("U", "%"),
    ]
    heads += [(say("head", "phase"), "°"), ("U", "°")] if phases else []
    return tuple(Column(title, "number", unit) for title, unit in heads)


def exact_frequency(point: SensitivityPoint) -> str:
    """Return the frequency that a point's values belong to, in Hz, five digits."""
    return (
        f"{point.frequency_hz:#.5g}".rstrip(".")
        if point.frequency_hz < 1e5
        else f"{point.frequency_hz:.0f}"
    )


def _row(point: SensitivityPoint, factor: float, phases: bool) -> tuple[str, ...]:
    magnitude, expanded = with_u(point.magnitude, point.magnitude_uncertainty, factor)
    relative = NONE
    if point.magnitude_uncertainty is not None and point.magnitude:
        _, relative = with_u(
            abs(point.magnitude), point.magnitude_uncertainty, 100.0 / abs(point.magnitude)
        )
    row = (point.nominal, exact_frequency(point), magnitude, expanded, relative)
    return row + with_u(point.phase_deg, point.phase_deg_uncertainty, 1.0) if phases else row


def measured(result: Result, say: Say = ENGLISH) -> Table | None:
    """Return the measured values at each frequency, with U of noise and stated effects; or None."""
    points = result.measured
    scale = sensitivity_scale(result)
    total = len(points.frequency_hz)
    if total == 0:
        return None
    phases = bool(np.isfinite(points.phase_deg).any())
    step = max(1, -(-total // MAX_LISTED_POINTS))
    names = ("magnitude", "phase_deg", "magnitude_uncertainty", "phase_deg_uncertainty")
    value_columns = [column(points, name) for name in names]
    rows = []
    extra_columns = columns_of_points(result, say)
    for i in range(0, total, step):
        f = float(points.frequency_hz[i])
        point = SensitivityPoint(
            nominal_frequency(f) or NONE, f, *(float(values[i]) for values in value_columns)
        )
        row = _row(point, scale.factor, phases)
        cells = (extra.cell(i) for extra in extra_columns)
        rows.append((*row[:_BEFORE_PHASE], *cells, *row[_BEFORE_PHASE:]))
    notes = [
        say("text", "measured_note"),
        *([say("text", "thinned", step=step, total=total)] if step > 1 else []),
    ]
    notes += [say("text", "unstated")] if any(NONE in row[1:] for row in rows) else []
    notes += (
        [say("text", "deviation_note", reference=plain(reference_hz(result), 5))]
        if extra_columns
        else []
    )
    heads = _heads(say, scale.unit, phases)
    extra_heads = (extra.head for extra in extra_columns)
    heads = (*heads[:_BEFORE_PHASE], *extra_heads, *heads[_BEFORE_PHASE:])
    return Table(heads, tuple(rows), notes=tuple(notes))


def from_reference(result: Result, say: Say = ENGLISH) -> Figure | None:
    """Return the picture of the deviation from the reference value, without words."""
    figure = deviation_points.from_reference(result, say)
    return None if figure is None else replace(figure, title="")


def curve(result: Result, say: Say = ENGLISH) -> Figure | None:
    """Return the picture of the sensitivity with symbols for words; None for a single frequency."""
    figure = figures.sensitivity(result)
    curves = (result.response, result.measured)
    if figure is None or max(len(curve.frequency_hz) for curve in curves) < 2:
        return None
    stacks = []
    for stack in figure.stacks:
        panels = []
        for panel, name in zip(
            stack.panels, (f"|S| / ({sensitivity_scale(result).unit})", "φ / °"), strict=False
        ):
            series = tuple(replace(line, label="", band="") for line in panel.series)
            axes = replace(panel.x, label="f / Hz"), replace(panel.y, label=name)
            panels.append(replace(panel, x=axes[0], y=axes[1], series=series, title=""))
        stacks.append(replace(stack, panels=tuple(panels), title=""))
    caption = say("text", "caption" if result.response.magnitude.size else "caption_measured")
    return replace(figure, title="", subject="", note="", stacks=tuple(stacks), caption=caption)


def parameters(result: Result, say: Say = ENGLISH) -> Table:
    """Return the parameter table without the columns that a certificate does not need."""
    table = tables.parameters(stated_parameters(result))
    few = parameter_factor(result) != K
    names = ("parameter", "symbol", "value", "u", *(("k",) if few else ()), "U", "unit", "remark")
    selected = table.select(tuple(table.header.index(name) for name in names))
    heads = tuple(
        column
        if column.title in ("u", "k", "U")
        else replace(column, title=say("head", column.title))
        for column in selected.columns
    )
    rows = tuple(
        (
            say.translate(row[0]),
            *row[1:-1],
            say.each(lambda words, row=row: ", ".join(map(words.translate, row[-1].split(", ")))),
        )
        for row in selected.rows
    )
    notes = tuple(filter(None, (tables.per_g(result, say),)))
    return replace(selected, columns=heads, rows=rows, notes=notes).telling()


def point_budgets(result: Result, say: Say = ENGLISH) -> tuple[Table, ...]:
    """Return the budget of the measured points by frequency; none without stated effects."""
    budgets = []
    for table in point_budget(result, say):
        unit = table.columns[-1].unit
        unit = f"({unit})" if "/" in unit else unit
        title = say.each(
            lambda words, table=table, unit=unit: f"{words('head', table.name)}, u / {unit}"
        )
        step = max(1, -(-len(table.rows) // MAX_LISTED_POINTS))
        budgets.append(replace(table, rows=table.rows[::step], title=Mixed(title)))
    return tuple(budgets)


def temperature(result: Result, say: Say = ENGLISH) -> Table | None:
    """Tabulate temperature coefficients with U; None if the records are of one temperature."""
    settings = result.settings.get("temperature")
    if not isinstance(settings, Mapping) or not settings.get("coefficients"):
        return None
    rows = []
    for name, line in settings["coefficients"].items():
        parameter = result.parameters[name]
        scale = parameter_scale(result, parameter)
        coefficient = with_u(line["per_k"], line["standard_uncertainty"], 1e6)
        number, _ = with_u(line["value_at_reference"], parameter.standard_uncertainty, scale.factor)
        value = f"{number} {scale.printed}".strip()
        rows.append(
            (
                say.translate(parameter_name(name).words),
                value,
                *coefficient,
                plain(line["probability"], 2),
            )
        )
    reference = printed(f"{settings['reference_c']:g}")
    heads = (
        Column(say("head", "parameter")),
        Column(say("head", "at_reference", reference=reference), "number"),
    )
    heads += (
        Column(say("head", "coefficient"), "number"),
        Column("U / (10⁻⁶/K)", "number"),
        Column("p", "number"),
    )
    measured_at = ", ".join(printed(f"{t:g}") for t in settings["temperatures_c"])
    own_temperature = printed(f"{settings['of_result_c']:g}")
    note = say(
        "text", "temperature", temperatures=measured_at, reference=reference, own=own_temperature
    )
    return Table(heads, tuple(rows), notes=(note,))


def files(result: Result, say: Say = ENGLISH) -> Table | None:
    """Return the data files with their SHA-256."""
    entries = [
        entry for entry in result.provenance.get("files") or () if isinstance(entry, Mapping)
    ]
    listed_entries = [entry for entry in entries if entry.get("file") or entry.get("sha256")]
    rows = tuple(
        (str(entry.get("file") or NONE), str(entry.get("sha256") or NONE))
        for entry in listed_entries
    )
    rows_listed = listed(len(rows), MAX_LISTED_FILES)
    more = (
        (say("text", "more_files", count=len(rows) - rows_listed),)
        if len(rows) > rows_listed
        else ()
    )
    return (
        Table(columns(say("head", "file"), "SHA-256"), rows[:rows_listed], notes=more)
        if rows
        else None
    )
