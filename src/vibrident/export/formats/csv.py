"""CSV: all numbers of the result that fit a table, with uncertainties, unrounded."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from vibrident.base.escaping import csv_cell
from vibrident.export.form import Format, Options
from vibrident.export.sensor import ExportedSensor
from vibrident.result import Result
from vibrident.show.numbers import per_unit

#: Field of a curve → heading; ``per``: its unit.
_COLUMNS = {
    "frequency_hz": "frequency_hz",
    "magnitude": "magnitude ({per})",
    "phase_deg": "phase_deg (lag negative)",
    "magnitude_uncertainty": "magnitude_standard_uncertainty ({per})",
    "phase_deg_uncertainty": "phase_standard_uncertainty_deg",
}
#: Of the measured one alone.
_MEASURED = {
    "deviation_percent": "model_deviation_percent",
    "deviation_phase_deg": "model_deviation_phase_deg",
    "record": "record",
    "magnitude_noise": "magnitude_noise ({per})",
    "phase_deg_noise": "phase_noise_deg",
    "deviation_uncertainty_percent": "model_deviation_standard_uncertainty_percent",
    "deviation_phase_uncertainty_deg": "model_deviation_phase_standard_uncertainty_deg",
}


def write(sensor: ExportedSensor, folder: Path, options: Options) -> list[Path]:
    """Write a table for each of :func:`sheets`, ``NAME_parameters.csv`` and so on."""
    return [
        _table(folder / f"{options.name}_{name}.csv", *table)
        for name, table in sheets(sensor.result).items()
    ]


Sheet = tuple[Sequence[str], Sequence[Sequence[object]]]  # a heading for each column, and the rows


def sheets(result: Result) -> dict[str, Sheet]:
    """Return the tables of a result by name, with its numbers.

    Levels in dB and budgets are there if the result has any.
    """
    rows: list[Sequence[object]] = [
        (
            name,
            p.value,
            p.unit,
            p.standard_uncertainty,
            *p.interval_95,
            _word(p.identifiable),
            _word(p.derived),
        )
        for name, p in result.parameters.items()
    ]
    correlation = result.correlation
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
    related = [
        (name, *row) for name, row in zip(correlation.names, correlation.matrix, strict=True)
    ]
    tables: dict[str, Sheet] = {
        "parameters": (head, rows),
        "correlation": (("parameter", *correlation.names), related),
    }
    per = f"{result.response_unit} per {per_unit(result)}"
    curves = (
        (result.response, "response", _COLUMNS),
        (result.measured, "measured", _COLUMNS | _MEASURED),
    )
    for curve, name, columns in curves:
        padded = (_padded(getattr(curve, field), len(curve.frequency_hz)) for field in columns)
        tables[name] = (
            [heading.format(per=per) for heading in columns.values()],
            list(zip(*padded, strict=True)),
        )
    if result.measured.frequency_hz.size:
        tables["level"] = _level(result, per)
    budget = [
        row for row in result.settings.get("uncertainty_budget") or () if isinstance(row, Mapping)
    ]
    if budget:
        names = list(
            dict.fromkeys(name for row in budget for name in row.get("contributions") or ())
        )
        fields = ("source", "type", "kind", "standard_uncertainty", "unit", "degrees_of_freedom")
        parts = [row["contributions"] for row in budget]
        lines = [
            (*map(row.get, fields), *map(part.get, names))
            for row, part in zip(budget, parts, strict=True)
        ]
        tables["budget"] = (*fields, *names), lines
    points = result.settings.get("point_budget")
    if isinstance(points, Mapping):
        columns_ = [points["frequency_hz"]] + [
            source[key] for source in points["sources"] for key in _PARTS
        ]
        heads = [
            f"{_PARTS[key]} of {source['source']}".format(per=per)
            for source in points["sources"]
            for key in _PARTS
        ]
        tables["point_budget"] = ["frequency_hz", *heads], list(zip(*columns_, strict=True))
    return tables


_PARTS = {"magnitude": "u ({per})", "phase_deg": "u (deg)"}


def _level(result: Result, per: str) -> Sheet:
    """Return measured points and the model in dB: 20 lg of the magnitude over one unit."""
    points = result.measured
    factor = 20.0 / math.log(10.0)
    rows = []
    for f, size, u, off in zip(
        points.frequency_hz,
        points.magnitude,
        points.magnitude_uncertainty,
        points.deviation_percent,
        strict=True,
    ):
        known = size > 0 and off > -100.0
        values = (
            (f, math.log(size) * factor, u / size * factor, math.log1p(off / 100.0) * factor)
            if known
            else (f,)
        )
        rows.append(
            [None if math.isnan(v) else float(v) for v in values] + [None] * (4 - len(values))
        )
    heads = (
        "frequency_hz",
        f"level_db (re 1 {per})",
        "standard_uncertainty_db",
        "model_deviation_db",
    )
    return heads, rows


def _padded(values: Sequence[object], size: int) -> Sequence[object]:
    if len(values) != size:
        return (None,) * size
    return [None if isinstance(v, float) and math.isnan(v) else v for v in values]


def _word(value: bool) -> str:
    return "yes" if value else "no"


def _table(path: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> Path:
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
