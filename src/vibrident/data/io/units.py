"""The unit of the reference: its scale leads to the SI unit, so a stated unit only confirms that."""

from __future__ import annotations

from vibrident.base.errors import InputError
from vibrident.data.records import REFERENCE_UNITS, STANDARD_GRAVITY

_SPELLINGS = {
    "m/s^2": {"m/s^2", "m/s2", "m/s/s", "m*s^-2", "ms^-2", "m*s-2", "ms-2", "m/(s^2)", "m/(s*s)"},
    "m/s": {"m/s", "m*s^-1", "ms^-1", "m*s-1", "ms-1"},
    "m": {"m"},
}
#: Common file units in SI units, for the remedy.
_IN_SI = {
    "acceleration": {"g": STANDARD_GRAVITY, "gn": STANDARD_GRAVITY, "mg": STANDARD_GRAVITY / 1e3, "mm/s^2": 1e-3,
                     "gal": 1e-2, "mgal": 1e-5, "cm/s^2": 1e-2},
    "velocity": {"mm/s": 1e-3, "um/s": 1e-6, "nm/s": 1e-9, "cm/s": 1e-2, "in/s": 0.0254, "km/s": 1e3},
    "displacement": {"mm": 1e-3, "um": 1e-6, "nm": 1e-9, "cm": 1e-2, "in": 0.0254, "km": 1e3},
}  # fmt: skip
PLAIN = str.maketrans({"²": "^2", "⁻": "-", "¹": "1", "·": "*", "⋅": "*", "µ": "u", "μ": "u", " ": None})


def reference_unit(quantity: str, unit: str, scale: float, where: str) -> str:
    """Return the reference's unit after scaling.

    A drive keeps its own unit. For the other quantities it is the SI unit: ``unit`` may name it, or, with a scale to
    SI, the unit in the file.

    Raises:
        InputError: ``unit`` belongs to another quantity, or is not SI while the scale is 1.
    """
    si = REFERENCE_UNITS[quantity]
    if quantity == "drive":
        return unit or si
    plain = _plain(unit)
    if not plain or plain in _SPELLINGS[si]:
        return si
    other = next((name for name, spellings in _SPELLINGS.items() if plain in spellings), None)
    if other is None and scale != 1.0:
        return si
    factor = _IN_SI[quantity].get(plain.lower())
    remedy = f"set scale = {factor!r} (times the present scale)" if factor else "correct unit, quantity or scale"
    raise InputError(
        f"The unit of the reference does not fit the quantity {quantity!r}.",
        expected=f"{si} after scaling",
        found=f"unit = {unit!r} with scale = {scale!r}",
        where=f"{where}, [reference] unit",
        remedy=remedy,
    )


def quantity_of(unit: str) -> str | None:
    """Quantity of a unit in a file; None if unknown."""
    plain = _plain(unit)
    for quantity, si in REFERENCE_UNITS.items():
        if si in _SPELLINGS and (plain in _SPELLINGS[si] or plain.lower() in _IN_SI[quantity]):
            return quantity
    return None


def si_scale(quantity: str, unit: str) -> float | None:
    """A unit of a file in the SI unit of the quantity; None if unknown."""
    plain = _plain(unit)
    if plain in _SPELLINGS.get(REFERENCE_UNITS[quantity], ()):
        return 1.0
    return _IN_SI.get(quantity, {}).get(plain.lower())


def _plain(unit: str) -> str:
    return unit.translate(PLAIN).replace("**", "^")
