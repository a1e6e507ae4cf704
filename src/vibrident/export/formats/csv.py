"""CSV: all numbers of the result that fit a table, with uncertainties, unrounded."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

from vibrident.base.escaping import csv_cell
from vibrident.export.form import Format, Options
from vibrident.export.sensor import ExportedSensor

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
    """Write the tables ``NAME_parameters.csv``, ``…_correlation.csv``, ``…_response.csv`` and ``…_measured.csv``."""
    result = sensor.result
    parameters = (
        (name, p.value, p.unit, p.standard_uncertainty, *p.interval_95, _word(p.identifiable), _word(p.derived))
        for name, p in result.parameters.items()
    )
    correlation = result.correlation
    per = f"{result.response_unit} per {result.reference.get('unit', 'm/s^2')}"
    curves = [(result.response, "response", _COLUMNS), (result.measured, "measured", _COLUMNS | _MEASURED)]
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
        *(
            _table(
                folder / f"{options.name}_{name}.csv",
                [heading.format(per=per) for heading in columns.values()],
                zip(*(_padded(getattr(curve, field), len(curve.frequency_hz)) for field in columns), strict=True),
            )
            for curve, name, columns in curves
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
