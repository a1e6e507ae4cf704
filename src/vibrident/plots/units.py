"""Units of a result for print, its sensor in a line, and nominal names of one-third-octave frequencies."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from vibrident.naming import scaled
from vibrident.nominal import nominal_value
from vibrident.records import REFERENCE_UNITS
from vibrident.result import Result


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
