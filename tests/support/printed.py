"""Reading printed numbers back, and results for the tests of reports."""

from __future__ import annotations

import re
from dataclasses import replace
from decimal import Decimal

from tests.support.sample_results import table2

CERTIFICATE = {
    "number": "2025-0042",
    "laboratory": "Laboratory of Examples",
    "laboratory_address": "Street 1\nTown",
    "customer": "Customer <b>Ltd.</b>",
    "date_of_calibration": "2025-03-31",
    "mounting": "M5 stud #[2] N·m $oiled$",
    "temperature_c": 23.0,
    "temperature_uncertainty_c": 0.5,
    "relative_humidity_percent": 45.0,
    "procedure": "ISO 16063-11, method 3",
    "instruments": [{"name": "Laser vibrometer", "serial_number": "12"}, {"name": "Amplifier"}],
    "traceability": "Traceable through the wavelength of the laser.",
    "operator": "A. Operator",
    "remarks": ["First remark.", "Second remark."],
}
PREFIXES = {"k": 3, "M": 6, "m": -3, "µ": -6, "n": -9, "p": -12, "f": -15}
NUMBER = r"[+−]?\d+(?:\.\d+)?(?:·10⁻?[⁰¹²³⁴⁵⁶⁷⁸⁹]+)?"
#: What no customer knows: words of the program and of its files.
PROGRAM_WORDS = (
    r"\[\[|\]\]|⟦|\bestimators?\b|calibration file|result\.json|\.toml|\bml\b|ipnn|lsm|accelerometer\+"
    r"|velocity-pickup|standard_uncertainty|lack_of_fit|sensitivity_deviation|kind (?:gain|phase)"
    r"|None\b|\bnan\b|\binf\b"
)
_TYPED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻−", "0123456789--")


def stated(result=None):
    """A result with most fields of a certificate."""
    return replace(result or table2(), certificate=CERTIFICATE)


def typed(number: str) -> str:
    """A printed number as Python reads it."""
    return number.replace("·10", "e").translate(_TYPED)


def assert_rounded(text: str, value: float, factor: float = 1.0):
    """The printed number is the value times factor, rounded to its last place."""
    assert re.fullmatch(NUMBER, text), text
    number = Decimal(typed(text))
    half_a_place = Decimal(5).scaleb(number.as_tuple().exponent - 1)
    assert abs(number - Decimal(value * factor)) <= half_a_place * Decimal("1.000001"), (text, value * factor)


def factor_to(unit: str, plain: str) -> float:
    """Factor from a plain unit, as in a result, to the printed one: 1e3 from V/(m/s^2) to mV/(m/s²)."""
    plain = plain.replace("^2", "²").replace("^-1", "⁻¹")
    if unit == plain or (unit == "" and plain == "1"):
        return 1.0
    assert unit[1:] == plain, (unit, plain)
    return 10.0 ** -PREFIXES[unit[0]]


def later(seed: int, factor: float, date: str, serial: str = "4711", **more):
    """Another calibration of the sensor, its gain changed by a factor."""
    result = table2(seed=seed)
    parameters = {
        name: replace(p, value=p.value * factor) if name == "sensitivity" else p
        for name, p in result.parameters.items()
    }
    curve = replace(result.response, magnitude=tuple(m * factor for m in result.response.magnitude))
    files = [{"file": f"{seed}.csv", "sha256": f"{seed:064x}"}]
    return replace(
        result,
        parameters=parameters,
        response=curve,
        certificate={"date_of_calibration": date},
        sensor={**result.sensor, "serial_number": serial},
        provenance={**result.provenance, "files": files},
        **more,
    )
