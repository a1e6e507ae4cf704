"""Several results of one sensor side by side, and a result beside the truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from vibrident.comparison import criteria, deviations, recommendation
from vibrident.naming import parameter_name, pretty, scaled
from vibrident.present import words
from vibrident.present.numbers import NONE, concise, percent, plain, stated
from vibrident.result import Parameter, Result
from vibrident.terminal.tables import fit_unit, literal, titled

if TYPE_CHECKING:
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

#: Settings that may hold the time an identification took, in seconds.
_TIME_KEYS = ("time_s", "elapsed_s", "wall_time_s", "duration_s")


def compare_table(
    results: Sequence[Result], names: Sequence[str] = (), truth: Mapping[str, float] | None = None
) -> Group:
    """Compare several results of one sensor.

    Args:
        results: at least one.
        names: what to call each; by default its estimator, with the model where models differ.
        truth: true values by parameter name in the unit of the first result that has the parameter; deviations are
            from these where given, from the first result otherwise.

    Returns:
        two tables: parameters as ``value(u)`` with the deviation in percent, and fit metrics by method with the
        time it took where the settings hold one.
    """
    from rich.console import Group

    labels = list(names) if names else _labels(results)
    return Group(_parameters_by_method(results, labels, truth or {}), _metrics_by_method(results, labels))


def truth_table(result: Result, truth: Mapping[str, float]) -> Table:
    """Identified values beside the true ones, with their difference in units of u.

    Args:
        result: of simulated data.
        truth: true values by parameter name, in the result's units; parameters without one are left out.
    """
    table = titled("Identified and true values")
    for header in ("true", "identified", "u"):
        table.add_column(header, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("difference / u", justify="right")
    for key, off in deviations(result, truth).items():
        parameter = result.parameters[key]
        number = stated(parameter)
        scale = scaled(parameter.unit, abs(parameter.value))
        row = (parameter_name(key).words, plain(off.true * scale.factor, 8), number.value, number.standard)
        difference = NONE if off.in_u is None else f"{off.in_u:+.1f}".replace("-0.0", "+0.0")
        table.add_row(*(literal(cell) for cell in (*row, number.unit, difference)))
    return table


def _labels(results: Sequence[Result]) -> list[str]:
    several = len({result.model for result in results}) > 1
    labels = [f"{result.estimator}\n{result.model}" if several else result.estimator for result in results]
    repeated = {label for label in labels if labels.count(label) > 1}
    return [f"{label} #{i}" if label in repeated else label for i, label in enumerate(labels, 1)]


def _parameters_by_method(results: Sequence[Result], labels: Sequence[str], truth: Mapping[str, float]) -> Table:
    from rich.text import Text

    base = "the true value" if truth else " ".join(labels[0].split())
    table = titled("Parameters: value(u in its last digits)")
    table.caption = literal(f"Below each value: deviation from {base}")
    table.add_column("unit", no_wrap=True)
    if truth:
        table.add_column("true", justify="right")
    for label in labels:
        table.add_column(literal(label), justify="right", overflow="fold")
    keys = dict.fromkeys(key for result in results for key in result.parameters)
    widest = [0] * len(labels)
    for key in keys:
        owners = [result.parameters[key] for result in results if key in result.parameters]
        scale = scaled(owners[0].unit, max(abs(p.value or 0.0) for p in owners))
        zero = truth.get(key) if truth else getattr(results[0].parameters.get(key), "value", None)
        cells: list[Text] = []
        for i, result in enumerate(results):
            parameter = result.parameters.get(key)
            if parameter is None:
                cells.append(Text(NONE))
                continue
            cell = literal(_short(parameter, scale.factor, owners[0].unit))
            widest[i] = max(widest[i], len(cell))
            if zero is not None and (truth or i > 0) and parameter.unit == owners[0].unit:
                cell.append(f"\n{_deviation(parameter.value, zero, scale.factor)}", "dim")
            cells.append(cell)
        row = [literal(parameter_name(key).words), literal("" if scale.unit == "1" else scale.unit)]
        if truth:
            row.append(Text(NONE if zero is None else plain(zero * scale.factor)))
        table.add_row(*row, *cells)
    for column, width in zip(table.columns[-len(labels) :], widest, strict=True):
        column.min_width = width  # names give way before numbers do
    return table


def _short(parameter: Parameter, factor: float, unit: str) -> str:
    if parameter.unit != unit:  # another quantity under the same name: keep its unit in sight
        return f"{concise(parameter.value, parameter.standard_uncertainty)} {parameter.unit}"
    u = parameter.standard_uncertainty
    text = concise(None if parameter.value is None else parameter.value * factor, None if u is None else u * factor)
    return text if parameter.identifiable else f"{text} ?"


def _deviation(value: float | None, zero: float, factor: float) -> str:
    if value is None:
        return NONE
    return percent(100 * (value / zero - 1)) if zero else f"{'+' if value >= 0 else ''}{plain(value * factor, 3)}"


def _metrics_by_method(results: Sequence[Result], labels: Sequence[str]) -> Table:
    units = {fit_unit(result) for result in results}
    table = titled(f"Fit{f' (RMSE, MAE in {pretty(units.pop())})' if len(units) == 1 else ''}", "method")
    table.columns[0].min_width = 13
    fields = ("rmse", "mae", "mse", "r2", "rpd", "chi2_reduced")
    for field in fields:
        table.add_column(words.METRICS[field].label.replace("χ", "chi"), justify="right", no_wrap=True)
    table.add_column("warn.", justify="right")
    times = [next((r.settings[k] for k in _TIME_KEYS if k in r.settings), None) for r in results]
    timed = any(isinstance(time, (int, float)) for time in times)
    if timed:
        table.add_column("time/s", justify="right", no_wrap=True)
    for result, label, time in zip(results, labels, times, strict=True):
        row = [" ".join(label.split()), *(plain(getattr(result.fit, f), 6 if f == "r2" else 4) for f in fields)]
        row.append(str(len(result.warnings)))
        if timed:
            row.append(plain(time, 3) if isinstance(time, (int, float)) else NONE)
        table.add_row(*(literal(cell) for cell in row))
    return table


def model_table(results: Mapping[str, Result], foretold: Mapping[str, Mapping[str, Any]]) -> Group:
    """What speaks for each model, and which to take.

    Args:
        results: name of the method to its result.
        foretold: name of the method to its cross-validation, where one was made.
    """
    from rich.console import Group
    from rich.text import Text

    table = titled("Choice of the model", "method")
    headers = ("parameters", "chi²", "AIC", "BIC") + (("foretold", "in u") if foretold else ()) + ("explains", "weak")
    for header in headers:
        table.add_column(header, justify="right", no_wrap=True)
    for name, result in results.items():
        found = criteria(result)
        weak = sum(not p.identifiable for p in result.parameters.values() if not p.derived)
        row = [name, str(found.parameters), plain(found.chi2, 5), plain(found.aic, 5), plain(found.bic, 5)]
        if foretold:
            score = foretold.get(name) or {}
            percent = score.get("deviation_percent")
            row += [NONE if percent is None else f"{plain(percent, 3)} %", plain(score.get("deviation_in_u"), 3)]
        row += ["yes" if result.fit.adequate else "no", str(weak) if weak else NONE]
        table.add_row(*(literal(cell) for cell in row))
    if foretold:
        table.caption = "foretold: rms deviation at records left out of the fit"
    return Group(table, literal(recommendation(results).words), Text(""))
