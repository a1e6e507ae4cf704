"""From the [table] section to a ResponseTable."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.io.calibration_file import CalibrationFile
from vibrident.data.io.columns import ColumnFile
from vibrident.data.io.old_units_tmp import (
    hertz_per_unit,
    require_magnitude_unit,
    require_phase_unit,
    require_response_unit,
    require_standard_uncertainty,
)
from vibrident.data.io.reader import open_columns, sha256
from vibrident.data.records import FloatArray, Provenance, ResponseTable

_KEYS = (
    "frequency",
    "magnitude",
    "phase",
    "magnitude_uncertainty",
    "phase_uncertainty",
)  # all positive but phase


def read_table(calibration: CalibrationFile, folder: Path, where: str) -> ResponseTable:
    """Read the tabulated response; InputError where a column is missing or holds a value that cannot be used.

    Magnitude and its uncertainty are multiplied by [response] scale and divided by [reference] scale: response unit
    per SI unit of the reference. Phase and its uncertainty become rad. Uncertainties are standard ones (k = 1) in the
    unit of their column.
    """
    section = calibration.table
    assert section is not None
    scale = calibration.response.scale / calibration.reference.scale
    if scale < 0:
        raise InputError(
            "The magnitude of a table cannot take a negative scale.",
            expected="[response] scale and [reference] scale of the same sign",
            found=f"{calibration.response.scale!r} and {calibration.reference.scale!r}",
            where=f"{where}, [response] scale",
            remedy="give the polarity as 180° in the phase column",
        )
    if section.phase_uncertainty is not None and section.phase is None:
        raise InputError(
            "There is an uncertainty of the phase but no phase.",
            expected="phase where phase_uncertainty is given",
            found="phase_uncertainty alone",
            where=f"{where}, [table]",
            remedy="add phase = …, or remove phase_uncertainty",
        )
    path = folder / section.file
    source = open_columns(path)
    wanted = {key: getattr(section, key) for key in _KEYS}
    positions = {
        key: source.position_of(column, f"[table] {key}")
        for key, column in wanted.items()
        if column is not None
    }
    _check_headers(calibration, source, positions)
    columns = dict(zip(positions, source.load(tuple(positions.values())), strict=True))
    if section.magnitude_unit == "dB":  # of levels and their standard uncertainties
        columns["magnitude"] = 10.0 ** (columns["magnitude"] / 20.0)
        if "magnitude_uncertainty" in columns:
            columns["magnitude_uncertainty"] = (
                columns["magnitude_uncertainty"] * columns["magnitude"] * np.log(10.0) / 20.0
            )
    for key, values in columns.items():
        _check(key, values, source, positions[key])
    lengths = {key: values.size for key, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise InputError(
            "The columns of the table differ in length.",
            expected="as many values in each",
            found=", ".join(f"{key} {length}" for key, length in lengths.items()),
            where=source.file,
            remedy="give every column the same number of values",
        )
    radians = np.pi / 180 if section.phase_unit == "deg" else 1.0
    history = [
        f"{key}: column {position + 1} {source.names[position]!r}"
        for key, position in positions.items()
    ]
    history.append(
        f"magnitude × {scale!r} → {calibration.response.unit} per unit of {calibration.reference.quantity}"
    )
    if section.magnitude_unit == "dB":
        history.append("magnitude read in dB re 1 unit of the column, 20 lg")
    if section.phase is not None:
        history.append(f"phase read in {section.phase_unit}")
    hertz = hertz_per_unit(source, positions["frequency"])
    if hertz != 1.0:
        history.append(f"frequency × {hertz!r} → Hz, by the header")
    return ResponseTable(
        frequency_hz=columns["frequency"] * hertz,
        magnitude=columns["magnitude"] * scale,
        phase_rad=_times(columns.get("phase"), radians),
        magnitude_uncertainty=_times(columns.get("magnitude_uncertainty"), scale),
        phase_uncertainty_rad=_times(columns.get("phase_uncertainty"), radians),
        provenance=Provenance(section.file, sha256(path), tuple(history)),
    )


def _check_headers(
    calibration: CalibrationFile, source: ColumnFile, positions: dict[str, int]
) -> None:
    """Check the units in the header against the calibration file; see header_units."""
    assert calibration.table is not None
    stated = {
        "unit": calibration.response.unit,
        "scale": calibration.response.scale / calibration.reference.scale,
        "quantity": calibration.reference.quantity,
    }
    for key, position in positions.items():
        if key.endswith("uncertainty"):
            require_standard_uncertainty(source, position, key)
        if key.startswith("phase"):
            require_phase_unit(source, position, key, calibration.table.phase_unit)
        elif key.startswith("magnitude") and calibration.table.magnitude_unit != "dB":
            require_magnitude_unit(source, position, key, **stated)
            if (
                "unit" in calibration.response.model_fields_set
                and calibration.reference.quantity != "drive"
            ):
                require_response_unit(
                    source, position, f"[table] {key}", stated["unit"], stated["scale"]
                )


def _times(values: FloatArray | None, factor: float) -> FloatArray | None:
    return None if values is None else values * factor


def _check(key: str, values: FloatArray, source: ColumnFile, position: int) -> None:
    source.require_finite(position, values, 0, "repair or remove that row")
    bad = np.flatnonzero(values <= 0)
    if key != "phase" and bad.size:
        raise InputError(
            f"A value of {key} is not above zero.",
            expected="numbers above 0"
            + ('; for dB state magnitude_unit = "dB"' if key == "magnitude" else ""),
            found=repr(float(values[bad[0]])),
            where=source.locate(position, int(bad[0])),
            remedy="repair or remove that row",
        )


def table_response_unit(document, source):
    from vibrident.data.io.old_units_tmp import unit_of_another_kind
    if abs(document.response.scale) != 1.0:
        return document.response.unit
    return unit_of_another_kind(source, source.position_of(document.table.magnitude, "[table] magnitude"), document.response.unit) or document.response.unit
