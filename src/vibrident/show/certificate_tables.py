"""The tables of a certificate, in its languages: every number is the result's."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from vibrident.base.amounts import pretty
from vibrident.base.nominal import same
from vibrident.physics.naming import parameter_name
from vibrident.result import Parameter, Result
from vibrident.show import deviation_points, figures, tables
from vibrident.show.certified import stated_parameters
from vibrident.show.comparison import Value, at_point, of_parameter
from vibrident.show.coverage import parameter_factor, unstated
from vibrident.show.curves import column
from vibrident.show.deviation_points import columns_of_points, reference_hz
from vibrident.show.formulas import Mixed, Words
from vibrident.show.language import ENGLISH, Say
from vibrident.show.numbers import (
    NONE,
    nominal_frequency,
    parameter_scale,
    percent,
    plain,
    printed,
    sensitivity_scale,
    stated,
    uncertainty,
    unit_of_sensitivity,
    with_u,
)
from vibrident.show.points import (
    Point,
    measured_at,
    measured_band,
    nominal_points,
    reference_frequency,
    reference_value,
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
    Sentence,
    Stack,
    Table,
    columns,
    listed,
)
from vibrident.use.conformity import DEVIATION, Judgement, judge_requirements, ratio_uncertainty

MOST_FILES = 30  # data files listed; the result lists them all
_BESIDE = 5  # columns of the magnitude, before those of the phase
MOST_POINTS = 100  # measured points listed; more are thinned evenly


def localised(block: Block | None, say: Say) -> Block | None:
    """Return a block with the document's decimal sign in the numbers of its tables and axes."""
    if isinstance(block, Figure):
        return replace(block, stacks=tuple(_localised_stack(stack, say) for stack in block.stacks))
    if not isinstance(block, Table):
        return block
    own = [column.kind == "number" for column in block.columns]
    rows = tuple(
        tuple(type(cell)(say.number(cell)) if ours else cell for cell, ours in zip(row, own, strict=True))
        for row in block.rows
    )
    return replace(block, rows=rows)


def _localised_stack(stack: Stack, say: Say) -> Stack:
    panels = (
        replace(panel, x=_localised_axis(panel.x, say), y=_localised_axis(panel.y, say)) for panel in stack.panels
    )
    return replace(stack, panels=tuple(panels))


def _localised_axis(axis: Axis, say: Say) -> Axis:
    ticks = tuple((at, say.number(text)) for at, text in axis.ticks)
    return replace(axis, label=say.number(axis.label), ticks=ticks)


def instruments(result: Result, say: Say = ENGLISH) -> Table:
    """The instruments used; no rows are a blank to fill."""
    header = (say("head", key) for key in ("instrument", "maker", "serial_number", "certificate", "calibrated_until"))
    rows = []
    for item in result.certificate.get("instruments") or ():
        entry = item if isinstance(item, Mapping) else {"name": item}
        maker = " ".join(str(entry[key]) for key in ("manufacturer", "type") if entry.get(key))
        rest = (str(entry.get(key) or "") for key in ("serial_number", "certificate", "calibrated_until"))
        rows.append((str(entry.get("name", "")), maker, *rest))
    return Table(columns(*header), tuple(rows)).telling()


def reference(result: Result, say: Say = ENGLISH) -> Facts:
    """The sensitivity at the reference frequency, and how that was chosen."""
    chosen, why = reference_frequency(result)
    label = say("label", "reference_frequency_hz")
    model = None if chosen is None else sensitivity_at(result, chosen)
    found = None if chosen is None else measured_at(result, chosen)
    point = found or model
    if point is None:
        asked = result.certificate.get("reference_frequency_hz")
        reason = say.known(why)
        reason = Words(f"{reason[:1].upper()}{reason[1:]}.")
        if asked is not None and measured_band(result) is not None:
            reason = say("text", "outside", frequency=f"{asked:.6g}")
        return Facts(((label, None), (say("label", "reason"), reason)))
    exact = same(float(point.nominal), point.frequency_hz)

    def choice(one: Say) -> str:
        at_exact = "" if exact else one("text", "computed_at", frequency=exact_frequency(point))
        return f"{one.number(point.nominal)} Hz{at_exact}; {one.known(why)}"

    rows: list[Fact] = [(label, say.each(choice))]
    for one, source in ((found, "measured_value"), (model, "model_value")):
        rows += [] if one is None else _reference_rows(result, one, source, say)
    return Facts(tuple(rows))


def _reference_rows(result: Result, point: Point, source: str, say: Say) -> list[Fact]:
    """Return magnitude and phase at the reference frequency, measured or of the model."""

    def label(key: str) -> Words:
        return say.each(lambda one: f"{one('label', key)}, {one('text', source)}")

    scale = sensitivity_scale(result)
    magnitude, expanded = with_u(point.magnitude, point.magnitude_uncertainty, scale.factor)
    rows: list[Fact] = [(label("magnitude"), say.number(f"{magnitude} {scale.unit}{_bar(expanded, scale.unit)}"))]
    if point.phase_deg is not None:
        phase, phase_u = with_u(point.phase_deg, point.phase_deg_uncertainty, 1.0)
        rows.append((label("phase"), say.number(f"{phase}°{_bar(phase_u, '°')}")))
    return rows


def _bar(expanded: str, unit: str) -> str:
    space = "" if unit == "°" else " "
    return "" if expanded == NONE else f", U = {expanded}{space}{unit} (k = {K:g})"


def sensitivity(result: Result, say: Say = ENGLISH) -> Table | None:
    """Magnitude, phase and U at the nominal frequencies of the measured band; None if it holds no nominal frequency."""
    points = nominal_points(result)
    if not points:
        return None
    scale = sensitivity_scale(result)
    phases = any(point.phase_deg is not None for point in points)
    rows = tuple(_row(point, scale.factor, phases) for point in points)
    notes = (say("text", "curve_note"), *((say("text", "phase"),) if phases else ()))
    return Table(_heads(say, scale.unit, phases), rows, notes=notes)


def _heads(say: Say, unit: str, phases: bool) -> tuple[Column, ...]:
    heads = [(say("head", "nominal"), "Hz"), ("f", "Hz"), (say("head", "magnitude"), unit), ("U", unit), ("U", "%")]
    heads += [(say("head", "phase"), "°"), ("U", "°")] if phases else []
    return tuple(Column(title, "number", unit) for title, unit in heads)


def exact_frequency(point: Point) -> str:
    """The frequency that a point's values belong to, in Hz, five digits."""
    return f"{point.frequency_hz:#.5g}".rstrip(".") if point.frequency_hz < 1e5 else f"{point.frequency_hz:.0f}"


def _row(point: Point, factor: float, phases: bool) -> tuple[str, ...]:
    magnitude, expanded = with_u(point.magnitude, point.magnitude_uncertainty, factor)
    relative = NONE
    if point.magnitude_uncertainty is not None and point.magnitude:
        _, relative = with_u(abs(point.magnitude), point.magnitude_uncertainty, 100.0 / abs(point.magnitude))
    row = (point.nominal, exact_frequency(point), magnitude, expanded, relative)
    return row + with_u(point.phase_deg, point.phase_deg_uncertainty, 1.0) if phases else row


def measured(result: Result, say: Say = ENGLISH) -> Table | None:
    """What the data say at each frequency, with U of noise and stated effects together; None without points."""
    points, scale = result.measured, sensitivity_scale(result)
    total = len(points.frequency_hz)
    if total == 0:
        return None
    phases, step = bool(np.isfinite(points.phase_deg).any()), max(1, -(-total // MOST_POINTS))
    names = ("magnitude", "phase_deg", "magnitude_uncertainty", "phase_deg_uncertainty")
    known, rows = [column(points, name) for name in names], []
    beside = columns_of_points(result, say)
    for i in range(0, total, step):
        f = float(points.frequency_hz[i])
        place = Point(nominal_frequency(f) or NONE, f, *(float(values[i]) for values in known))
        row = _row(place, scale.factor, phases)
        rows.append((*row[:_BESIDE], *(one.cell(i) for one in beside), *row[_BESIDE:]))
    notes = [say("text", "measured_note"), *([say("text", "thinned", step=step, total=total)] if step > 1 else [])]
    notes += [say("text", "unstated")] if any(NONE in row[1:] for row in rows) else []
    notes += [say("text", "deviation_note", reference=plain(reference_hz(result), 5))] if beside else []
    heads = _heads(say, scale.unit, phases)
    heads = (*heads[:_BESIDE], *(one.head for one in beside), *heads[_BESIDE:])
    return Table(heads, tuple(rows), notes=tuple(notes))


def from_reference(result: Result, say: Say = ENGLISH) -> Figure | None:
    """Return the picture of the deviation from the reference value, without words."""
    figure = deviation_points.from_reference(result, say)
    return None if figure is None else replace(figure, title="")


def curve(result: Result, say: Say = ENGLISH) -> Figure | None:
    """The picture of the sensitivity with symbols for words; None for a single frequency."""
    figure = figures.sensitivity(result)
    curves = (result.response, result.measured)
    if figure is None or max(len(curve.frequency_hz) for curve in curves) < 2:
        return None
    stacks = []
    for stack in figure.stacks:
        panels = []
        for panel, name in zip(stack.panels, (f"|S| / ({sensitivity_scale(result).unit})", "φ / °"), strict=False):
            series = tuple(replace(one, label="", band="") for one in panel.series)
            axes = replace(panel.x, label="f / Hz"), replace(panel.y, label=name)
            panels.append(replace(panel, x=axes[0], y=axes[1], series=series, title=""))
        stacks.append(replace(stack, panels=tuple(panels), title=""))
    caption = say("text", "caption" if result.response.magnitude.size else "caption_measured")
    return replace(figure, title="", subject="", note="", stacks=tuple(stacks), caption=caption)


def parameters(result: Result, say: Say = ENGLISH) -> Table:
    """The parameter table without the columns that a certificate does not need."""
    whole = tables.parameters(stated_parameters(result))
    few = parameter_factor(result) != K
    names = ("parameter", "symbol", "value", "u", *(("k",) if few else ()), "U", "unit", "remark")
    kept = whole.select(tuple(whole.header.index(name) for name in names))
    heads = tuple(
        column if column.title in ("u", "k", "U") else replace(column, title=say("head", column.title))
        for column in kept.columns
    )
    rows = tuple(
        (say.known(row[0]), *row[1:-1], say.each(lambda one, row=row: ", ".join(map(one.known, row[-1].split(", ")))))
        for row in kept.rows
    )
    notes = tuple(filter(None, (tables.per_g(result, say),)))
    return replace(kept, columns=heads, rows=rows, notes=notes).telling()


def point_budgets(result: Result, say: Say = ENGLISH) -> tuple[Table, ...]:
    """The budget of the measured points, frequency by frequency; none without stated effects."""
    found = []
    for table in point_budget(result, say):
        unit = table.columns[-1].unit
        unit = f"({unit})" if "/" in unit else unit
        title = say.each(lambda one, table=table, unit=unit: f"{one('head', table.name)}, u / {unit}")
        step = max(1, -(-len(table.rows) // MOST_POINTS))
        found.append(replace(table, rows=table.rows[::step], title=Mixed(title)))
    return tuple(found)


def conformity(result: Result, say: Say = ENGLISH) -> tuple[Table | Sentence, ...]:
    """Each requirement, whether it is met by the decision rule, and how probable that is; nothing without requirements.

    Raises:
        InputError: a requirement is of a quantity that the result does not have.
    """
    if not result.certificate.get("requirements"):
        return ()
    if "gain" in unstated(result) or result.is_tracked:
        why = "tracked_conformity" if result.is_tracked else "no_conformity"
        return (Sentence(say("text", why)),)
    point = reference_value(result)
    place = None if point is None else (point.magnitude, point.magnitude_uncertainty)
    result = stated_parameters(result)
    rows = [_judged(result, one, say) for one in judge_requirements(result, None if point is None else point.frequency_hz, place)]
    heads = [Column(say("head", key)) for key in ("requirement", "source")]
    heads += [Column(say("head", key), "number") for key in ("limits", "value")]
    heads += [Column("U", "number"), Column(say("head", "unit")), Column(say("head", "probability"), "number")]
    table = Table((*heads, Column(say("head", "decision"))), tuple(rows)).telling()
    rule = say("text", result.certificate.get("decision_rule") or "simple")
    return (Sentence(rule), replace(table, notes=(say("text", "probability"),)))


def _judged(result: Result, row: Judgement, say: Say) -> tuple[str, ...]:
    if row.quantity == DEVIATION:
        point = reference_value(result)
        place = "" if point is None else point.nominal
        if row.frequency_hz is None:
            name = say("text", "deviation_nowhere", reference=place or NONE)
        else:
            frequency = f"{row.frequency_hz:.5g}"
            name = say("text", "deviation", reference=place, frequency=frequency)
        factor, unit = 1.0, "%"
    elif row.quantity not in result.parameters:
        name, factor, unit = say.known(parameter_name(row.quantity).words), 1.0, NONE
    else:
        scale = parameter_scale(result, result.parameters[row.quantity])
        name, factor, unit = say.known(parameter_name(row.quantity).words), scale.factor, scale.printed or "1"
    low, high = (plain(end * factor) for end in (row.low, row.high))
    limits = f"{low}\N{NO-BREAK SPACE}…\N{NO-BREAK SPACE}{high}"
    if math.isinf(row.low) or math.isinf(row.high):
        limits = f"≤ {high}" if math.isinf(row.low) else f"≥ {low}"
    value, expanded = with_u(row.value if math.isfinite(row.value) else None, row.u, factor)
    word = "not_judged" if row.met is None else "pass" if row.met else "fail"
    chance = NONE if row.probability is None else _chance(row.probability)
    return name, row.source, limits, value, expanded, unit, chance, say("text", word)


def _chance(probability: float) -> str:
    """Return a probability in whole percent: its u is no better known, and nothing is certain."""
    if probability < 0.005:
        return "< 1 %"
    return "> 99 %" if probability >= 0.995 else f"{100.0 * probability:.0f} %"


def adjustment(result: Result, before: Result | None, say: Say = ENGLISH) -> Table | None:
    """The sensitivity at the reference frequency and the parameters, as received and as returned.

    None without a result from before.
    """
    if before is None:
        return None
    found: list[tuple[str, Value, Value, str]] = []
    first, last = (reference_value(one) for one in (before, result))
    if first is not None and last is not None:
        name = say.each(lambda one: f"{one('label', 'magnitude')}, {one.number(last.nominal)} Hz")
        values = at_point(before, first), at_point(result, last)
        found.append((name, *values, unit_of_sensitivity(result)))
    for name, after in result.parameters.items():
        former = before.parameters.get(name)
        if former is not None and not after.derived and former.unit == after.unit:
            label = say.known(parameter_name(name).words)
            found.append((label, of_parameter(before, name), of_parameter(result, name), after.unit))
    rows = []
    for name, one, other, unit in found:
        both = [Parameter(value.value, unit, value.u, (None, None)) for value in (one, other)]
        scale = parameter_scale(result, both[1])
        texts = [stated(each, K, scale) for each in both]
        numbers = [text for number in texts for text in (number.value, number.expanded)]
        rows.append((name, *numbers, pretty(texts[0].unit), *_change(one, other)))
    heads = (Column(say("head", "quantity")), Column(say("head", "before"), "number"), Column("U", "number"))
    heads += (Column(say("head", "after"), "number"), Column("U", "number"), Column(say("head", "unit")))
    heads += (Column(say("head", "change"), "number"), Column("U", "number"))
    return Table(heads, tuple(rows), notes=(say("text", "before_note"),))


def _change(before: Value, after: Value) -> tuple[str, str]:
    """Return the relative change and its U, without the sources that both share."""
    if not before.value:
        return NONE, NONE
    ratio = after.value / before.value
    if before.u is None or after.u is None or not after.value:
        return percent(100.0 * (ratio - 1.0)), NONE
    names = sorted(before.shared.keys() & after.shared.keys())
    gains = (np.array([one.shared[name] / abs(one.value) for name in names]) for one in (after, before))
    common, base_common = gains
    relative = ratio_uncertainty(after.u / abs(after.value), common, before.u / abs(before.value), base_common)
    expanded = 100.0 * K * abs(ratio) * relative
    return percent(100.0 * (ratio - 1.0), expanded), f"{uncertainty(expanded)} %"


def temperature(result: Result, say: Say = ENGLISH) -> Table | None:
    """Temperature coefficients with U; None where the records are of one temperature."""
    found = result.settings.get("temperature")
    if not isinstance(found, Mapping) or not found.get("coefficients"):
        return None
    rows = []
    for name, line in found["coefficients"].items():
        parameter = result.parameters[name]
        scale = parameter_scale(result, parameter)
        coefficient = with_u(line["per_k"], line["standard_uncertainty"], 1e6)
        number, _ = with_u(line["value_at_reference"], parameter.standard_uncertainty, scale.factor)
        value = f"{number} {scale.printed}".strip()
        rows.append((say.known(parameter_name(name).words), value, *coefficient, plain(line["probability"], 2)))
    reference = printed(f"{found['reference_c']:g}")
    heads = (Column(say("head", "parameter")), Column(say("head", "at_reference", reference=reference), "number"))
    heads += (Column(say("head", "coefficient"), "number"), Column("U / (10⁻⁶/K)", "number"), Column("p", "number"))
    measured_at = ", ".join(printed(f"{t:g}") for t in found["temperatures_c"])
    own = printed(f"{found['of_result_c']:g}")
    note = say("text", "temperature", temperatures=measured_at, reference=reference, own=own)
    return Table(heads, tuple(rows), notes=(note,))


def files(result: Result, say: Say = ENGLISH) -> Table | None:
    """Data files with their SHA-256."""
    entries = [entry for entry in result.provenance.get("files") or () if isinstance(entry, Mapping)]
    known = [entry for entry in entries if entry.get("file") or entry.get("sha256")]
    rows = tuple((str(entry.get("file") or NONE), str(entry.get("sha256") or NONE)) for entry in known)
    kept = listed(len(rows), MOST_FILES)
    more = (say("text", "more_files", count=len(rows) - kept),) if len(rows) > kept else ()
    return Table(columns(say("head", "file"), "SHA-256"), rows[:kept], notes=more) if rows else None
