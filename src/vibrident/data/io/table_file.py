"""Read the file of the [table] section into a ResponseTable."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from vibrident.base.errors import InputError, did_you_mean
from vibrident.data.io.calibration_file import CalibrationFile, TableSection
from vibrident.data.io.columns import ColumnFile
from vibrident.data.io.reader import open_columns, sha256
from vibrident.data.io.table_column import TableColumn
from vibrident.data.io.table_units import (
    ColumnConversion,
    frequency_conversion,
    phase_conversion,
    require_coverage,
    require_same_unit,
    sensitivity_conversion,
    stated_sensitivity,
    uncertainty_conversion,
)
from vibrident.data.records import FloatArray, Provenance, ResponseTable

_RESPONSE = ("magnitude", "real", "imaginary")
_DEVIATIONS = ("magnitude_uncertainty", "real_uncertainty", "imaginary_uncertainty")
_KEYS = ("frequency", *_RESPONSE, "phase", *_DEVIATIONS, "phase_uncertainty")
_SIGNED = ("phase", "real", "imaginary")


def read_table(calibration: CalibrationFile, folder: Path, where: str) -> ResponseTable:
    """Read the tabulated response; phases in rad, standard uncertainties (k = 1).

    Units of the file lead to the response's unit per SI unit of the reference; [response] scale
    multiplies and [reference] scale divides what is left.

    Raises:
        InputError: a column is missing, contradicts the calibration file, or holds a value that
            cannot be used.
    """
    section = calibration.table
    assert section is not None
    scale = calibration.response.scale / calibration.reference.scale
    if scale < 0 and section.magnitude is not None:
        raise InputError(
            "The magnitude of a table cannot take a negative scale.",
            expected="[response] scale and [reference] scale of the same sign",
            found=f"{calibration.response.scale!r} and {calibration.reference.scale!r}",
            where=f"{where}, [response] scale",
            remedy="give the polarity as 180° in the phase column",
        )
    path = folder / section.file
    columns = _columns(section, open_columns(path))
    conversions = _conversions(calibration, columns)
    numbers, skipped_rows = _load(section, columns)
    values = {
        key: conversions[key].of_values(numbers[key]) * (scale if key in _RESPONSE else 1.0)
        for key in ("frequency", "phase", *_RESPONSE)
        if key in numbers
    }
    size_key = "magnitude"
    label = size_key
    if "real" in values:
        values["magnitude"] = np.hypot(values["real"], values["imaginary"])
        values["phase"] = np.arctan2(values["imaginary"], values["real"])
        size_key = "real"
        label = "the magnitude of real and imaginary part"
    magnitude = values["magnitude"]
    _require_positive(label, magnitude, columns[size_key], numbers[size_key], skipped_rows)
    deviations = _uncertainties(numbers, values, conversions, abs(scale))
    history = _history(calibration, columns, conversions)
    if skipped_rows:
        history.append(f"left out: {skipped_rows} row at 0 Hz")
    table = ResponseTable(
        frequency_hz=values["frequency"],
        magnitude=magnitude,
        phase_rad=values.get("phase"),
        provenance=Provenance(section.file, sha256(path), tuple(history)),
        **{name: u / section.coverage_factor for name, u in deviations.items()},
    )
    return table if section.band_hz is None else table.within(section.band_hz)


def _uncertainties(
    numbers: Mapping[str, FloatArray],
    values: Mapping[str, FloatArray],
    conversions: Mapping[str, ColumnConversion],
    scale: float,
) -> dict[str, FloatArray]:
    """Return the uncertainties that the file states, by their names in a table.

    Those of real and imaginary part lead to those of magnitude and phase to first order (GUM
    5.1.2), as if they were uncorrelated.

    Args:
        numbers: key → numbers of the file.
        values: key → converted and scaled values.
        conversions: key → conversion of the file's numbers.
        scale: size of the factor on the response.
    """
    deviations = {
        key: conversions[key].of_uncertainties(
            numbers[key], values[key.removesuffix("_uncertainty")], scale
        )
        for key in _DEVIATIONS
        if key in numbers
    }
    if "real_uncertainty" in deviations:
        magnitude = values["magnitude"]
        cosine = values["real"] / magnitude
        sine = values["imaginary"] / magnitude
        real_u = deviations["real_uncertainty"]
        imaginary_u = deviations["imaginary_uncertainty"]
        across = np.hypot(sine * real_u, cosine * imaginary_u)
        return {
            "magnitude_uncertainty": np.hypot(cosine * real_u, sine * imaginary_u),
            "phase_uncertainty_rad": across / magnitude,
        }
    if "phase_uncertainty" in numbers:
        phase_u = conversions["phase_uncertainty"].of_values(numbers["phase_uncertainty"])
        deviations["phase_uncertainty_rad"] = phase_u
    return deviations


def table_response_unit(calibration: CalibrationFile, source: ColumnFile) -> str:
    """Return the unit of a table's response where [response] states none: the file's, else V.

    A scale leads from the file's to V. InputError where a unit of the file is not known.
    """
    assert calibration.table is not None
    if calibration.table.complex is not None:
        _require_complex(calibration.table, source)
    column, key = calibration.table.response_column
    position = source.position_of(column, key)
    label, _ = stated_sensitivity(TableColumn(source, position, key.removeprefix("[table] ")))
    is_scaled = abs(calibration.response.scale) != 1.0
    return calibration.response.unit if is_scaled else label or calibration.response.unit


def _columns(section: TableSection, source: ColumnFile) -> dict[str, TableColumn]:
    """Return each column that the section names, by its key."""
    columns: dict[str, TableColumn] = {}
    components = {}
    if section.complex is not None:
        components = {"real": "real", "imaginary": "imag", "frequency": "frequency"}
        _require_complex(section, source)
    for key in _KEYS:
        column = getattr(section, key)
        asking_key = key
        if column is None and key in components:
            column = f"{section.complex}.{components[key]}"
            asking_key = "complex"
        if column is not None:
            position = source.position_of(column, f"[table] {asking_key}")
            columns[key] = TableColumn(source, position, key)
    return columns


def _require_complex(section: TableSection, source: ColumnFile) -> None:
    """Refuse a name that is not of a complex array, and an array without an axis of its own."""
    name = str(section.complex).strip("/ ")
    where = f"{source.file}, asked for by [table] complex"
    if f"{name}.real" not in source.names:
        arrays = [
            array_name.removesuffix(".real")
            for array_name in source.names
            if array_name.endswith(".real")
        ]
        expected = "a complex array"
        remedy = "write its parts into two columns, and name them with real and imaginary"
        if arrays:
            expected = f"one of {', '.join(map(repr, arrays[:12]))}"
            remedy = did_you_mean(name, arrays, "give one of these names")
        raise InputError(
            "There is no complex array of that name.",
            expected=expected,
            found=f"{name!r}" + (", which is not complex" if name in source.names else ""),
            where=where,
            remedy=remedy,
        )
    if section.frequency is None and f"{name}.frequency" not in source.names:
        raise InputError(
            "The frequencies of the response are missing.",
            expected=f"frequency, as the file states none for {name!r}",
            found="nothing",
            where=where,
            remedy="add frequency = …, the column that holds them",
        )


def _conversions(
    calibration: CalibrationFile, columns: Mapping[str, TableColumn]
) -> dict[str, ColumnConversion]:
    """Return what leads from the numbers of each column to the table's units."""
    section = calibration.table
    assert section is not None
    conversions = {"frequency": frequency_conversion(columns["frequency"])}
    for key in _RESPONSE:
        if key in columns:
            conversions[key] = sensitivity_conversion(columns[key], calibration)
    if "real" in conversions:
        require_same_unit(columns["real"], conversions["real"], conversions["imaginary"])
        require_same_unit(columns["imaginary"], conversions["imaginary"], conversions["real"])
    if "phase" in columns:
        conversions["phase"] = phase_conversion(columns["phase"], section)
    for key in _DEVIATIONS:
        if key in columns:
            of = conversions.get(key.removesuffix("_uncertainty")) or conversions["real"]
            conversions[key] = uncertainty_conversion(columns[key], calibration, of)
    if "phase_uncertainty" in columns:
        column = columns["phase_uncertainty"]
        require_coverage(column, section.coverage_factor)
        conversions[column.key] = phase_conversion(column, section, conversions.get("phase"))
    return conversions


def _load(
    section: TableSection, columns: Mapping[str, TableColumn]
) -> tuple[dict[str, FloatArray], int]:
    """Return the checked numbers, and how many rows at 0 Hz were left out of a file's own axis."""
    source = columns["frequency"].source
    loaded = source.load([column.position for column in columns.values()])
    numbers = dict(zip(columns, loaded, strict=True))
    lengths = {key: values.size for key, values in numbers.items()}
    if len(set(lengths.values())) > 1:
        raise InputError(
            "The columns of the table differ in length.",
            expected="as many values in each",
            found=", ".join(f"{key} {length}" for key, length in lengths.items()),
            where=source.file,
            remedy="give every column the same number of values",
        )
    own_axis = section.complex is not None and section.frequency is None
    skipped = int(own_axis and lengths["frequency"] > 1 and numbers["frequency"][0] == 0.0)
    numbers = {key: values[skipped:] for key, values in numbers.items()}
    for key, values in numbers.items():
        position = columns[key].position
        source.require_finite(position, values, skipped, "repair or remove that row")
        if key not in _SIGNED and key != "magnitude":
            _require_positive(key, values, columns[key], values, skipped)
    return numbers, skipped


def _require_positive(
    label: str, values: FloatArray, column: TableColumn, numbers: FloatArray, first_row: int
) -> None:
    """Refuse a value that is not above zero, or too large to be a number.

    ``numbers``: of the file's column, from ``first_row`` on.
    """
    bad = np.flatnonzero((values <= 0) | ~np.isfinite(values))
    if bad.size:
        row = int(bad[0])
        raise InputError(
            f"A value of {label} is {'too large' if np.isinf(values[row]) else 'not above zero'}.",
            expected="numbers above 0"
            + ('; for dB state magnitude_unit = "dB"' if label == "magnitude" else ""),
            found=repr(float(numbers[row])),
            where=column.source.locate(column.position, first_row + row),
            remedy="repair or remove that row",
        )


def _history(
    calibration: CalibrationFile,
    columns: Mapping[str, TableColumn],
    conversions: Mapping[str, ColumnConversion],
) -> list[str]:
    """Return what was done with each column, in words."""
    scale = calibration.response.scale / calibration.reference.scale
    history = [
        f"{key}: column {column.position + 1} {column.source.names[column.position]!r}"
        for key, column in columns.items()
    ]
    unit = f"{calibration.response.unit} per unit of {calibration.reference.quantity}"
    for key, conversion in conversions.items():
        stated = conversion.unit
        if key in _RESPONSE:
            step = f"{key} × {conversion.factor * scale!r} → {unit}"
            history.append(f"{step}; the file states {stated}" if stated else step)
            if conversion.kind == "level":
                history.append(f"{key} read in {stated}, 20 lg; re 1 unit where none is stated")
        elif key == "frequency" and conversion.factor != 1.0:
            history.append(f"frequency × {conversion.factor!r} → Hz; the file states {stated}")
        elif key.startswith("phase"):
            history.append(f"{key} read in {stated or 'deg, assumed: nothing states its unit'}")
        elif key in _DEVIATIONS and conversion.kind != "linear":
            history.append(f"{key} read in {stated}, relative")
    if "real_uncertainty" in conversions:
        history.append(
            "real and imaginary part taken as uncorrelated: their covariance is neglected"
        )
    return history
