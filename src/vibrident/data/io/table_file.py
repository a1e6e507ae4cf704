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
    source = open_columns(path)
    positions = _positions(section, source)
    conversions = _conversions(calibration, source, positions)
    columns, skipped_rows = _load(section, source, positions)
    values = {
        key: conversions[key].of_values(columns[key]) * (scale if key in _RESPONSE else 1.0)
        for key in ("frequency", "phase", *_RESPONSE)
        if key in columns
    }
    size_key = "magnitude"
    label = size_key
    if "real" in values:
        values["magnitude"] = np.hypot(values["real"], values["imaginary"])
        values["phase"] = np.arctan2(values["imaginary"], values["real"])
        size_key = "real"
        label = "the magnitude of real and imaginary part"
    _require_positive(
        label, values["magnitude"], columns[size_key], source, positions[size_key], skipped_rows
    )
    magnitude_u, phase_u = _uncertainties(columns, values, conversions, abs(scale))
    if magnitude_u is not None:
        magnitude_u = magnitude_u / section.coverage_factor
    if phase_u is not None:
        phase_u = phase_u / section.coverage_factor
    history = _history(calibration, source, positions, conversions)
    if skipped_rows:
        history.append(f"left out: {skipped_rows} row at 0 Hz")
    table = ResponseTable(
        frequency_hz=values["frequency"],
        magnitude=values["magnitude"],
        phase_rad=values.get("phase"),
        magnitude_uncertainty=magnitude_u,
        phase_uncertainty_rad=phase_u,
        provenance=Provenance(section.file, sha256(path), tuple(history)),
    )
    return table if section.band_hz is None else table.within(section.band_hz)


def _uncertainties(
    columns: Mapping[str, FloatArray],
    values: Mapping[str, FloatArray],
    conversions: Mapping[str, ColumnConversion],
    scale: float,
) -> tuple[FloatArray | None, FloatArray | None]:
    """Return the uncertainties of magnitude and phase (rad); None where the file states none.

    Args:
        columns: key → numbers of the file.
        values: key → converted and scaled values.
        conversions: key → conversion of the file's numbers.
        scale: size of the factor on the response.
    """
    deviations = {
        key: conversions[key].of_uncertainties(
            columns[key], values[key.removesuffix("_uncertainty")], scale
        )
        for key in _DEVIATIONS
        if key in columns
    }
    if "real_uncertainty" in deviations:
        real_u = deviations["real_uncertainty"]
        return _polar_uncertainties(values, real_u, deviations["imaginary_uncertainty"])
    phase_u = None
    if "phase_uncertainty" in columns:
        phase_u = conversions["phase_uncertainty"].of_values(columns["phase_uncertainty"])
    return deviations.get("magnitude_uncertainty"), phase_u


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


def _positions(section: TableSection, source: ColumnFile) -> dict[str, int]:
    """Return the position of each column that the section names."""
    columns = {key: getattr(section, key) for key in _KEYS}
    names = {key: f"[table] {key}" for key in _KEYS}
    if section.complex is not None:
        components = {"real": "real", "imaginary": "imag", "frequency": "frequency"}
        for key, component in components.items():
            if columns[key] is None:
                columns[key] = f"{section.complex}.{component}"
                names[key] = "[table] complex"
        _require_complex(section, source)
    return {
        key: source.position_of(column, names[key])
        for key, column in columns.items()
        if column is not None
    }


def _require_complex(section: TableSection, source: ColumnFile) -> None:
    """Refuse a name that is not of a complex array, and an array without an axis of its own."""
    name = str(section.complex).strip("/ ")
    where = f"{source.file}, asked for by [table] complex"
    if f"{name}.real" not in source.names:
        arrays = [each.removesuffix(".real") for each in source.names if each.endswith(".real")]
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
    calibration: CalibrationFile, source: ColumnFile, positions: Mapping[str, int]
) -> dict[str, ColumnConversion]:
    """Return what leads from the numbers of each column to the table's units."""
    section = calibration.table
    assert section is not None
    columns = {key: TableColumn(source, position, key) for key, position in positions.items()}
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
    section: TableSection, source: ColumnFile, positions: Mapping[str, int]
) -> tuple[dict[str, FloatArray], int]:
    """Return the checked columns, and how many rows at 0 Hz were left out of a file's own axis."""
    columns = dict(zip(positions, source.load(tuple(positions.values())), strict=True))
    lengths = {key: values.size for key, values in columns.items()}
    if len(set(lengths.values())) > 1:
        raise InputError(
            "The columns of the table differ in length.",
            expected="as many values in each",
            found=", ".join(f"{key} {length}" for key, length in lengths.items()),
            where=source.file,
            remedy="give every column the same number of values",
        )
    own_axis = section.complex is not None and section.frequency is None
    skipped = int(own_axis and lengths["frequency"] > 1 and columns["frequency"][0] == 0.0)
    columns = {key: values[skipped:] for key, values in columns.items()}
    for key, values in columns.items():
        source.require_finite(positions[key], values, skipped, "repair or remove that row")
        if key not in _SIGNED and key != "magnitude":
            _require_positive(key, values, values, source, positions[key], skipped)
    return columns, skipped


def _require_positive(
    key: str,
    values: FloatArray,
    file_values: FloatArray,
    source: ColumnFile,
    position: int,
    first_row: int,
) -> None:
    """Refuse a value that is not above zero, or too large to be a number."""
    bad = np.flatnonzero((values <= 0) | ~np.isfinite(values))
    if bad.size:
        is_large = bool(np.isinf(values[bad[0]]))
        raise InputError(
            f"A value of {key} is {'too large' if is_large else 'not above zero'}.",
            expected="numbers above 0"
            + ('; for dB state magnitude_unit = "dB"' if key == "magnitude" else ""),
            found=repr(float(file_values[bad[0]])),
            where=source.locate(position, first_row + int(bad[0])),
            remedy="repair or remove that row",
        )


def _polar_uncertainties(
    values: Mapping[str, FloatArray], real_u: FloatArray, imaginary_u: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the standard uncertainties of magnitude and phase, to first order (GUM 5.1.2).

    Real and imaginary part are taken as uncorrelated.
    """
    magnitude = values["magnitude"]
    cosine = values["real"] / magnitude
    sine = values["imaginary"] / magnitude
    along = np.hypot(cosine * real_u, sine * imaginary_u)
    across = np.hypot(sine * real_u, cosine * imaginary_u)
    return along, across / magnitude


def _history(
    calibration: CalibrationFile,
    source: ColumnFile,
    positions: Mapping[str, int],
    conversions: Mapping[str, ColumnConversion],
) -> list[str]:
    """Return what was done with each column, in words."""
    scale = calibration.response.scale / calibration.reference.scale
    history = [
        f"{key}: column {position + 1} {source.names[position]!r}"
        for key, position in positions.items()
    ]
    unit = f"{calibration.response.unit} per unit of {calibration.reference.quantity}"
    for key in _RESPONSE:
        if key in conversions:
            conversion = conversions[key]
            step = f"{key} × {conversion.factor * scale!r} → {unit}"
            history.append(
                step + (f"; the file states {conversion.unit}" if conversion.unit else "")
            )
            if conversion.kind == "level":
                history.append(
                    f"{key} read in {conversion.unit}, 20 lg; re 1 unit where none is stated"
                )
    frequency = conversions["frequency"]
    if frequency.factor != 1.0:
        history.append(f"frequency × {frequency.factor!r} → Hz; the file states {frequency.unit}")
    for key in ("phase", "phase_uncertainty"):
        if key in conversions:
            conversion = conversions[key]
            history.append(
                f"{key} read in {conversion.unit or 'deg, assumed: nothing states its unit'}"
            )
    for key in _DEVIATIONS:
        if key in conversions and conversions[key].kind != "linear":
            history.append(f"{key} read in {conversions[key].unit}, relative")
    if "real_uncertainty" in conversions:
        history.append(
            "real and imaginary part taken as uncorrelated: their covariance is neglected"
        )
    return history
