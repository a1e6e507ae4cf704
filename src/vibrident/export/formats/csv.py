"""CSV: all numbers of the result that fit a table, with uncertainties, unrounded."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

from vibrident.escaping import csv_cell
from vibrident.export.form import Format
from vibrident.export.options import Options
from vibrident.export.sensor import ExportedSensor


def write(sensor: ExportedSensor, folder: Path, options: Options) -> list[Path]:
    """Write the tables ``NAME_parameters.csv``, ``…_correlation.csv``, ``…_response.csv`` and ``…_measured.csv``."""
    result = sensor.result
    parameters = (
        (name, p.value, p.unit, p.standard_uncertainty, *p.interval_95, _word(p.identifiable), _word(p.derived))
        for name, p in result.parameters.items()
    )
    correlation = result.correlation
    per = f"{result.response_unit} per {result.reference.get('unit', 'm/s^2')}"
    curve, measured = result.response, result.measured
    columns = (
        "frequency_hz",
        f"magnitude ({per})",
        "phase_deg (lag negative)",
        f"magnitude_standard_uncertainty ({per})",
        "phase_standard_uncertainty_deg",
    )
    further = (
        "model_deviation_percent",
        "model_deviation_phase_deg",
        "record",
        f"magnitude_noise ({per})",
        "phase_noise_deg",
        "model_deviation_standard_uncertainty_percent",
        "model_deviation_phase_standard_uncertainty_deg",
    )
    fields = ("frequency_hz", "magnitude", "phase_deg", "magnitude_uncertainty", "phase_deg_uncertainty")
    own = ("deviation_percent", "deviation_phase_deg", "record", "magnitude_noise", "phase_deg_noise")
    own += ("deviation_uncertainty_percent", "deviation_phase_uncertainty_deg")
    return [
        _table(
            folder / f"{options.name}_parameters.csv",
            ("parameter", "value", "unit", "standard_uncertainty", "low_95", "high_95", "identifiable", "derived"),
            parameters,
        ),
        _table(
            folder / f"{options.name}_correlation.csv",
            ("parameter", *correlation.names),
            ((name, *row) for name, row in zip(correlation.names, correlation.matrix, strict=True)),
        ),
        _table(
            folder / f"{options.name}_response.csv",
            columns,
            zip(*(_padded(getattr(curve, name), len(curve.frequency_hz)) for name in fields), strict=True),
        ),
        _table(
            folder / f"{options.name}_measured.csv",
            (*columns, *further),
            zip(
                *(_padded(getattr(measured, name), len(measured.frequency_hz)) for name in (*fields, *own)), strict=True
            ),
        ),
    ]


def _padded(values: Sequence[object], size: int) -> Sequence[object]:
    if len(values) != size:
        return (None,) * size
    return [None if isinstance(v, float) and math.isnan(v) else v for v in values]


def _word(value: bool) -> str:
    return "yes" if value else "no"


def _table(path: Path, header: Sequence[str], rows: Iterable[Sequence[object]]) -> Path:
    """Floats by ``repr``, which reads back to the same number; blank if absent."""
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
    holds="parameters, u, intervals, correlation, curve and measured points with u",
    cannot_hold="settings, fit metrics",
)
