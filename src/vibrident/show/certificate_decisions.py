"""Tabulate the decisions of a certificate: conformity to requirements, and an adjustment."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from vibrident.base.amounts import pretty
from vibrident.physics.naming import parameter_name
from vibrident.result import Parameter, Result
from vibrident.show.certified import stated_parameters
from vibrident.show.comparison import Value, at_point, of_parameter
from vibrident.show.coverage import unstated
from vibrident.show.language import ENGLISH, Say
from vibrident.show.numbers import (
    NONE,
    parameter_scale,
    percent,
    plain,
    rounded_parameter,
    uncertainty,
    unit_of_sensitivity,
    with_u,
)
from vibrident.show.points import (
    reference_value,
)
from vibrident.show.views import (
    Column,
    K,
    Sentence,
    Table,
)
from vibrident.use.conformity import (
    DEVIATION,
    JudgedRequirement,
    judge_requirements,
    ratio_uncertainty,
)


def conformity(result: Result, say: Say = ENGLISH) -> tuple[Table | Sentence, ...]:
    """Return each requirement, the decision on it, and its probability; nothing without any.

    Raises:
        InputError: a requirement is of a quantity that the result does not have.
    """
    if not result.certificate.get("requirements"):
        return ()
    if "gain" in unstated(result) or result.is_tracked:
        why = "tracked_conformity" if result.is_tracked else "no_conformity"
        return (Sentence(say("text", why)),)
    point = reference_value(result)
    measured_pair = None if point is None else (point.magnitude, point.magnitude_uncertainty)
    result = stated_parameters(result)
    rows = [
        _judged(result, judgement, say)
        for judgement in judge_requirements(
            result, None if point is None else point.frequency_hz, measured_pair
        )
    ]
    heads = [Column(say("head", key)) for key in ("requirement", "source")]
    heads += [Column(say("head", key), "number") for key in ("limits", "value")]
    heads += [
        Column("U", "number"),
        Column(say("head", "unit")),
        Column(say("head", "probability"), "number"),
    ]
    table = Table((*heads, Column(say("head", "decision"))), tuple(rows)).telling()
    rule = say("text", result.certificate.get("decision_rule") or "simple")
    return (Sentence(rule), replace(table, notes=(say("text", "probability"),)))


def _judged(result: Result, row: JudgedRequirement, say: Say) -> tuple[str, ...]:
    if row.quantity == DEVIATION:
        point = reference_value(result)
        nominal = "" if point is None else point.nominal
        if row.frequency_hz is None:
            name = say("text", "deviation_nowhere", reference=nominal or NONE)
        else:
            frequency = f"{row.frequency_hz:.5g}"
            name = say("text", "deviation", reference=nominal, frequency=frequency)
        factor = 1.0
        unit = "%"
    elif row.quantity not in result.parameters:
        name = say.translate(parameter_name(row.quantity).words)
        factor = 1.0
        unit = NONE
    else:
        scale = parameter_scale(result, result.parameters[row.quantity])
        name = say.translate(parameter_name(row.quantity).words)
        factor = scale.factor
        unit = scale.printed or "1"
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
    """Return sensitivity and parameters as received and as returned.

    None without a result from before.
    """
    if before is None:
        return None
    changes: list[tuple[str, Value, Value, str]] = []
    first, last = (reference_value(state) for state in (before, result))
    if first is not None and last is not None:
        name = say.each(
            lambda words: f"{words('label', 'magnitude')}, {words.number(last.nominal)} Hz"
        )
        values = at_point(before, first), at_point(result, last)
        changes.append((name, *values, unit_of_sensitivity(result)))
    for name, after in result.parameters.items():
        received = before.parameters.get(name)
        if received is not None and not after.derived and received.unit == after.unit:
            label = say.translate(parameter_name(name).words)
            changes.append(
                (label, of_parameter(before, name), of_parameter(result, name), after.unit)
            )
    rows = []
    for name, former, present, unit in changes:
        both = [Parameter(value.value, unit, value.u, (None, None)) for value in (former, present)]
        scale = parameter_scale(result, both[1])
        texts = [rounded_parameter(each, K, scale) for each in both]
        numbers = [text for number in texts for text in (number.value, number.expanded)]
        rows.append((name, *numbers, pretty(texts[0].unit), *_change(former, present)))
    heads = (
        Column(say("head", "quantity")),
        Column(say("head", "before"), "number"),
        Column("U", "number"),
    )
    heads += (
        Column(say("head", "after"), "number"),
        Column("U", "number"),
        Column(say("head", "unit")),
    )
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
    gains = (
        np.array([state.shared[name] / abs(state.value) for name in names])
        for state in (after, before)
    )
    common, base_common = gains
    relative = ratio_uncertainty(
        after.u / abs(after.value), common, before.u / abs(before.value), base_common
    )
    expanded = 100.0 * K * abs(ratio) * relative
    return percent(100.0 * (ratio - 1.0), expanded), f"{uncertainty(expanded)} %"
