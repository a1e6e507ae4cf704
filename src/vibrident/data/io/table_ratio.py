"""The unit of a sensitivity, such as mV/g, and its factor.

The factor leads to the unit of the response per SI unit of the reference.
"""

from __future__ import annotations

from vibrident.base.errors import InputError
from vibrident.data.io.calibration_file import CalibrationFile
from vibrident.data.io.header_units import declared_factor, is_same_factor
from vibrident.data.io.table_column import RELATIVE_UNITS, TableColumn, per_unit_in
from vibrident.data.io.units import (
    PLAIN_BRACKETS,
    QUANTITY_UNITS,
    Unit,
    factor_between,
    parse_unit,
    quantity_of,
)
from vibrident.data.records import REFERENCE_UNITS, STANDARD_GRAVITY

_OUTPUTS = frozenset({"V", "A", "C", "counts"})  # of sensors
_NO_DIMENSION = Unit(1.0, ())


def sensitivity_unit(column: TableColumn) -> str:
    """Return the unit of a sensitivity, or of its uncertainty, as stated; "" for none known.

    Raises:
        InputError: a unit begins as one of a sensitivity and goes on as none that is known.
    """
    for text, is_sure in column.units():
        is_known = parse_unit(text) is not None or _quotient(text)[0] != ""
        first, slash, _ = text.replace(" ", "/").partition("/")
        if is_sure and is_known:
            return text
        if is_sure and slash and _output_of(first) and (first != "A" or "/" in text):
            remedy = "write a unit such as mV/g, pC/(m/s²) or V/(m/s) into the header"
            raise column.refused("a unit that is known", text, remedy)
        if not is_sure and is_known and " " not in text and _is_unit_of_sensitivity(text):
            return text
    return per_unit_in(column.name)


def _is_unit_of_sensitivity(text: str) -> bool:
    """Return whether a name, or the end of one, is such a unit: "mV/g", "mV", "%"."""
    is_prefixed = len(text) > 1 and text[0].islower()
    return (
        text.lower() in RELATIVE_UNITS
        or _output_of(_quotient(text)[0]) != ""
        or (is_prefixed and _output_of(text) != "" and text[1:] in _OUTPUTS)
    )


def response_label(text: str) -> str:
    """Return the unit of the response in that of a sensitivity; "" for none.

    It is V for multiples of V, else as stated.
    """
    numerator, _ = _quotient(text)
    plain = parse_unit(numerator or text)
    base = _output_of(text)
    if base == "V" or (plain is not None and plain.dimension == (("V", 1),)):
        return "V"
    if base:
        return (numerator or text) if plain and plain.dimension == ((base, 1),) else base
    return numerator or (text if quantity_of(text) else "")


def sensitivity_factor(column: TableColumn, text: str, calibration: CalibrationFile) -> float:
    """Return the factor from a unit to the response's unit per SI unit of the reference.

    ``text``: as the file states it; "" for none.

    Raises:
        InputError: the unit contradicts [response] or [reference], or a scale is that factor.
    """
    response = calibration.response
    reference = calibration.reference
    si = QUANTITY_UNITS.get(reference.quantity) or parse_unit(reference.unit)
    label = response_label(text)
    if not label and parse_unit(text) in (None, _NO_DIMENSION):
        return _factor_of_reference(column, text, calibration, None)
    is_scaled = abs(response.scale) != 1.0
    is_open = "unit" not in response.model_fields_set
    unit = label if is_open and not is_scaled and label else response.unit
    factor = _factor(text, unit, si)
    if factor is None:
        factor = _factor(text, label, si)
        if factor is None:
            raise _other_quantity_error(column, text, label or unit, calibration)
        if not is_scaled or (is_open and _output_of(label) != "counts"):
            raise column.refused(
                f"a multiple of {unit}, the unit of the response",
                text,
                f'set unit = "{label}" under [response]; or state unit there, and set scale to it '
                f"per {label}; or correct the header",
            )
    if quantity_of(text) == reference.quantity and parse_unit(text) != si:
        per = REFERENCE_UNITS[reference.quantity]
        remedy = f"write what it is per, too, such as {text}/({per}) or {text}/{text}"
        raise column.refused(f"a response per {reference.quantity}", text, remedy)
    _refuse_second_conversion(column, text, unit, factor, calibration)
    numerator, denominator = _quotient(text)
    is_ratio = factor_between(text, label or unit) is None or bool(numerator)
    return factor * _factor_of_reference(
        column, text, calibration, (denominator or si) if is_ratio else None
    )


def _quotient(text: str) -> tuple[str, Unit | None]:
    """Return the numerator of a quotient as text, and its denominator, of motion or of a drive.

    "" and None for a text that is no such quotient, as "V/m/s^2", which is not V/(m/s^2).
    """
    unit = parse_unit(text)
    text = text.strip().translate(PLAIN_BRACKETS).replace(" per ", "/")
    depth = 0
    for index, sign in enumerate(text):
        depth += (sign in "([") - (sign in ")]")
        if sign != "/" or depth:
            continue
        numerator = text[:index].strip()
        divisor = text[index + 1 :].strip()
        denominator = parse_unit(divisor)
        is_input = bool(quantity_of(divisor) or _output_of(divisor))
        if not numerator or denominator is None or not is_input:
            continue
        output = parse_unit(numerator)
        if unit is None or (output and output.over(denominator).dimension == unit.dimension):
            is_bracketed = numerator.startswith("(") and numerator.endswith(")")
            return (numerator[1:-1] if is_bracketed else numerator), denominator
    return "", None


def _output_of(text: str) -> str:
    """Return the electric base of a unit, alone or per motion; "" for another unit."""
    unit = parse_unit(text)
    if unit is None:
        return ""
    bases = [base for base, exponent in unit.dimension if base in _OUTPUTS and exponent == 1]
    other_bases = {base for base, _ in unit.dimension} - set(bases)
    return bases[0] if len(bases) == 1 and other_bases <= {"m", "s"} else ""


def _factor(text: str, unit: str, si: Unit | None) -> float | None:
    """Return the factor from a unit to ``unit`` per ``si``; None for another kind.

    ``si``: None for a drive whose unit is not known, which keeps the file's.
    """
    parsed = parse_unit(text)
    target = parse_unit(unit)
    numerator, denominator = _quotient(text)
    if parsed is None or target is None:
        if numerator != unit or denominator is None:
            return None
        if si is None:
            return 1.0
        is_same = denominator.dimension == si.dimension
        return si.factor / denominator.factor if is_same else None
    if parsed.dimension == target.dimension and not numerator:
        return parsed.factor / target.factor
    if si is None:
        return factor_between(numerator, unit)
    per_si = target.over(si)
    return parsed.factor / per_si.factor if parsed.dimension == per_si.dimension else None


def quantity_per(text: str, unit: str) -> str:
    """Return the quantity that ``text`` is a multiple of ``unit`` per; "" for none."""
    if factor_between(text, unit) is not None and not _quotient(text)[0]:
        return ""
    return next((q for q, si in QUANTITY_UNITS.items() if _factor(text, unit, si) is not None), "")


def _other_quantity_error(
    column: TableColumn, text: str, unit: str, calibration: CalibrationFile
) -> InputError:
    remedy = "name another column; or correct the header, to V/(m/s²) or the like"
    if quantity := quantity_per(text, unit):
        remedy = f'set [reference] quantity = "{quantity}", or correct the header'
    return column.refused(f"a response per {calibration.reference.quantity}", text, remedy)


def _refuse_second_conversion(
    column: TableColumn, text: str, unit: str, factor: float, calibration: CalibrationFile
) -> None:
    """Refuse a scale that is the unit's factor, or that of a part of it: it would convert twice."""
    response = calibration.response.scale
    reference = calibration.reference.scale
    si = QUANTITY_UNITS.get(calibration.reference.quantity)
    numerator, denominator = _quotient(text)
    conversions = [
        (response / reference, factor),
        (response, factor),
        (response, factor_between(numerator, unit)),
        (reference, denominator.factor / si.factor if denominator and si else None),
    ]
    if si is not None and factor_between(text, unit) is None:  # 9.81 has no other meaning
        conversions += [(reference, STANDARD_GRAVITY), (response, 1.0 / STANDARD_GRAVITY)]
    scales = {"[response]": response, "[reference]": reference}
    for scale, unit_factor in conversions:
        if unit_factor not in (None, 1.0) and is_same_factor(scale, unit_factor):
            keys = " and ".join(key for key, value in scales.items() if abs(value) != 1.0)
            raise column.refused(
                f"no scale {scale!r}: the unit of the file is converted already",
                text,
                f"remove scale under {keys}; or correct the header",
            )


def _factor_of_reference(
    column: TableColumn, text: str, calibration: CalibrationFile, denominator: Unit | None
) -> float:
    """Return the factor of [reference] unit, where it is not SI and the file states none.

    ``denominator``: what the file states that the response is per; None for nothing.
    """
    reference = calibration.reference
    factor = factor_between(reference.unit, REFERENCE_UNITS[reference.quantity])
    is_si = reference.quantity == "drive" or not reference.unit or factor == 1.0
    if denominator is None or is_si:
        return 1.0 / declared_factor(reference, column.source)
    if parse_unit(reference.unit) == denominator:
        return 1.0
    remedy = "remove unit under [reference], or correct the header"
    raise column.refused(f"a response per {reference.unit}", text, remedy)
