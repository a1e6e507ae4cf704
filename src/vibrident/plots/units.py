"""Units for print: superscripts, SI prefixes where they are natural, nominal names of one-third-octave frequencies."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from vibrident.nominal import nominal_value
from vibrident.records import REFERENCE_UNITS
from vibrident.result import Result

_PREFIXES = {-15: "f", -12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
_EXPONENTS = {prefix: exponent for exponent, prefix in _PREFIXES.items() if prefix} | {"u": -6, "μ": -6}

#: Powers of ten that engineers write before each unit: nobody says 475 mHz or km/s².
_NATURAL = {
    "V": (-9, 6),
    "A": (-12, 3),
    "C": (-15, 0),
    "s": (-12, 0),
    "m": (-12, 0),
    "Hz": (0, 9),
    "Pa": (-6, 9),
    "N": (-6, 6),
    "W": (-9, 6),
    "F": (-15, 0),
    "Ω": (-3, 9),
}
_SUPERSCRIPTS = str.maketrans("0123456789-+", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻⁺")


@dataclass(frozen=True)
class Scale:
    """Multiply by ``factor`` to get values in ``unit``, which is ready for print."""

    factor: float
    unit: str


def pretty(unit: str) -> str:
    """Write a unit with superscripts: ``m/s^2`` becomes ``m/s²``; no unit becomes ``1``."""
    text = re.sub(r"\^(?:\(([+-]?\d+)\)|([+-]?\d+))", _superscript, unit.strip())
    return text.replace("*", "·") or "1"


def _superscript(power: re.Match[str]) -> str:
    return (power.group(1) or power.group(2)).translate(_SUPERSCRIPTS)


def scaled(unit: str, size: float) -> Scale:
    """Choose the SI prefix that makes a number of about ``size`` (in ``unit``) read well.

    Args:
        unit: unit of the number, such as ``V/(m/s^2)``, ``s`` or ``1``; it may carry a prefix already.
        size: typical magnitude of the number; zero and values that are not finite leave the unit as it is.

    Returns:
        factor and unit; the factor is 1 where no prefix is natural for the unit.
    """
    lead = re.match(r"[A-Za-zµμΩ]+", unit)
    if lead is None or unit[lead.end() : lead.end() + 1] in ("^", "²", "³") or not math.isfinite(size) or size == 0:
        return Scale(1.0, pretty(unit))
    symbol, present = lead.group(), 0
    if symbol not in _NATURAL and symbol[:1] in _EXPONENTS:
        present, symbol = _EXPONENTS[symbol[0]], symbol[1:]
    if symbol not in _NATURAL:
        return Scale(1.0, pretty(unit))
    decade = math.floor(math.log10(abs(size)) + 1e-9) + present
    lowest, highest = _NATURAL[symbol]
    wanted = min(max(3 * math.floor(decade / 3), lowest), highest)
    if symbol == "Hz" and 0 <= decade < 4:  # 4096 Hz reads better than 4.096 kHz
        wanted = 0
    return Scale(10.0 ** (present - wanted), pretty(_PREFIXES[wanted] + symbol + unit[lead.end() :]))


def reference_unit(result: Result) -> str:
    """Unit of the reference channel, by its quantity where the result does not state it."""
    quantity = result.reference.get("quantity", "acceleration")
    return result.reference.get("unit") or REFERENCE_UNITS.get(quantity, "reference unit")


def sensitivity_unit(response_unit: str, per: str) -> str:
    """Unit of response per reference: ``V`` and ``m/s^2`` give ``V/(m/s^2)``."""
    top, bottom = (f"({unit})" if re.search(r"[/ *·]", unit) else unit for unit in (response_unit, per))
    return f"{top}/{bottom}"


def sensor_name(sensor: Mapping[str, object]) -> str:
    """Manufacturer, type and serial number of a sensor in one line; empty where none is stated."""
    parts = [str(sensor[key]) for key in ("manufacturer", "type") if sensor.get(key)]
    if sensor.get("serial_number"):
        parts.append(f"no. {sensor['serial_number']}")
    return " ".join(parts)


def nominal_frequency(frequency_hz: float) -> str | None:
    """Nominal ISO 266 name (Hz) of an exact base-10 one-third-octave frequency; None for any other frequency."""
    if not (math.isfinite(frequency_hz) and frequency_hz > 0):
        return None
    index = round(10 * math.log10(frequency_hz))
    if abs(frequency_hz / 10 ** (index / 10) - 1) > 5e-4:
        return None
    return f"{nominal_value(index):.6g}"


def frequency_text(frequency_hz: float) -> str:
    """A frequency for a heading: its nominal name where it has one, four digits otherwise; in Hz or kHz."""
    value = float(nominal_frequency(frequency_hz) or frequency_hz)
    scale = scaled("Hz", value)
    return f"{value * scale.factor:.4g} {scale.unit}" if value < 1e13 else f"{value:.3g} Hz"
