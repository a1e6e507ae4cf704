"""A complete Markdown report from a result alone."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

from vibrident.escaping import markdown, markdown_paragraph
from vibrident.plots import applicable
from vibrident.plots.units import sensor_name
from vibrident.report import tables, words
from vibrident.report.history import drift_table, histories
from vibrident.report.light import light
from vibrident.report.side_by_side import comparison_tables
from vibrident.result import Result

_CAPTIONS = {
    "sensitivity": "Sensitivity over frequency, model and measurement, with U (k = 2)",
    "deviation": "Deviation of the model from the measurement, with U (k = 2)",
    "signals": "Measured and predicted response in time, residual underneath",
    "residuals": "Residuals by record or frequency, and their distribution",
    "training": "Loss and parameters by iteration",
}


def render(
    result: Result,
    pictures: str | os.PathLike[str] | None = None,
    relative_to: str | os.PathLike[str] | None = None,
) -> str:
    """Write the report as Markdown text (GitHub tables).

    Args:
        result: any result.
        pictures: folder in which ``plots.save_all`` has drawn; the pictures found there are linked.
        relative_to: folder in which the report will lie, for the links; by default the folder of pictures.

    Returns:
        the text, ending in a line end.
    """
    links = _links(result, pictures, relative_to)
    parts = [
        _head(result),
        _tabled("Parameters", tables.parameters(result)),
        links.get("sensitivity"),
        _tabled("Correlation of the estimated parameters", tables.correlation(result)),
        _tabled("Fit", tables.fit(result)),
        *(links[name] for name in ("signals", "residuals") if name in links),
        _tabled("Measured points and the model", tables.measured(result)),
        links.get("deviation"),
        _tabled("Interferometer", light(result)),
        _warnings(result),
        _section("Training", markdown_paragraph(tables.training(result))),
        links.get("training"),
        _tabled("Weights of the network", tables.weights(result)),
        _section("Stated for a certificate", _tree(result.certificate)),
        _section("Settings", _tree({k: v for k, v in result.settings.items() if k != "interferometer"})),
        _section("Provenance", _tree(result.provenance)),
    ]
    return "\n\n".join(part.strip("\n") for part in parts if part) + "\n"


def render_comparison(results: Sequence[Result], names: Sequence[str]) -> str:
    """Write several results side by side as Markdown text, with the drift of each sensor calibrated more than once."""
    parts = [f"# Comparison of {len(results)} calibrations"]
    for history in histories(results, names):
        parts.append(_tabled(f"Drift of {markdown(history.sensor)}", drift_table(history)))
    parts += [_tabled(markdown(title), table) for title, table in comparison_tables(results, names)]
    return "\n\n".join(parts) + "\n"


def _links(
    result: Result, pictures: str | os.PathLike[str] | None, relative_to: str | os.PathLike[str] | None
) -> dict[str, str]:
    if pictures is None:
        return {}
    base = Path(pictures if relative_to is None else relative_to)
    found = {}
    for name in applicable(result):  # not what an earlier result left there
        files = (Path(pictures) / f"{name}.{suffix}" for suffix in ("svg", "png"))
        file = next((file for file in files if file.is_file()), None)
        if file is not None:
            link = Path(os.path.relpath(file, base)).as_posix()
            found[name] = f"![{_CAPTIONS[name]}](<{quote(link)}>)\n\n*{_CAPTIONS[name]}.*"
    return found


def _section(title: str, body: str) -> str:
    return f"## {title}\n\n{body}" if body else ""


def _tabled(title: str, table: tables.Table | None) -> str:
    if table is None:
        return ""
    body = _table(table.header, table.rows, table.right)
    return _section(
        title, "\n\n".join((*map(markdown_paragraph, table.lead), body, *map(markdown_paragraph, table.notes)))
    )


def _table(header: Sequence[str], rows: Iterable[Sequence[str]], right: Iterable[int] = ()) -> str:
    numbers = set(right)
    rule = ["---:" if i in numbers else "---" for i in range(len(header))]
    return "\n".join(f"| {' | '.join(markdown(c) for c in row)} |" for row in (header, rule, *rows))


def _head(result: Result) -> str:
    name = sensor_name(result.sensor)
    adequate = "adequate" if result.fit.adequate else "**not adequate**"
    doubts = f"{tables.count(len(result.warnings), 'warning')}, explained below" if result.warnings else "no warnings"
    title = f"# Calibration of {markdown(name)}" if name else "# Calibration"
    return f"{title}\n\nThe model is {adequate} for these data; {doubts}.\n\n{_table(('', ''), tables.facts(result))}"


def _warnings(result: Result) -> str:
    if not result.warnings:
        return _section("Warnings", "None.")
    parts = []
    for code in result.warning_codes:
        explained = words.explain(code)
        messages = [f"> {markdown_paragraph(w.message)}" for w in result.warnings if w.code == code]
        parts.append(
            f"### {explained.title[:1].upper()}{explained.title[1:]} (`{code}`)\n\n"
            + "\n>\n".join(messages)
            + f"\n\n{explained.meaning}\n\n**What to do:** {explained.action}"
        )
    return _section("Warnings", "\n\n".join(parts))


def _tree(values: Any, depth: int = 0) -> str:
    """Nested settings as nested bullets."""
    lines = []
    pairs = values.items() if isinstance(values, Mapping) else enumerate(values, 1)
    for key, value in pairs:
        bullet = f"{'  ' * depth}- {markdown_paragraph(str(key).replace('_', ' '))}:"
        if isinstance(value, (Mapping, list, tuple)) and value:
            if isinstance(value, (list, tuple)) and not any(isinstance(v, (Mapping, list, tuple)) for v in value):
                lines.append(f"{bullet} {markdown(', '.join(tables.leaf(v) for v in value))}")
            else:
                lines += [bullet, _tree(value, depth + 1)]
        else:
            lines.append(f"{bullet} {markdown(tables.leaf(value))}")
    return "\n".join(lines)
