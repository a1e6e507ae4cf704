"""Tabulate the decisions of a certificate on requirements, and the effect of an adjustment."""

from __future__ import annotations

import math

import numpy as np

from vibrident.base.amounts import pretty
from vibrident.physics.naming import parameter_name
from vibrident.result import Parameter, Result
from vibrident.show.certified import stated_parameters
from vibrident.show.comparison import Value, at_point, parameter_value
from vibrident.show.coverage import unstated
from vibrident.show.deviation_points import VERDICT_KEYS, limits_text
from vibrident.show.language import ENGLISH, Translator
from vibrident.show.numbers import (
    NONE,
    parameter_scale,
    percent,
    rounded_parameter,
    uncertainty,
    unit_of_sensitivity,
    with_u,
)
from vibrident.show.points import reference_value
from vibrident.show.views import Column, K, Sentence, Table, columns
from vibrident.use.conformity import (
    DEVIATION,
    JudgedRequirement,
    judge_requirements,
    ratio_uncertainty,
)


def conformity(result: Result, translate: Translator = ENGLISH) -> tuple[Table | Sentence, ...]:
    """Return the decision rule and the decision on each requirement; nothing without requirements.

    Raises:
        InputError: a requirement is of a quantity that the result does not have.
    """
    if not result.certificate.get("requirements"):
        return ()
    if result.is_tracked:
        return (Sentence(translate("text", "tracked_conformity")),)
    if "gain" in unstated(result):
        return (Sentence(translate("text", "no_conformity")),)
    point = reference_value(result)
    reference_hz = None if point is None else point.frequency_hz
    measured_pair = None if point is None else (point.magnitude, point.magnitude_uncertainty)
    result = stated_parameters(result)
    rows = tuple(
        _requirement_row(result, judged, translate)
        for judged in judge_requirements(result, reference_hz, measured_pair)
    )
    heads = {
        key: translate("head", key)
        for key in ("requirement", "source", "limits", "value", "unit", "probability", "decision")
    }
    table_columns = (
        *columns(heads["requirement"], heads["source"]),
        *columns(heads["limits"], heads["value"], "U", kind="number"),
        Column(heads["unit"]),
        Column(heads["probability"], "number"),
        Column(heads["decision"]),
    )
    table = Table(table_columns, rows, notes=(translate("text", "probability"),))
    rule = translate("text", result.certificate.get("decision_rule") or "simple")
    return Sentence(rule), table.telling()


def _requirement_row(
    result: Result, judged: JudgedRequirement, translate: Translator
) -> tuple[str, ...]:
    factor = 1.0
    unit = NONE
    if judged.quantity == DEVIATION:
        point = reference_value(result)
        reference = "" if point is None else point.nominal
        unit = "%"
        if judged.frequency_hz is None:
            name = translate("text", "deviation_nowhere", reference=reference or NONE)
        else:
            frequency = f"{judged.frequency_hz:.5g}"
            name = translate("text", "deviation", reference=reference, frequency=frequency)
    else:
        name = translate.phrase(parameter_name(judged.quantity).words)
        if judged.quantity in result.parameters:
            scale = parameter_scale(result, result.parameters[judged.quantity])
            factor = scale.factor
            unit = scale.printed or "1"
    value = judged.value if math.isfinite(judged.value) else None
    return (
        name,
        judged.source,
        limits_text(judged, factor),
        *with_u(value, judged.u, factor),
        unit,
        _probability_text(judged.probability),
        translate("text", VERDICT_KEYS[judged.met]),
    )


def _probability_text(probability: float | None) -> str:
    """Return a probability in whole percent: its u is no better known, and nothing is certain."""
    if probability is None:
        return NONE
    if probability < 0.005:
        return "< 1 %"
    return "> 99 %" if probability >= 0.995 else f"{100.0 * probability:.0f} %"


def adjustment(
    result: Result, before: Result | None, translate: Translator = ENGLISH
) -> Table | None:
    """Return sensitivity and parameters as received and as returned.

    ``before``: the result as received; without it, there is no table.
    """
    if before is None:
        return None
    rows = []
    point_before = reference_value(before)
    point_after = reference_value(result)
    if point_before is not None and point_after is not None:
        name = translate.each_language(
            lambda language: (
                f"{language('label', 'magnitude')}, {language.number(point_after.nominal)} Hz"
            )
        )
        values = at_point(before, point_before), at_point(result, point_after)
        rows.append((name, *_change_cells(result, *values, unit_of_sensitivity(result))))
    for key, parameter in result.parameters.items():
        received = before.parameters.get(key)
        if received is not None and not parameter.derived and received.unit == parameter.unit:
            name = translate.phrase(parameter_name(key).words)
            values = parameter_value(before, key), parameter_value(result, key)
            rows.append((name, *_change_cells(result, *values, parameter.unit)))
    heads = {
        key: translate("head", key) for key in ("quantity", "before", "after", "unit", "change")
    }
    table_columns = (
        Column(heads["quantity"]),
        *columns(heads["before"], "U", heads["after"], "U", kind="number"),
        Column(heads["unit"]),
        *columns(heads["change"], "U", kind="number"),
    )
    return Table(table_columns, tuple(rows), notes=(translate("text", "before_note"),))


def _change_cells(result: Result, before: Value, after: Value, unit: str) -> tuple[str, ...]:
    """Return both values with U, their unit, and the relative change with U."""
    states = [Parameter(state.value, unit, state.u, (None, None)) for state in (before, after)]
    scale = parameter_scale(result, states[1])
    texts = [rounded_parameter(state, K, scale) for state in states]
    numbers = [number for text in texts for number in (text.value, text.expanded)]
    return (*numbers, pretty(scale.printed), *_relative_change(before, after))


def _relative_change(before: Value, after: Value) -> tuple[str, str]:
    """Return the relative change and its U, without the sources that both values share."""
    if not before.value:
        return NONE, NONE
    ratio = after.value / before.value
    change = 100.0 * (ratio - 1.0)
    if before.u is None or after.u is None or not after.value:
        return percent(change), NONE
    names = sorted(before.shared.keys() & after.shared.keys())
    shared_after, shared_before = (
        np.array([state.shared[name] / abs(state.value) for name in names])
        for state in (after, before)
    )
    relative_u = ratio_uncertainty(
        after.u / abs(after.value), shared_after, before.u / abs(before.value), shared_before
    )
    expanded = 100.0 * K * abs(ratio) * relative_u
    return percent(change, expanded), f"{uncertainty(expanded)} %"
