"""What the terminal shows of a result: tables for rich, from values alone. Rich is loaded when one is made."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from vibrident.comparison import criteria, deviations, recommendation
from vibrident.plots.units import pretty, reference_unit, scaled, sensitivity_unit, sensor_name
from vibrident.report import words
from vibrident.report.numbers import NONE, concise, percent, plain, stated
from vibrident.report.weights import weight_rows
from vibrident.result import Parameter, Result

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, Group
    from rich.table import Table
    from rich.text import Text

__all__ = [
    "ParameterTable",
    "compare_table",
    "fit_line",
    "inspection_table",
    "model_table",
    "posterior_table",
    "summary",
    "truth_table",
    "warning_lines",
    "weights_table",
    "written_lines",
]

#: Columns from which on the parameter table has room for its interval.
WIDE = 98
#: Settings that may hold the time an identification took, in seconds.
_TIME_KEYS = ("time_s", "elapsed_s", "wall_time_s", "duration_s")


def summary(result: Result, written: Sequence[str | os.PathLike[str]] = ()) -> Group:
    """Everything ``vibrident identify`` prints: parameters, fit, warnings in plain words, files written."""
    from rich.console import Group

    parts: list[Any] = [ParameterTable(result), fit_line(result)]
    if result.warnings:
        parts.append(warning_lines(result))
    if written:
        parts.append(written_lines(written))
    return Group(*parts)


@dataclass(frozen=True)
class ParameterTable:
    """Name, value, u, U (k = 2), unit and 95 % interval of each parameter, derived ones last.

    A console of fewer than ``WIDE`` columns gets the table without the interval, which u and U say as well.
    """

    result: Result

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Table]:
        yield _parameters(self.result, options.max_width >= WIDE)


def _parameters(result: Result, interval: bool) -> Table:
    name = sensor_name(result.sensor)
    table = _table(f"{result.model}, estimator {result.estimator}{f' · {name}' if name else ''}")
    for header in ("value", "u", "U (k = 2)"):
        table.add_column(header, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    if interval:
        table.add_column("95 % interval", no_wrap=True)
    ordered = sorted(result.parameters.items(), key=lambda item: item[1].derived)
    derived = False
    for key, parameter in ordered:
        if parameter.derived and not derived:
            table.add_section()
            table.add_row("derived from these:", style="dim")
            derived = True
        number = stated(parameter)
        label = words.parameter_name(key).words + ("" if parameter.identifiable else " (not identifiable)")
        row = (label, number.value, number.standard, number.expanded, number.unit, number.interval)
        cells = row if interval else row[:-1]
        table.add_row(*(_plain(cell) for cell in cells), style=None if parameter.identifiable else "yellow")
    return table


def fit_line(result: Result) -> Text:
    """Root mean square residual, its relation to the signal, reduced chi squared, and the verdict."""
    from rich.text import Text

    fit = result.fit
    scale = scaled(_fit_unit(result), fit.rmse or 0.0)
    parts = [f"rmse {plain((fit.rmse or 0.0) * scale.factor, 3)} {scale.unit}"]
    if fit.nrmse is not None:
        parts.append(f"nrmse {plain(100 * fit.nrmse, 3)} %")
    if fit.r2 is not None:
        parts.append(f"R² {plain(fit.r2, 6)}")
    if fit.chi2_reduced is not None:
        parts.append(f"chi²/ν {plain(fit.chi2_reduced, 3)} (ν = {fit.degrees_of_freedom})")
    line = Text("Fit: " + ", ".join(parts) + ": ")
    return line.append("adequate", "green") if fit.adequate else line.append("not adequate", "bold red")


def _fit_unit(result: Result) -> str:
    """Unit of the residual: the response's for records, the sensitivity's for a table."""
    if result.signals:
        return result.response_unit
    return sensitivity_unit(result.response_unit, reference_unit(result))


def warning_lines(result: Result) -> Group:
    """Each warning's title, code, message(s) and what to do."""
    from rich.console import Group
    from rich.padding import Padding
    from rich.text import Text

    parts: list[Any] = []
    for code in result.warning_codes:
        explained = words.explain(code)
        parts.append(Text.assemble(("Warning: ", "bold yellow"), (explained.title, "bold"), f" ({code})"))
        body = [_plain(warning.message) for warning in result.warnings if warning.code == code]
        body.append(Text.assemble(("To do: ", "bold"), explained.action.replace("`", "")))
        parts.extend(Padding(text, (0, 0, 0, 2)) for text in body)
    return Group(*parts)


def written_lines(paths: Sequence[str | os.PathLike[str]]) -> Text:
    """Where files were written, one path a line; long paths are not broken."""
    from rich.text import Text

    lines = [f"{'Written: ' if i == 0 else ' ' * 9}{os.fspath(path)}" for i, path in enumerate(paths)]
    return Text("\n".join(lines), no_wrap=True, overflow="ignore")


def weights_table(result: Result) -> Table:
    """The identified weights as in the paper's Table 1."""
    table = _table("Weights of the network", "weight")
    table.add_column("layer")
    table.add_column("under forward Euler")
    table.add_column("value", no_wrap=True)
    for row in weight_rows(result.weights):
        table.add_row(*(_plain(cell) for cell in (row.name, row.layer, row.euler, "\n".join(row.lines))))
    return table


def posterior_table(result: Result) -> Table:
    """What the sampled posterior says of each parameter, in ``settings.posterior``."""
    table = _table("Posterior distribution")
    for header in ("mean", "standard deviation", "95 % credible interval", "unit", "R̂", "effective draws"):
        table.add_column(header, justify="right", no_wrap=True)
    for key, row in result.settings["posterior"]["parameters"].items():
        low, high = row["interval_95"]
        cells = (f"{row['mean']:.6g}", f"{row['standard_deviation']:.2g}", f"{low:.6g} to {high:.6g}")
        more = (pretty(result.parameters[key].unit), f"{row['r_hat']:.3f}", f"{row['effective_sample_size']:.0f}")
        table.add_row(*(_plain(cell) for cell in (words.parameter_name(key).words, *cells, *more)))
    return table


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
    table = _table("Identified and true values")
    for header in ("true", "identified", "u"):
        table.add_column(header, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    table.add_column("difference / u", justify="right")
    for key, off in deviations(result, truth).items():
        parameter = result.parameters[key]
        number = stated(parameter)
        scale = scaled(parameter.unit, abs(parameter.value))
        row = (words.parameter_name(key).words, plain(off.true * scale.factor, 8), number.value, number.standard)
        difference = NONE if off.in_u is None else f"{off.in_u:+.1f}".replace("-0.0", "+0.0")
        table.add_row(*(_plain(cell) for cell in (*row, number.unit, difference)))
    return table


def _labels(results: Sequence[Result]) -> list[str]:
    several = len({result.model for result in results}) > 1
    labels = [f"{result.estimator}\n{result.model}" if several else result.estimator for result in results]
    repeated = {label for label in labels if labels.count(label) > 1}
    return [f"{label} #{i}" if label in repeated else label for i, label in enumerate(labels, 1)]


def _parameters_by_method(results: Sequence[Result], labels: Sequence[str], truth: Mapping[str, float]) -> Table:
    from rich.text import Text

    base = "the true value" if truth else " ".join(labels[0].split())
    table = _table("Parameters: value(u in its last digits)")
    table.caption = f"Below each value: deviation from {base}"
    table.add_column("unit", no_wrap=True)
    if truth:
        table.add_column("true", justify="right")
    for label in labels:
        table.add_column(_plain(label), justify="right", overflow="fold")
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
            cell = Text(_short(parameter, scale.factor, owners[0].unit))
            widest[i] = max(widest[i], len(cell))
            if zero is not None and (truth or i > 0) and parameter.unit == owners[0].unit:
                cell.append(f"\n{_deviation(parameter.value, zero, scale.factor)}", "dim")
            cells.append(cell)
        row = [Text(words.parameter_name(key).words), Text("" if scale.unit == "1" else scale.unit)]
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
    units = {_fit_unit(result) for result in results}
    table = _table(f"Fit{f' (RMSE, MAE in {pretty(units.pop())})' if len(units) == 1 else ''}", "method")
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
        table.add_row(*(_plain(cell) for cell in row))
    return table


def model_table(results: Mapping[str, Result], foretold: Mapping[str, Mapping[str, Any]]) -> Group:
    """What speaks for each model, and which to take.

    Args:
        results: name of the method to its result.
        foretold: name of the method to its cross-validation, where one was made.
    """
    from rich.console import Group
    from rich.text import Text

    table = _table("Choice of the model", "method")
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
        table.add_row(*(_plain(cell) for cell in row))
    if foretold:
        table.caption = "foretold: rms deviation at records left out of the fit"
    return Group(table, Text(recommendation(results).words), Text(""))


def inspection_table(rows: Sequence[Mapping[str, object]], title: str = "Calibration data") -> Table:
    """Rows of ``vibrident inspect`` as a table.

    Args:
        rows: column name to value; columns in the order in which they first appear, ``frequency_hz`` shown as
            ``frequency / Hz``; numbers to five digits, None as –, flags as yes and no, sequences joined by commas.
            What is the same in all of three or more rows is said once, below the table.
        title: heading of the table.
    """
    keys = list(dict.fromkeys(key for row in rows for key in row))
    table = _table(title, None)
    same = _same_everywhere(rows, keys)
    if same:
        parts = []
        for key in same:
            name, _, unit = _heading(key).partition(" / ")
            parts.append(f"{name} {_cell(rows[0][key])} {unit}".strip())
        table.caption = f"All: {', '.join(parts)}"
    keys = [key for key in keys if key not in same]
    for key in keys:
        values = [row[key] for row in rows if row.get(key) is not None]
        numeric = bool(values) and all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in values)
        longest = max((len(_cell(value)) for value in values), default=1)
        table.add_column(
            _plain(_heading(key)),
            justify="right" if numeric else "left",
            overflow="fold",
            no_wrap=key == "parameter",
            min_width=longest if numeric else min(longest, 6),  # words and headings fold before numbers do
        )
    for row in rows:
        table.add_row(*(_plain(_cell(row.get(key))) for key in keys))
    return table


def _same_everywhere(rows: Sequence[Mapping[str, object]], keys: Sequence[str]) -> list[str]:
    """Columns that say the same in each of several rows: they go to the caption, to leave room for the others."""
    if len(rows) < 3 or len(keys) < 6:
        return []
    return [key for key in keys[1:] if len({_cell(row.get(key)) for row in rows}) == 1 and rows[0].get(key) is not None]


def _heading(key: str) -> str:
    name, _, ending = key.rpartition("_")
    unit = {"hz": "Hz", "s": "s", "percent": "%", "deg": "°", "rad": "rad", "v": "V"}.get(ending)
    return f"{name.replace('_', ' ')} / {unit}" if name and unit else key.replace("_", " ")


def _cell(value: object) -> str:
    if value is None:
        return NONE
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return plain(value, 5)
    if isinstance(value, (list, tuple, set, frozenset)):
        return ", ".join(_cell(item) for item in value)
    return str(value)


def _table(title: str, first: str | None = "parameter") -> Table:
    from rich import box
    from rich.table import Table

    table = Table(
        title=_plain(title),
        title_justify="left",
        title_style="bold",
        caption_justify="left",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        padding=(0, 1, 0, 0),
    )
    if first is not None:
        table.add_column(first, overflow="fold")
    return table


def _plain(text: str) -> Text:
    """Text of others is text: square brackets in it are not markup."""
    from rich.text import Text

    return Text(text)
