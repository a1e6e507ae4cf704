"""Compare methods for the terminal: results, the truth, a choice of model, a joint fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from vibrident.base.amounts import UnitScale, pretty, scaled
from vibrident.base.nominal import Nominal
from vibrident.physics.naming import parameter_name
from vibrident.result import Parameter, Result
from vibrident.show import words
from vibrident.show.numbers import (
    NONE,
    concise,
    fit_unit,
    natural_scale,
    percent,
    plain,
    rounded_parameter,
    sensitivity_scale,
    signed,
    uncertainty,
    with_u,
)
from vibrident.show.points import sensitivity_at
from vibrident.show.views import Column, Sentence, Table, columns
from vibrident.show.weight_tables import weight_rows
from vibrident.use.model_choice import criteria, recommendation

if TYPE_CHECKING:
    from vibrident.use.planning import MountedSensor, Plan

_FIELDS = ("rmse", "mae", "mse", "r2", "rpd", "explained", "coherent", "chi2_reduced")


def labels(results: Sequence[Result]) -> list[str]:
    """Return what to call each result: its estimator, with the model where models differ."""
    several = len({result.model for result in results}) > 1
    names = [
        f"{result.estimator} {result.model}" if several else result.estimator for result in results
    ]
    repeated = {name for name in names if names.count(name) > 1}
    return [f"{name} #{i}" if name in repeated else name for i, name in enumerate(names, 1)]


def compared(
    results: Sequence[Result], names: Sequence[str] = (), truth: Mapping[str, float] | None = None
) -> tuple[Table, Table]:
    """Return parameters and fit of several results of one sensor.

    ``truth``: true values by parameter name in the unit of the first result that has the parameter;
    deviations are from these where given, from the first result otherwise.
    """
    called = list(names) or labels(results)
    return _parameters(results, called, truth or {}), _metrics(results, called)


def _parameters(
    results: Sequence[Result], names: Sequence[str], truth: Mapping[str, float]
) -> Table:
    """Return each parameter as ``value(u)`` by method, and below it its deviation.

    The deviation is from the truth, or from the first method.
    """
    base = "the true value" if truth else names[0]
    rows = []
    for key in dict.fromkeys(key for result in results for key in result.parameters):
        rows += _parameter_rows(key, [result.parameters.get(key) for result in results], truth)
    true_head = ["true"] if truth else []
    heads = (
        *columns("parameter", "unit"),
        *columns(*true_head, *names, kind="number"),
    )
    notes = (f"Below each value: deviation from {base}",)
    return Table(heads, tuple(rows), notes=notes, title="Parameters: value(u in its last digits)")


def _parameter_rows(
    key: str, estimates: Sequence[Parameter | None], truth: Mapping[str, float]
) -> list[tuple[str, ...]]:
    """Return the row of a parameter, and the row of its deviations if there are any.

    ``estimates``: of each method, None where its model lacks the parameter.
    """
    present = [estimate for estimate in estimates if estimate is not None]
    unit = present[0].unit
    scale = scaled(unit, max(abs(estimate.value or 0.0) for estimate in present))
    first_value = None if estimates[0] is None else estimates[0].value
    zero = truth.get(key) if truth else first_value
    cells = []
    below = []
    for i, estimate in enumerate(estimates):
        cells.append(NONE if estimate is None else _value_with_u(estimate, scale, unit))
        deviation = ""
        is_compared = bool(truth) or i > 0
        if is_compared and estimate is not None and zero is not None and estimate.unit == unit:
            deviation = _deviation_text(estimate.value, zero, scale.factor)
        below.append(deviation)
    true = [NONE if zero is None else plain(zero * scale.factor)] if truth else []
    rows = [(parameter_name(key).words, scale.printed, *true, *cells)]
    if any(below):
        rows.append(("", "", *("" for _ in true), *below))
    return rows


def _value_with_u(parameter: Parameter, scale: UnitScale, unit: str) -> str:
    if parameter.unit != unit:  # another quantity with the same name: show its unit
        return f"{concise(parameter.value, parameter.standard_uncertainty)} {parameter.unit}"
    text = _with_u(parameter.value, parameter.standard_uncertainty, scale)
    return text if parameter.identifiable else f"{text} ?"


def _with_u(value: float | None, u: float | None, scale: UnitScale) -> str:
    return concise(scale.times(value), scale.times(u))


def _deviation_text(value: float | None, zero: float, factor: float) -> str:
    if value is None:
        return NONE
    if zero:
        return percent(100 * (value / zero - 1))
    sign = "+" if value >= 0 else ""
    return f"{sign}{plain(value * factor, 3)}"


def _metrics(results: Sequence[Result], names: Sequence[str]) -> Table:
    """Fit metrics by method, and the time it took where the settings hold one."""
    times = [result.settings.get("time_s") for result in results]
    timed = any(isinstance(time, int | float) for time in times)
    rows = []
    for result, name, time in zip(results, names, times, strict=True):
        row = [name]
        row += [plain(getattr(result.fit, field), 6 if field == "r2" else 4) for field in _FIELDS]
        row.append(str(len(result.warnings)))
        if timed:
            row.append(plain(time if isinstance(time, int | float) else None, 3))
        rows.append(tuple(row))
    heads = [*(words.METRICS[field].label for field in _FIELDS), "warn."]
    if timed:
        heads.append("time/s")
    units = {fit_unit(result) for result in results}
    unit_of_errors = f" (RMSE, MAE in {pretty(units.pop())})" if len(units) == 1 else ""
    heads_of_table = (Column("method"), *columns(*heads, kind="number"))
    return Table(heads_of_table, tuple(rows), title=f"Fit{unit_of_errors}")


def models(
    results: Mapping[str, Result], left_out: Mapping[str, Mapping[str, Any]]
) -> tuple[Table, Sentence]:
    """Tabulate the criteria of each model, and name the recommended one.

    ``results``: name of the method to its result; ``left_out``: name of the method to its
    cross-validation, where one was made.
    """
    rows = []
    for name, result in results.items():
        result_criteria = criteria(result)
        weak = sum(not p.identifiable for p in result.parameters.values() if not p.derived)
        row = [
            name,
            str(result_criteria.parameters),
            plain(result_criteria.chi2, 5),
            plain(result_criteria.aic, 5),
            plain(result_criteria.bic, 5),
        ]
        if left_out:
            score = left_out.get(name) or {}
            share = score.get("deviation_percent")
            row += [
                NONE if share is None else f"{plain(share, 3)} %",
                plain(score.get("deviation_in_u"), 3),
            ]
        rows.append((*row, "yes" if result.fit.adequate else "no", str(weak) if weak else NONE))
    heads = [
        "parameters",
        "χ²",
        "AIC",
        "BIC",
        *(["predicted", "in u"] if left_out else []),
        "explains",
        "weak",
    ]
    notes = ("predicted: rms deviation at records left out of the fit",) if left_out else ()
    titled = (Column("method"), *columns(*heads, kind="number"))
    table = Table(titled, tuple(rows), notes=notes, title="Choice of the model")
    return table, Sentence(recommendation(results).words)


def joint(result: Result) -> tuple[Table | Sentence, ...]:
    """Return the joint values of calibrations, each one's own, and the verdict on these.

    The settings of the result of any of them hold it.
    """
    joint_settings = result.settings["joint"]
    files = [entry["file"] for entry in joint_settings["calibrations"]]
    rows = []
    for row in joint_settings["shared"]:
        scale = scaled(row["unit"], abs(row["joint"]["value"]))
        values = [row["joint"], *(row["separate"].get(file) for file in files)]
        cells = [
            NONE if entry is None else _with_u(entry["value"], entry["standard_uncertainty"], scale)
            for entry in values
        ]
        rows.append(
            (parameter_name(row["name"]).words, scale.printed, *cells, plain(row["probability"], 2))
        )
    heads = columns("joint", *(f"{file} alone" for file in files), "p", kind="number")
    title = f"Joint fit of {len(files)} calibrations: value(u in its last digits)"
    notes = ("p: chance of a difference at least as large between calibrations that agree",)
    table = Table((*columns("shared", "unit"), *heads), tuple(rows), notes=notes, title=title)
    unused = [
        entry["file"] for entry in joint_settings["calibrations"] if not entry["own_fit_used"]
    ]
    unused_sentences = []
    if unused:
        sentence = f"Of no use alone, the joint fit explains it better: {', '.join(unused)}."
        unused_sentences.append(Sentence(sentence))
    consistency = joint_settings["consistency"]
    line = (
        f"The calibrations by themselves: χ² = {plain(consistency['chi2'], 4)} (ν = "
        f"{consistency['degrees_of_freedom']}), p = {plain(consistency['probability'], 2)}:"
    )
    if consistency["consistent"]:
        verdict = Sentence(line, "fine", end="consistent")
    else:
        verdict = Sentence(line, "doubt", end="inconsistent")
    return (table, *unused_sentences, verdict)


def network_beside(
    results: Sequence[Result], truth: Mapping[str, float], true_curve: Mapping[float, float]
) -> Table:
    """Return results in one table: parameters, points of the curve, weights of the network.

    ``results``: of one calibration, the network's last; ``truth``: true values by parameter name,
    in the results' units; ``true_curve``: frequency in Hz to the true magnitude of the sensitivity.
    """
    called = labels(results)
    values = []
    for key, true in truth.items():
        estimates = [result.parameters.get(key) for result in results]
        unit = next((p.unit for p in estimates if p is not None), "")
        pairs = [None if p is None else (p.value, p.standard_uncertainty) for p in estimates]
        values += _compare_with_truth(
            parameter_name(key).words, scaled(unit, abs(true)), true, pairs
        )
    curve = []
    for frequency, true in true_curve.items():
        points = [sensitivity_at(result, Nominal(frequency, frequency)) for result in results]
        pairs = [None if p is None else (p.magnitude, p.magnitude_uncertainty) for p in points]
        curve += _compare_with_truth(
            f"|S| at {frequency:g} Hz", sensitivity_scale(results[0]), true, pairs
        )
    weights = _weight_rows(results[-1], len(called))
    groups = {len(values): "the curve:"}
    if weights:
        groups[len(values) + len(curve)] = "its weights (Table 1):"
    heads = (*columns("parameter", "unit"), *columns("true", *called, kind="number"))
    notes = ("Below each value: difference / u, from the true one.",)
    return Table(
        heads,
        (*values, *curve, *weights),
        notes=notes,
        title="value(u in its last digits)",
        groups=groups,
    )


def _weight_rows(result: Result, methods: int) -> list[tuple[str, ...]]:
    """Return the weights of a result's network, two numbers a line, in its column of the table.

    ``methods``: number of results in the table; this one is the last.
    """
    rows = []
    for weight in weight_rows(result.weights, digits=3):
        for number, numbers in enumerate(weight.numbers, 1):
            name = f"{weight.name} {weight.layer}"
            if len(weight.numbers) > 1:
                name += f", row {number}"
            for start in range(0, len(numbers), 2):
                before = ("",) * (methods + 1)  # unit, true value, the other results
                rows.append(
                    (name if start == 0 else "", *before, "  ".join(numbers[start : start + 2]))
                )
    return rows


def _compare_with_truth(
    name: str, scale: UnitScale, true: float, pairs: Sequence[tuple[float, float | None] | None]
) -> list[tuple[str, ...]]:
    """Compare values with the true one: each with u and its distance from the truth in u."""
    cells = [NONE if p is None else _with_u(*p, scale) for p in pairs]
    off = ["" if p is None or not p[1] else f"{signed((p[0] - true) / p[1], 1)} u" for p in pairs]
    return [(name, scale.printed, plain(scale.times(true), 8), *cells), ("", "", "", *off)]


def mounted(result: Result, prediction: MountedSensor) -> Table:
    """Tabulate the sensitivity as identified and on another mounting, rounded by GUM 7.2.6."""
    scale = sensitivity_scale(result)
    rows = []
    both = prediction.identified, prediction.predicted
    for index, frequency_hz in enumerate(prediction.predicted.frequency_hz):
        numbers = [
            text
            for curve in both
            for text in with_u(
                float(curve.magnitude[index]),
                float(curve.magnitude_uncertainty[index]),
                scale.factor,
            )
        ]
        change = f"{100.0 * prediction.change[index]:+.2f}"
        rows.append((f"{frequency_hz:.5g}", *numbers, change))
    heads = columns("identified", "U", "then", "U", "change / %", kind="number")
    return Table(
        (Column("frequency / Hz", "number"), *heads),
        tuple(rows),
        title=f"Sensitivity in {scale.unit} on another mounting: {prediction.sensor.model.name}",
    )


def planned(plan: Plan) -> Table:
    """Tabulate the predicted u of each parameter in a planned calibration, by GUM 7.2.6."""
    is_chosen = plan.criterion is not None
    rows = []
    for name, parameter in plan.parameters.items():
        scale = natural_scale(parameter)
        number = rounded_parameter(parameter, scale=scale)
        u = parameter.standard_uncertainty
        share = NONE
        if u is not None and parameter.value:
            share = f"{uncertainty(100 * abs(u / parameter.value))} %"
        alternatives = (plan.spread, plan.all_points) if is_chosen else ()
        more = (
            uncertainty(alternative[name] * scale.factor) if name in alternative else NONE
            for alternative in alternatives
        )
        rows.append(
            (parameter_name(name).words, number.value, number.standard, number.unit, share, *more)
        )
    heads = (*columns("value", "u", kind="number"), Column("unit"), Column("u / value", "number"))
    heads += columns("u, evenly spread", "u, all", kind="number") if is_chosen else ()
    return Table(
        (Column("parameter"), *heads),
        tuple(rows),
        title=f"Uncertainty to be expected: {plan.model}",
    )
