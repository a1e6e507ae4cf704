"""Units of the columns of a response table: what the file states is applied, or refused.

Its factor leads to the response's unit per SI unit of the reference, to Hz and to rad; the scales
of [response] and [reference] multiply what is left.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from vibrident.data.io.calibration_file import CalibrationFile, TableSection
from vibrident.data.io.table_column import RELATIVE_UNITS, TableColumn
from vibrident.data.io.table_ratio import (
    quantity_per,
    response_label,
    sensitivity_factor,
    sensitivity_unit,
)
from vibrident.data.io.units import (
    MAX_NAME_LENGTH,
    PLAIN_BRACKETS,
    Unit,
    is_row_counter,
    parse_unit,
    split_unit,
)
from vibrident.data.records import FloatArray

_HERTZ = (("s", -1),)
_RADIANS_PER_SECOND = (("rad", 1), ("s", -1))
_RADIAN = (("rad", 1),)
_OMEGA = re.compile(r"omega|ω|w|kreisfrequenz|angular frequency", re.IGNORECASE)
_CYCLES = re.compile(r"hz|hertz|rpm|min", re.IGNORECASE)
_PARTS_OF_A_TURN = re.compile(r"cycles?|turns?|rev(olutions?)?|.*(π|\bpi\b).*", re.IGNORECASE)
#: Gon in most languages; German for degrees, which as a noun has a capital.
_DEGREES_OR_GON = ("grad", "grads", "GRAD")
_COVERAGE = re.compile(r"\bk\s*=\s*(\d+(?:[.,]\d+)?)", re.IGNORECASE)
_EXPANDED = re.compile(
    r"expanded|erweitert\w*|élargie|\bU_?95\b|расширенн\w*|扩展不确定度", re.IGNORECASE
)
_RELATIVE = re.compile(r"(?<![^\W_])rel(?:ative?|ativ)?(?![^\W_])", re.IGNORECASE)


@dataclass(frozen=True)
class ColumnConversion:
    """Conversion of the numbers of a column to the unit of the table, before ``scale``."""

    factor: float = 1.0
    #: level: in dB re ``factor``, 20 lg; relative: to the value that an uncertainty belongs to
    kind: Literal["linear", "level", "relative"] = "linear"
    unit: str = ""  # that is stated; "" for none

    def of_values(self, values: FloatArray) -> FloatArray:
        """Return values in the table's unit; infinite where a level is beyond all numbers."""
        if self.kind == "linear":
            return values * self.factor
        with np.errstate(all="ignore"):
            return 10.0 ** (values / 20.0) * self.factor

    def of_uncertainties(self, values: FloatArray, sizes: FloatArray, scale: float) -> FloatArray:
        """Return standard uncertainties in the unit of ``sizes``, the scaled values."""
        if self.kind == "linear":
            return values * (self.factor * scale)
        per_size = math.log(10.0) / 20.0 if self.kind == "level" else self.factor
        return values * per_size * np.abs(sizes)


def stated_sensitivity(column: TableColumn) -> tuple[str, str]:
    """Return the unit of the response and the quantity that a sensitivity's unit names.

    The unit is V for multiples of V, else as stated. "" for what is not stated.
    """
    level = column.level()
    text = level.unit if level else sensitivity_unit(column)
    label = response_label(text)
    return label, quantity_per(text, label)


def frequency_conversion(column: TableColumn) -> ColumnConversion:
    """Return the conversion of frequencies to Hz; InputError for a unit of another kind.

    Without a unit they are in Hz; "omega" is in rad/s.
    """
    is_angular = _OMEGA.fullmatch(split_unit(column.name)[0]) is not None
    for text, is_sure in column.units():
        parsed = parse_unit(text)
        if text == "mhz":
            raise column.refused("Hz", text, "write mHz or MHz in its place")
        if parsed is not None and parsed.dimension in (_HERTZ, _RADIANS_PER_SECOND):
            in_radians = parsed.dimension == _RADIANS_PER_SECOND or (
                is_angular and not _CYCLES.search(text)
            )
            return ColumnConversion(parsed.factor / (2 * math.pi if in_radians else 1.0), unit=text)
        if is_sure and ((parsed is not None and parsed.dimension) or is_row_counter(text)):
            remedy = "write the frequencies in Hz, and Hz into the header"
            raise column.refused("Hz, or a multiple of it", text, remedy)
    return (
        ColumnConversion(0.5 / math.pi, unit="rad/s, by its name")
        if is_angular
        else ColumnConversion()
    )


def phase_conversion(
    column: TableColumn, section: TableSection, phase: ColumnConversion | None = None
) -> ColumnConversion:
    """Return the conversion of phases, or of their uncertainties, to rad.

    ``phase``: for uncertainties, the conversion of the phase, if a column holds it. It holds where
    the file states no unit; else phase_unit does.

    Raises:
        InputError: the file states another unit than phase_unit, or one that is no angle.
    """
    phase_unit = section.phase_unit if "phase_unit" in section.model_fields_set else ""
    text, parsed = _angle(column, phase_unit)
    if parsed is None:
        degrees = section.phase_unit == "deg"
        return phase or ColumnConversion(math.pi / 180 if degrees else 1.0, unit=phase_unit)
    if column.key == "phase" and phase_unit and parse_unit(phase_unit) != parsed:
        remedy = "remove phase_unit, or correct the header"
        raise column.refused(f'phase_unit = "{phase_unit}"', text, remedy)
    if phase is not None and not phase.unit and parsed.factor != phase.factor:
        remedy = 'state phase_unit = "deg" or "rad", the unit of the phase'
        raise column.refused("the unit of the phase, which nothing states", text, remedy)
    return ColumnConversion(parsed.factor, unit=text)


def _angle(column: TableColumn, phase_unit: str) -> tuple[str, Unit | None]:
    """Return the unit of an angle that the file states, and its meaning; "" and None for none."""
    for text, is_sure in column.units():
        if text in _DEGREES_OR_GON:
            if phase_unit:
                return phase_unit, parse_unit(phase_unit)
            remedy = "state phase_unit, or write deg or gon into the header"
            raise column.refused("an angle in deg or rad", text, remedy)
        parsed = parse_unit("deg" if text == "Grad" else text.rstrip("."))
        if parsed is not None and parsed.dimension == _RADIAN:
            return text, parsed
        if is_sure and (parsed is not None or _PARTS_OF_A_TURN.fullmatch(text)):
            remedy = "convert it to deg or rad; and correct the header"
            raise column.refused("an angle in deg or rad", text, remedy)
    return "", None


def sensitivity_conversion(column: TableColumn, calibration: CalibrationFile) -> ColumnConversion:
    """Return the conversion of a magnitude, real or imaginary part.

    It leads to the response's unit per SI unit of the reference; InputError for a contradiction.
    """
    section = calibration.table
    assert section is not None
    level = column.level()
    if level is None:
        text = sensitivity_unit(column)
        if text.lower() in RELATIVE_UNITS:
            remedy = "give it in the unit of the response, not relative; and correct the header"
            raise column.refused("a magnitude in its unit", text, remedy)
        if text and section.magnitude_unit == "dB":
            remedy = "remove magnitude_unit, or correct the header"
            raise column.refused('a level, for magnitude_unit = "dB"', text, remedy)
        factor = sensitivity_factor(column, text, calibration)
        if section.magnitude_unit == "dB":
            return ColumnConversion(factor, "level", "dB")
        return ColumnConversion(factor, unit=text)
    if column.key != "magnitude":
        raise column.refused(
            "a linear part of the response", level.text, "correct the header, or use magnitude"
        )
    factor = level.number * sensitivity_factor(column, level.unit, calibration)
    return ColumnConversion(factor, "level", level.text)


def uncertainty_conversion(
    column: TableColumn, calibration: CalibrationFile, of: ColumnConversion
) -> ColumnConversion:
    """Return the conversion of standard uncertainties of values that have the conversion ``of``.

    In %, ppm and dB they are relative; without a unit they have that of the values.
    """
    assert calibration.table is not None
    require_coverage(column, calibration.table.coverage_factor)
    if level := column.level():
        return ColumnConversion(1.0, "level", level.text)
    text = sensitivity_unit(column)
    if text.lower() in RELATIVE_UNITS:
        return ColumnConversion(RELATIVE_UNITS[text.lower()], "relative", text)
    if text:
        conversion = ColumnConversion(sensitivity_factor(column, text, calibration), unit=text)
        require_same_unit(column, conversion, of)
        return conversion
    if word := _RELATIVE.search(column.name):
        remedy = "write (%) or (ppm) behind its name, or multiply it by the value and rename it"
        raise column.refused("an uncertainty with its unit", word.group(0), remedy)
    return replace(of, unit="" if of.kind == "linear" else of.unit)


def require_same_unit(
    column: TableColumn, conversion: ColumnConversion, of: ColumnConversion
) -> None:
    """Refuse a unit with another factor than that of values whose unit nothing states."""
    if conversion.unit and not of.unit and conversion.factor != of.factor:
        remedy = "write the unit of the response's column into its header, too"
        raise column.refused("a response with its unit", conversion.unit, remedy)


def require_coverage(column: TableColumn, expected: float) -> None:
    """Refuse uncertainties of another coverage factor than the one that is stated.

    A header that says "expanded" alone fits any factor but 1.
    """
    name = column.header[: 2 * MAX_NAME_LENGTH].translate(PLAIN_BRACKETS)
    factor = _COVERAGE.search(name)
    expanded = _EXPANDED.search(name)
    if factor is not None and float(factor.group(1).replace(",", ".")) != expected:
        coverage = f"k = {factor.group(1)}"
        number = factor.group(1)
    elif factor is None and expanded is not None and expected == 1.0:
        coverage = expanded.group(0)
        number = "k"
    else:
        return
    remedy = f"state coverage_factor = {number}; or divide it by {number}, and correct the header"
    raise column.refused(f"uncertainties of k = {expected:g}", coverage, remedy)
