"""Print numbers and units: GUM 7.2.6 (u to two significant digits), SI prefixes.

Every number that is shown anywhere is made here.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from typing import TypeGuard

from vibrident.base import amounts
from vibrident.base.amounts import NONE, PLAIN_DIGITS, SUPERSCRIPTS, UnitScale, pretty, scaled
from vibrident.base.nominal import is_same_frequency, nominal_name
from vibrident.data.records import REFERENCE_UNITS, FloatArray
from vibrident.result import Parameter, Result
from vibrident.show.views import K

#: The rounding of a relative difference of two floats, in percent.
_DUST_PERCENT = 100.0 * 4.0 * sys.float_info.epsilon
_MAX_DIGITS = 15  # digits of a value beyond which a float has nothing more to say


@dataclass(frozen=True)
class StatedParameter:
    """A parameter ready for print, all in ``unit``."""

    value: str  # to the place of the standard uncertainty's second digit
    standard: str  # standard uncertainty u, two significant digits
    expanded: str  # expanded uncertainty U = k u, two significant digits
    interval: str  # the 95 % interval in words, open ends as ≤ and ≥
    unit: str  # with the SI prefix that reads well; empty for the unit one


def last_digit(uncertainty: float) -> int:
    """Return the power of ten of the second digit of an uncertainty: −3 for 0.0123 and 0.00996.

    ``uncertainty``: positive and finite.
    """
    exact = Decimal(repr(float(uncertainty)))
    last = exact.adjusted() - 1
    # 0.0996 becomes 0.10
    return last if round(exact, -last).adjusted() == exact.adjusted() else last + 1


def printed(number: str) -> str:
    """Return a number, or –, as it is set: ``-1.5e-7`` becomes ``−1.5·10⁻⁷``.

    Zero has neither sign nor power.
    """
    head, _, power = number.partition("e")
    if not head.strip("+-0."):
        return head.lstrip("+-") if "." in head and not power else "0"
    return head.replace("-", "−") + (f"·10{power.translate(SUPERSCRIPTS)}" if power else "")


def plain(value: float | None, digits: int = PLAIN_DIGITS) -> str:
    """Return a number to so many significant digits; – for None and not finite."""
    return printed(amounts.plain(value, digits))


def signed(value: float | None, decimals: int) -> str:
    """Return a number with its sign and so many places; – for None and not finite."""
    return printed(f"{value:+.{decimals}f}") if _is_finite(value) else NONE


def _is_finite(value: float | None) -> TypeGuard[float]:
    return value is not None and math.isfinite(value)


def pair(value: float | None, uncertainty: float | None) -> tuple[str, str]:
    """Return a value and its standard uncertainty as text.

    Both are fixed-point, or both carry the same power of ten where fixed-point would need many
    zeros. Without a usable uncertainty (None, zero, not finite) the value has six significant
    digits; zero is printed as ``0``.

    ``value``: best estimate; ``uncertainty``: standard uncertainty, same unit.
    """
    value_text, u_text = rounded(value, uncertainty)
    return printed(value_text), printed(u_text)


def rounded(value: float | None, uncertainty: float | None) -> tuple[str, str]:
    """Return value and uncertainty as Python writes numbers, to compute with."""
    texts = _aligned(value, uncertainty, [uncertainty])
    return texts[0], texts[1]


def _aligned(
    value: float | None, uncertainty: float | None, own_uncertainties: list[float | None]
) -> list[str]:
    """Return the value to the place of u, and its uncertainties, with one power of ten.

    Each of ``own_uncertainties`` has two digits.
    """
    if not _is_finite(uncertainty) or uncertainty <= 0:
        texts = [amounts.plain(value)]
        return texts + [
            NONE if not _is_finite(u) else "0" if u == 0 else amounts.plain(u, 2)
            for u in own_uncertainties
        ]
    last = last_digit(uncertainty)
    size = Decimal(repr(float(value))) if _is_finite(value) else Decimal(0)
    first = max(size.adjusted() if size else -400, last + 1)
    if first - last >= _MAX_DIGITS:  # finer than a float resolves: round the uncertainty alone
        return [
            amounts.plain(value, _MAX_DIGITS),
            *(amounts.plain(u, 2) for u in own_uncertainties),
        ]
    power = first if last > 3 or first < -4 else 0
    texts = [_fixed(size, last, power) if _is_finite(value) else NONE]
    for u in own_uncertainties:
        texts.append(
            _fixed(Decimal(repr(float(u))), last_digit(u), power)
            if _is_finite(u) and u > 0
            else NONE
        )
    return texts


def _fixed(value: Decimal, last: int, power: int) -> str:
    text = f"{round(value, -last).scaleb(-power):.{max(0, power - last)}f}"
    if not text.strip("-0."):
        return "0" if power else text.lstrip("-")  # no negative zero
    return f"{text}e{power}" if power else text


def uncertainty(u: float | None) -> str:
    """Return an uncertainty alone: two significant digits, zeros kept."""
    return pair(u, u)[0]


def concise(value: float | None, uncertainty: float | None) -> str:
    """Return the value with u in its last digits, GUM 7.2.2: ``104.01(11)``.

    The value alone where there is no u.
    """
    text, u = rounded(value, uncertainty)
    if not _is_finite(uncertainty) or uncertainty == 0 or text == NONE:
        return printed(text)
    head, _, power = text.partition("e")
    u_head, _, u_power = u.partition("e")
    if power != u_power:
        return f"{printed(text)} ± {printed(u)}"
    digits = u_head.replace(".", "").lstrip("0") if float(u_head) < 1 else u_head
    return f"{printed(head)}({digits}){printed(f'1e{power}').removeprefix('1') if power else ''}"


def natural_scale(parameter: Parameter) -> UnitScale:
    """Return the unit in which a parameter reads well, and the factor to it."""
    sizes = [abs(x) for x in (parameter.value, parameter.standard_uncertainty) if _is_finite(x)]
    return scaled(parameter.unit, max(sizes, default=0.0))


def rounded_parameter(
    parameter: Parameter, k: float = K, scale: UnitScale | None = None
) -> StatedParameter:
    """Round all numbers of a parameter by GUM 7.2.6, in one unit; U = k u.

    ``scale``: unit and factor to it; None for a natural prefix.
    """
    u = parameter.standard_uncertainty
    scale = scale or natural_scale(parameter)
    value = scale.times(parameter.value)
    u = scale.times(u)
    texts = [printed(text) for text in _aligned(value, u, [u, None if u is None else k * u])]
    low, high = map(scale.times, parameter.interval_95)
    return StatedParameter(
        value=texts[0],
        standard=texts[1],
        expanded=texts[2],
        interval=_interval(low, high, u, stated_open=_is_finite(u) or not parameter.identifiable),
        unit=scale.printed,
    )


def _interval(low: float | None, high: float | None, u: float | None, *, stated_open: bool) -> str:
    if not _is_finite(u) or u == 0:  # the place of the limits then comes from their distance
        u = (high - low) / 4 if low is not None and high is not None and high > low else None
    ends = [None if limit is None else pair(limit, u)[0] for limit in (low, high)]
    if ends[0] is not None and ends[1] is not None:
        return f"{ends[0]} … {ends[1]}"
    if ends[1] is not None:
        return f"≤ {ends[1]}"
    if ends[0] is not None:
        return f"≥ {ends[0]}"
    return "not bounded" if stated_open else NONE


def percent(value: float | None, expanded: float | None = None) -> str:
    """Return a signed percentage, ``+0.12 %``: to the place of its U, else two digits."""
    if not _is_finite(value):
        return NONE
    if _is_finite(expanded) and expanded > 0:
        return f"{with_sign(rounded(value, expanded)[0])} %"
    if abs(value) <= _DUST_PERCENT:
        return "0 %"
    if abs(value) < 5e-6:
        return f"{printed(f'{value:+.1e}'.replace('e-0', 'e-'))} %"
    decimals = min(6, max(0, 1 - math.floor(math.log10(abs(value)))))
    return f"{printed(f'{value:+.{decimals}f}')} %"


def with_sign(number: str) -> str:
    """Return a number as Python writes it, set with its sign."""
    return printed(number if number.startswith("-") else f"+{number}")


def with_u(value: float | None, u: float | None, factor: float) -> tuple[str, str]:
    """Return a value rounded to the last digit of its U (k = 2), and U; both times ``factor``."""
    if not _is_finite(value):
        return NONE, NONE
    return pair(value * factor, None if u is None else K * u * factor)


def per_unit(result: Result) -> str:
    """Return the unit that the result's sensitivities are per."""
    return result.sensitivity_per.get("unit") or REFERENCE_UNITS.get(result.quantity, "drive unit")


def reference_quantity(result: Result) -> str:
    """Return what the reference gives; acceleration where it is not stated."""
    return result.reference.get("quantity", "acceleration")


def reference_unit(result: Result) -> str:
    """Return the unit of the reference channel, by its quantity where it is not stated."""
    quantity = reference_quantity(result)
    return result.reference.get("unit") or REFERENCE_UNITS.get(quantity, "reference unit")


def sensitivity_unit(response_unit: str, per: str) -> str:
    """Return the unit of response per reference: ``V/(m/s^2)`` for ``V`` and ``m/s^2``."""
    top, bottom = (
        f"({unit})" if re.search(r"[/ *·]", unit) else unit for unit in (response_unit, per)
    )
    return f"{top}/{bottom}"


def unit_of_sensitivity(result: Result) -> str:
    """Return the unit of the result's sensitivities."""
    return sensitivity_unit(result.response_unit, per_unit(result))


def fit_unit(result: Result) -> str:
    """Return the unit of the residual: the response's for records, the table's own for a table."""
    table = sensitivity_unit(result.response_unit, reference_unit(result))
    return result.response_unit if result.signals else table


def sensor_name(sensor: Mapping[str, object], number: str = "no.") -> str:
    """Return a sensor's manufacturer, type and serial number in a line; empty if none is stated."""
    words = [str(sensor[key]) for key in ("manufacturer", "type") if sensor.get(key)]
    if sensor.get("serial_number"):
        words.append(f"{number} {sensor['serial_number']}")
    return " ".join(words)


def nominal_frequency(frequency_hz: float) -> str | None:
    """Return the nominal ISO 266 name (Hz) of a one-third-octave frequency; None for any other."""
    nearest = nominal_name(frequency_hz, math.inf)
    if nearest is not None and is_same_frequency(float(nearest), frequency_hz):
        return nearest
    return nominal_name(frequency_hz, 5e-4)


def frequency_text(frequency_hz: float) -> str:
    """Return a frequency for a heading in Hz or kHz: its nominal name, else four digits."""
    value = float(nominal_frequency(frequency_hz) or frequency_hz)
    scale = scaled("Hz", value)
    return f"{value * scale.factor:.4g} {scale.unit}" if value < 1e13 else f"{value:.3g} Hz"


def sensitivity_scale(result: Result) -> UnitScale:
    """Return the unit of all printed sensitivities of a result, and the factor to it.

    The unit follows the result's parameter of sensitivity, if it has one.
    """
    unit = unit_of_sensitivity(result)
    gain = next((p for p in result.parameters.values() if pretty(p.unit) == pretty(unit)), None)
    if gain is not None and _is_finite(gain.value) and gain.value:
        return natural_scale(gain)
    curve = result.response if result.response.magnitude.size else result.measured
    return magnitude_scale(unit, curve.magnitude)


def parameter_scale(result: Result, parameter: Parameter) -> UnitScale:
    """Return the unit in which a parameter of a result is printed: sensitivities have one."""
    same = pretty(parameter.unit) == pretty(unit_of_sensitivity(result))
    return sensitivity_scale(result) if same else natural_scale(parameter)


def magnitude_scale(unit: str, magnitudes: FloatArray) -> UnitScale:
    """Return the unit in which magnitudes read well, and the factor to it."""
    sizes = sorted(abs(m) for m in magnitudes.tolist() if m and math.isfinite(m))
    return scaled(unit, sizes[len(sizes) // 2] if sizes else 0.0)


def shortened(text: str, width: int) -> str:
    """Return a name that fits: its end is kept, because names of records differ there."""
    text = " ".join(text.split())
    return text if len(text) <= width else "…" + text[1 - width :]


def subject(model: str, sensor: Mapping[str, object]) -> str:
    """Return model and sensor in a line, for the title of a picture."""
    return " · ".join(
        text for text in (f"model {model}" if model else "", sensor_name(sensor)) if text
    )
