"""Print a result on the terminal: tables and sentences for rich, from values alone."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from vibrident.base.amounts import pretty, scaled
from vibrident.base.settings import Word, python_word
from vibrident.physics.naming import parameter_name
from vibrident.result import Result
from vibrident.show import tables, weight_tables, words
from vibrident.show.coverage import interval_text, parameter_factor, scatter_only
from vibrident.show.findings import describe_findings
from vibrident.show.media.console import ConsoleBlocks, on_console
from vibrident.show.media.console import written as paths_written
from vibrident.show.numbers import fit_unit, plain, sensor_name
from vibrident.show.setting_tables import regimes
from vibrident.show.views import Column, Sentence, Table, columns

__all__ = ["fit_line", "parameter_table", "posterior_table", "summary", "text", "weights_table"]


def summary(
    result: Result, written: Sequence[str | os.PathLike[str]] = (), word: Word = python_word
) -> Any:
    """Return all that ``vibrident identify`` prints.

    ``word``: the words of a surface for settings.
    """
    from rich.console import Group

    regime_table = regimes(result)
    changed = () if regime_table is None else (regime_table,)
    printed = on_console(
        parameter_table(result),
        *changed,
        fit_line(result),
        *scatter_only(result),
        *describe_findings(result, word),
    )
    return Group(printed, paths_written(written)) if written else printed


def text(result: Result) -> str:
    """Return the summary as plain text, a hundred characters wide at most."""
    from rich.console import Console

    console = Console(
        width=100,
        color_system=None,
        markup=False,
        highlight=False,
        emoji=False,
        force_terminal=False,
    )
    with console.capture() as capture:
        console.print(summary(result))
    return "\n".join(line.rstrip() for line in capture.get().splitlines())


def parameter_table(result: Result) -> Table:
    """Return value, u, U, unit and 95 % interval of each parameter, derived ones last."""
    k = parameter_factor(result)
    rows = []
    doubtful = []
    groups = {}
    table = tables.parameters(result)
    column_of = {column.title: j for j, column in enumerate(table.columns)}
    for i, row in enumerate(table.rows):
        remarks = [
            word for word in row[column_of["remark"]].split(", ") if word and word != "derived"
        ]
        if "derived" in row[column_of["remark"]] and not groups:
            groups[i] = "derived from these:"
        if {words.WEAK, words.UNKNOWN} & {*remarks}:
            doubtful.append(i)
        name = row[0] + "".join(f" ({remark})" for remark in remarks)
        unit = row[column_of["unit"]]
        cells = (row[column_of[title]] for title in ("value", "u", "U"))
        rows.append((name, *cells, "" if unit == "1" else unit, row[column_of["95 % interval"]]))
    heads = (
        Column("parameter"),
        *columns("value", "u", f"U (k = {plain(k, 3)})", kind="number"),
        Column("unit"),
        Column("95 % interval", spare=True),
    )
    sensor = sensor_name(result.sensor)
    title = f"{result.model}, estimator {result.estimator}{f' · {sensor}' if sensor else ''}"
    notes = (tables.one_frequency(result), tables.between_samples(result), interval_text(result))
    notes = tuple(text for text in notes if text)
    return Table(
        heads, tuple(rows), notes=notes, title=title, groups=groups, doubtful=tuple(doubtful)
    )


def fit_line(result: Result) -> Sentence:
    """Return the residual rms, its relation to the signal, reduced χ², and the verdict."""
    fit = result.fit
    scale = scaled(fit_unit(result), fit.rmse or 0.0)
    figures = [f"rmse {plain((fit.rmse or 0.0) * scale.factor, 3)} {scale.unit}"]
    if fit.nrmse is not None:
        figures.append(f"nrmse {plain(100 * fit.nrmse, 3)} %")
    if fit.r2 is not None:
        figures.append(f"R² {plain(fit.r2, 6)}")
    if math.isfinite(fit.explained):
        explained, coherent = (plain(100 * share, 4) for share in (fit.explained, fit.coherent))
        by_others = "" if explained == coherent else f" (any linear sensor: {coherent} %)"
        figures.append(f"explained {explained} %{by_others}")
    if fit.chi2_reduced is not None:
        figures.append(f"χ²/ν {plain(fit.chi2_reduced, 3)} (ν = {fit.degrees_of_freedom})")
    text = f"Fit: {', '.join(figures)}:"
    if fit.adequate:
        return Sentence(text, "fine", end="adequate")
    return Sentence(text, "doubt", end="not adequate")


def weights_table(result: Result) -> ConsoleBlocks:
    """Return the weights as in the paper's Table 1, a row of a matrix a line."""
    table = weight_tables.weights(result, between="\n")
    return on_console(
        None if table is None else replace(table, notes=(), title="Weights of the network")
    )


def posterior_table(result: Result) -> ConsoleBlocks:
    """Return the sampled posterior of each parameter, from ``settings.posterior``."""
    rows = []
    for key, row in result.settings["posterior"]["parameters"].items():
        low, high = row["interval_95"]
        cells = (
            f"{row['mean']:.6g}",
            f"{row['standard_deviation']:.2g}",
            f"{low:.6g} to {high:.6g}",
        )
        more = (
            pretty(result.parameters[key].unit),
            f"{row['autocorrelation_time']:.0f}",
            f"{row['effective_sample_size']:.0f}",
        )
        rows.append((parameter_name(key).words, *cells, *more))
    heads = (
        "mean",
        "standard deviation",
        "95 % credible interval",
        "unit",
        "autocorrelation time",
        "effective draws",
    )
    columns_ = (Column("parameter"), *columns(*heads, kind="number"))
    return on_console(Table(columns_, tuple(rows), title="Posterior distribution"))
