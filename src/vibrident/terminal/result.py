"""One result: parameters, fit, warnings, weights, posterior."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from vibrident.escaping import terminal
from vibrident.naming import parameter_name, pretty, scaled
from vibrident.present import words
from vibrident.present.coverage import interval_text, parameter_factor
from vibrident.present.numbers import plain, sensor_name, stated
from vibrident.present.weights import weight_rows
from vibrident.result import Result
from vibrident.terminal.tables import fit_unit, literal, titled

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, Group
    from rich.table import Table
    from rich.text import Text

WIDE = 98


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
    """Name, value, u, U (k = 2, or what covers), unit and 95 % interval of each parameter, derived ones last.

    A console of fewer than ``WIDE`` columns gets the table without the interval, which u and U say as well.
    """

    result: Result

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Table]:
        yield _parameters(self.result, options.max_width >= WIDE)


def _parameters(result: Result, interval: bool) -> Table:
    name = sensor_name(result.sensor)
    table = titled(f"{result.model}, estimator {result.estimator}{f' · {name}' if name else ''}")
    k = parameter_factor(result)
    for header in ("value", "u", f"U (k = {plain(k, 3)})"):
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
        number = stated(parameter, k)
        label = parameter_name(key).words + ("" if parameter.identifiable else " (not identifiable)")
        label += " (u not stated)" if parameter.standard_uncertainty is None else ""
        row = (label, number.value, number.standard, number.expanded, number.unit, number.interval)
        cells = row if interval else row[:-1]
        table.add_row(*(literal(cell) for cell in cells), style=None if parameter.identifiable else "yellow")
    table.caption = literal(interval_text(result)) if interval_text(result) else None
    return table


def fit_line(result: Result) -> Text:
    """Root mean square residual, its relation to the signal, reduced chi squared, and the verdict."""

    fit = result.fit
    scale = scaled(fit_unit(result), fit.rmse or 0.0)
    parts = [f"rmse {plain((fit.rmse or 0.0) * scale.factor, 3)} {scale.unit}"]
    if fit.nrmse is not None:
        parts.append(f"nrmse {plain(100 * fit.nrmse, 3)} %")
    if fit.r2 is not None:
        parts.append(f"R² {plain(fit.r2, 6)}")
    if fit.chi2_reduced is not None:
        parts.append(f"chi²/ν {plain(fit.chi2_reduced, 3)} (ν = {fit.degrees_of_freedom})")
    line = literal("Fit: " + ", ".join(parts) + ": ")
    return line.append("adequate", "green") if fit.adequate else line.append("not adequate", "bold red")


def warning_lines(result: Result) -> Group:
    """Each warning's title, code, message(s) and what to do."""
    from rich.console import Group
    from rich.padding import Padding
    from rich.text import Text

    parts: list[Any] = []
    for code in result.warning_codes:
        explained = words.explain(code)
        parts.append(Text.assemble(("Warning: ", "bold yellow"), (explained.title, "bold"), f" ({code})"))
        body = [literal(warning.message) for warning in result.warnings if warning.code == code]
        body.append(Text.assemble(("To do: ", "bold"), explained.action.replace("`", "")))
        parts.extend(Padding(text, (0, 0, 0, 2)) for text in body)
    return Group(*parts)


def written_lines(paths: Sequence[str | os.PathLike[str]]) -> Text:
    """Where files were written, one path a line; long paths are not broken."""
    from rich.text import Text

    lines = [f"{'Written: ' if i == 0 else ' ' * 9}{os.fspath(path)}" for i, path in enumerate(paths)]
    return Text("\n".join(map(terminal, lines)), no_wrap=True, overflow="ignore")


def weights_table(result: Result) -> Table:
    """The identified weights as in the paper's Table 1."""
    table = titled("Weights of the network", "weight")
    table.add_column("layer")
    table.add_column("under forward Euler")
    table.add_column("value", no_wrap=True)
    for row in weight_rows(result.weights):
        table.add_row(*(literal(cell) for cell in (row.name, row.layer, row.euler, "\n".join(row.lines))))
    return table


def posterior_table(result: Result) -> Table:
    """What the sampled posterior says of each parameter, in ``settings.posterior``."""
    table = titled("Posterior distribution")
    for header in ("mean", "standard deviation", "95 % credible interval", "unit", "R̂", "effective draws"):
        table.add_column(header, justify="right", no_wrap=True)
    for key, row in result.settings["posterior"]["parameters"].items():
        low, high = row["interval_95"]
        cells = (f"{row['mean']:.6g}", f"{row['standard_deviation']:.2g}", f"{low:.6g} to {high:.6g}")
        more = (pretty(result.parameters[key].unit), f"{row['r_hat']:.3f}", f"{row['effective_sample_size']:.0f}")
        table.add_row(*(literal(cell) for cell in (parameter_name(key).words, *cells, *more)))
    return table
