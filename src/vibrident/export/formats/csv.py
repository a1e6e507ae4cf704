"""Write all numbers of a result that fit a table as CSV, unrounded, with uncertainties."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from vibrident.base.escaping import csv_cell
from vibrident.export.form import Format, Options
from vibrident.export.sensor import ExportedSensor
from vibrident.result import Curve, Result
from vibrident.show.numbers import per_unit

#: Field of a curve → heading; ``per``: its unit.
_COLUMNS = {
    "frequency_hz": "frequency_hz",
    "magnitude": "magnitude ({per})",
    "phase_deg": "phase_deg (lag negative)",
    "magnitude_uncertainty": "magnitude_standard_uncertainty ({per})",
    "phase_deg_uncertainty": "phase_standard_uncertainty_deg",
}
#: Field of the measured curve alone → heading.
_MEASURED_COLUMNS = {
    "deviation_percent": "model_deviation_percent",
    "deviation_phase_deg": "model_deviation_phase_deg",
    "record": "record",
    "magnitude_noise": "magnitude_noise ({per})",
    "phase_deg_noise": "phase_noise_deg",
    "deviation_uncertainty_percent": "model_deviation_standard_uncertainty_percent",
    "deviation_phase_uncertainty_deg": "model_deviation_phase_standard_uncertainty_deg",
}
#: Part of a source of the points' budget → heading.
_U_HEADINGS = {"magnitude": "u ({per})", "phase_deg": "u (deg)"}


def write(sensor: ExportedSensor, folder: Path, options: Options) -> list[Path]:
    """Write a file for each of :func:`sheets`: ``NAME_parameters.csv`` and so on."""
    return [
        _write_table(folder / f"{options.name}_{name}.csv", *sheet)
        for name, sheet in sheets(sensor.result).items()
    ]


Sheet = tuple[Sequence[str], Sequence[Sequence[object]]]  # a heading for each column, and the rows


def sheets(result: Result) -> dict[str, Sheet]:
    """Return the tables of a result by name; levels in dB and budgets only if it has any."""
    per = f"{result.response_unit} per {per_unit(result)}"
    tables: dict[str, Sheet] = {
        "parameters": _parameters(result),
        "correlation": _correlation(result),
        "response": _curve(result.response, _COLUMNS, per),
        "measured": _curve(result.measured, _COLUMNS | _MEASURED_COLUMNS, per),
    }
    if result.measured.frequency_hz.size:
        tables["level"] = _level(result, per)
    rows = result.settings.get("uncertainty_budget") or ()
    if budget := [row for row in rows if isinstance(row, Mapping)]:
        tables["budget"] = _budget(budget)
    points = result.settings.get("point_budget")
    if isinstance(points, Mapping):
        tables["point_budget"] = _point_budget(points, per)
    return tables


def _parameters(result: Result) -> Sheet:
    head = (
        "parameter",
        "value",
        "unit",
        "standard_uncertainty",
        "low_95",
        "high_95",
        "identifiable",
        "derived",
    )
    rows: list[Sequence[object]] = [
        (
            name,
            p.value,
            p.unit,
            p.standard_uncertainty,
            *p.interval_95,
            _yes_or_no(p.identifiable),
            _yes_or_no(p.derived),
        )
        for name, p in result.parameters.items()
    ]
    return head, rows


def _correlation(result: Result) -> Sheet:
    names = result.correlation.names
    rows = [(name, *row) for name, row in zip(names, result.correlation.matrix, strict=True)]
    return ("parameter", *names), rows


def _curve(curve: Curve, columns: Mapping[str, str], per: str) -> Sheet:
    """Return the columns of a curve, filled up to the number of its frequencies."""
    count = len(curve.frequency_hz)
    values = [_pad(getattr(curve, field), count) for field in columns]
    return [heading.format(per=per) for heading in columns.values()], list(
        zip(*values, strict=True)
    )


def _budget(budget: Sequence[Mapping[str, Any]]) -> Sheet:
    """Return a row for each source: what it is, and its contribution to each parameter."""
    fields = ("source", "type", "kind", "standard_uncertainty", "unit", "degrees_of_freedom")
    names = list(dict.fromkeys(name for row in budget for name in row.get("contributions") or ()))
    rows = [(*map(row.get, fields), *map(row["contributions"].get, names)) for row in budget]
    return (*fields, *names), rows


def _point_budget(points: Mapping[str, Any], per: str) -> Sheet:
    """Return a row for each measured point: its frequency, and the parts of each source."""
    heads = ["frequency_hz"]
    columns = [points["frequency_hz"]]
    for source in points["sources"]:
        for key, heading in _U_HEADINGS.items():
            heads.append(f"{heading} of {source['source']}".format(per=per))
            columns.append(source[key])
    return heads, list(zip(*columns, strict=True))


def _level(result: Result, per: str) -> Sheet:
    """Return measured points and the model in dB: 20 lg of the magnitude over one unit."""
    points = result.measured
    decibel = 20.0 / math.log(10.0)
    rows = []
    for f, magnitude, u, deviation in zip(
        points.frequency_hz,
        points.magnitude,
        points.magnitude_uncertainty,
        points.deviation_percent,
        strict=True,
    ):
        levels = (math.nan, math.nan, math.nan)
        if magnitude > 0 and deviation > -100.0:
            levels = (
                math.log(magnitude) * decibel,
                u / magnitude * decibel,
                math.log1p(deviation / 100.0) * decibel,
            )
        rows.append([None if math.isnan(v) else float(v) for v in (f, *levels)])
    heads = (
        "frequency_hz",
        f"level_db (re 1 {per})",
        "standard_uncertainty_db",
        "model_deviation_db",
    )
    return heads, rows


def _pad(values: Sequence[object], size: int) -> Sequence[object]:
    if len(values) != size:
        return (None,) * size
    return [None if isinstance(v, float) and math.isnan(v) else v for v in values]


def _yes_or_no(value: bool) -> str:
    return "yes" if value else "no"


def _write_table(path: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> Path:
    """Write a table; floats by ``repr``, which reads back to the same number; blank if absent."""
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([csv_cell(name) for name in header])
        writer.writerows([_cell(v) for v in row] for row in rows)
    return path


def _cell(value: object) -> str:
    if value is None:
        return ""
    return repr(float(value)) if isinstance(value, float) else csv_cell(value)


CSV = Format(
    name="csv",
    title="tables of all numbers",
    write=write,
    contents=(
        "parameters, u, intervals, correlation, curve and measured points with u, levels in dB, "
        "budgets"
    ),
    cannot_hold="settings, fit metrics",
)
