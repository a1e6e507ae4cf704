"""Units in the header of a data file: "Time (ms)", "time_us", "time/min", "f (kHz)", "phase (rad)", "a in mm/s²".

One rule for all columns. If the calibration file states no unit (times, frequencies, a response that is no voltage),
the header's is used. If it states one (quantity, scale, unit, phase_unit), a contradicting header is refused. A header
without a known unit is ignored. The scale of the reference leads to its SI unit, so a stated unit only confirms that.
"""

from __future__ import annotations

import math
import re

from vibrident.base.errors import InputError
from vibrident.data.io.columns import ColumnFile
from vibrident.data.records import REFERENCE_UNITS, STANDARD_GRAVITY, Quantity

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
PLAIN = str.maketrans(
    {"²": "^2", "⁻": "-", "¹": "1", "·": "*", "⋅": "*", "µ": "u", "μ": "u", " ": None}
)


def reference_unit(quantity: str, unit: str, scale: float, where: str) -> str:
    """Return the reference's unit after scaling; InputError where ``unit`` and ``scale`` do not lead to it.

    A drive keeps its own unit. For the other quantities it is the SI unit: ``unit`` may name it, or, with a scale to
    SI, the unit in the file.
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
    remedy = (
        f"set scale = {factor!r} (times the present scale)"
        if factor
        else "correct unit, quantity or scale"
    )
    raise InputError(
        f"The unit of the reference does not fit the quantity {quantity!r}.",
        expected=f"{si} after scaling",
        found=f"unit = {unit!r} with scale = {scale!r}",
        where=f"{where}, [reference] unit",
        remedy=remedy,
    )


def quantity_of(unit: str) -> str | None:
    """Quantity of a unit in a file; None if unknown."""
    return next((quantity for quantity in _IN_SI if si_scale(quantity, unit) is not None), None)


def si_scale(quantity: str, unit: str) -> float | None:
    """A unit of a file in the SI unit of the quantity; None if unknown."""
    plain = _plain(unit)
    if plain in _SPELLINGS.get(REFERENCE_UNITS[quantity], ()):
        return 1.0
    return _IN_SI.get(quantity, {}).get(plain.lower())


def _plain(unit: str) -> str:
    return unit.translate(PLAIN).replace("**", "^")


_SECONDS = {
    "s": 1.0, "sec": 1.0, "secs": 1.0, "second": 1.0, "seconds": 1.0, "sekunde": 1.0, "sekunden": 1.0,
    "ms": 1e-3, "msec": 1e-3, "millisecond": 1e-3, "milliseconds": 1e-3, "millisekunden": 1e-3,
    "us": 1e-6, "usec": 1e-6, "microsecond": 1e-6, "microseconds": 1e-6, "mikrosekunden": 1e-6,
    "ns": 1e-9, "nsec": 1e-9, "nanosecond": 1e-9, "nanoseconds": 1e-9, "ps": 1e-12, "cs": 1e-2, "ds": 0.1, "ks": 1e3,
    "min": 60.0, "mins": 60.0, "minute": 60.0, "minutes": 60.0, "minuten": 60.0,
    "h": 3600.0, "hr": 3600.0, "hour": 3600.0, "hours": 3600.0, "stunden": 3600.0, "d": 86400.0, "days": 86400.0,
}  # fmt: skip
_HERTZ = {
    "hz": 1.0, "1/s": 1.0, "s^-1": 1.0, "hertz": 1.0, "khz": 1e3, "mhz": 1e-3, "uhz": 1e-6, "rpm": 1 / 60,
    "1/min": 1 / 60, "rad/s": 0.5 / math.pi, "rad*s^-1": 0.5 / math.pi, "krad/s": 500 / math.pi,
    "deg/s": 1 / 360, "°/s": 1 / 360,
}  # fmt: skip
_RADIANS = {
    "deg": math.pi / 180, "degree": math.pi / 180, "degrees": math.pi / 180, "°": math.pi / 180, "grad": math.pi / 200,
    "rad": 1.0, "radian": 1.0, "radians": 1.0, "mrad": 1e-3, "urad": 1e-6,
}  # fmt: skip
#: Units in other scripts, by their symbol.
_SYMBOLS = {
    "秒": "s", "毫秒": "ms", "微秒": "us", "纳秒": "ns", "分": "min", "分钟": "min", "小时": "h", "ミリ秒": "ms",
    "マイクロ秒": "us", "с": "s", "сек": "s", "мс": "ms", "мкс": "us", "нс": "ns", "мин": "min",
    "赫": "Hz", "赫兹": "Hz", "千赫": "kHz", "千赫兹": "kHz", "гц": "Hz", "кгц": "kHz",
    "度": "deg", "弧度": "rad", "рад": "rad", "град": "deg",
    "伏": "V", "伏特": "V", "毫伏": "mV", "微伏": "uV", "в": "V", "мв": "mV",
    "米": "m", "毫米": "mm", "微米": "um", "纳米": "nm", "米/秒": "m/s", "毫米/秒": "mm/s", "米/秒²": "m/s^2",
    "米/秒^2": "m/s^2", "米/秒2": "m/s^2", "м": "m", "мм": "mm", "мкм": "um", "м/с": "m/s", "мм/с": "mm/s",
    "м/с²": "m/s^2", "м/с^2": "m/s^2", "м/с2": "m/s^2",
}  # fmt: skip
_WIDE_SIGNS = str.maketrans("（）［］【】｛｝＜＞／", "()[][]{}<>/")
_COUNTED = frozenset(
    {
        "samples",
        "sample",
        "ticks",
        "tick",
        "counts",
        "count",
        "points",
        "point",
        "index",
        "smp",
        "#",
    }
)
_BRACKETS = re.compile(r"[\[(<{]\s*(.+?)\s*[\])>}]\s*$")
_AFTER_SLASH = re.compile(r"^[^/\[(]*[\w)\]]\s*/\s*(\(.+\)|.+)$")
_AFTER_WORD = re.compile(r"\b(?:in|en)\s+(\S+)$", re.IGNORECASE)
#: Suffixes that are a unit of times, frequencies and phases only: "_m" or "_a" are ambiguous.
_SUFFIX = re.compile(r"^.*\w[_.\s-]+([^\W\d_]+)$")
_RUN_ON = re.compile(r"^(?:t|time|timestamp|zeit|elapsed)(ms|us|ns|µs|μs)$", re.IGNORECASE)
_TIMES = frozenset(
    {"t", "time", "times", "timestamp", "zeit", "seconds", "second", "sec", "elapsed", "elapsed time", "relative time",
     "时间", "時間", "时刻", "время", "temps", "tiempo", "tempo"}
)  # fmt: skip
#: A unit to what it is a multiple of, and the factor.
_MULTIPLES = {
    prefix + base: (base, factor)
    for base in ("V", "A", "C", "m/s^2", "m/s", "m")
    for prefix, factor in {"p": 1e-12, "n": 1e-9, "u": 1e-6, "m": 1e-3, "": 1.0, "k": 1e3}.items()
}
#: Of a response; metres in a name may be of what it is per, "S in V/(m/s²)".
_ELECTRIC = ("V", "A", "C", "counts")
#: Numbers of an analogue-to-digital converter.
_CODES = frozenset({"count", "counts", "cts", "lsb", "lsbs", "digit", "digits"})
#: A coverage factor, and words for an expanded uncertainty.
_COVERAGE = re.compile(r"\bk\s*=\s*(\d+(?:[.,]\d+)?)", re.IGNORECASE)
_EXPANDED = re.compile(
    r"expanded|erweitert\w*|élargie|\bU_?95\b|расширенн\w*|扩展不确定度", re.IGNORECASE
)
_LONGEST_NAME = 200
#: A scale this close to a conversion is that conversion.
_SAME = 1e-3


def unit_in_name(name: str) -> str:
    """Return the unit at the end of a column's name, as written; "" if none."""
    name = _short(name)
    for pattern in (_BRACKETS, _AFTER_WORD, _AFTER_SLASH):
        if found := pattern.search(name):
            unit = found.group(1).strip()
            return _SYMBOLS.get(unit.lower(), unit)
    return ""


def header(source: ColumnFile, position: int) -> str:
    """A column's name, with the unit that the file states beside it."""
    stated, name = source.stated_unit(position), source.names[position]
    name = name.rsplit("/", 1)[-1] if source.names_are_paths else name
    return f"{name} ({stated})" if stated else name


def seconds_per_unit(source: ColumnFile, position: int) -> float:
    """Seconds per unit of a time column; 1 if its header states no unit; InputError for one other than of time."""
    if source.in_seconds(position):
        return 1.0
    return _own_unit(
        source, position, _SECONDS, "time_column", "seconds", "give rate_hz instead of time_column"
    )


def hertz_per_unit(source: ColumnFile, position: int) -> float:
    """Hertz per unit of a frequency column; 1 if its header states no unit; InputError for one other than of that."""
    remedy = "write the frequencies in Hz, and Hz into the header"
    return _own_unit(source, position, _HERTZ, "[table] frequency", "Hz", remedy)


def states_a_time_unit(name: str) -> bool:
    """Whether a column's name states the unit of its times."""
    return _spelling(name, _SECONDS) in _SECONDS


def is_time(name: str) -> bool:
    """Whether a column's name is that of times, with or without a unit."""
    name = _short(name)
    plain = name.lower()
    base = re.split(r"[\[(<{/_,]|\s+in\s", plain, maxsplit=1)[0].strip()
    if plain == base:
        return base in _TIMES or _RUN_ON.match(plain) is not None
    return base in _TIMES and states_a_time_unit(name)


def require_phase_unit(source: ColumnFile, position: int, key: str, phase_unit: str) -> None:
    """Check that the header of phases, or of their uncertainties, names no other unit than phase_unit."""
    name = header(source, position)
    found = _spelling(name, _RADIANS)
    if found and _RADIANS.get(found) != _RADIANS[phase_unit]:
        other = {_RADIANS["deg"]: "deg", 1.0: "rad"}.get(_RADIANS.get(found, math.nan))
        remedy = (
            f'set phase_unit = "{other}", or correct the header'
            if other
            else f"convert it to {phase_unit}"
        )
        raise _contradiction(
            source, position, f"[table] {key}", f'phase_unit = "{phase_unit}"', found, remedy
        )


def require_channel_unit(
    source: ColumnFile,
    position: int,
    key: str,
    *,
    unit: str,
    scale: float,
    quantity: Quantity | None = None,
) -> None:
    """Check that the header of a column of records names no other quantity, nor a unit that needs another scale.

    ``scale`` leads to ``unit`` ("": the quantity's own); ``quantity`` is that of the reference, None for the response;
    ``key``: the section of the calibration file that states them.
    """
    found = unit_in_name(header(source, position))
    if not found:
        return
    if quantity not in (None, "drive"):
        own = quantity_of(found)
        if own is not None and own != quantity:
            remedy = f'set quantity = "{own}", or correct the header'
            raise _contradiction(
                source, position, f"{key} quantity", f"a unit of {quantity}", found, remedy
            )
        factor = None if own is None else si_scale(quantity, found)
    else:
        factor = _factor(found, unit)
    _require_scale(source, position, key, found, factor, scale, unit or str(quantity))


def require_magnitude_unit(
    source: ColumnFile, position: int, key: str, *, unit: str, scale: float, quantity: Quantity
) -> None:
    """Check a column of magnitudes, or of their uncertainties: not in dB or %, and in the stated unit.

    ``scale`` leads from the column to ``unit`` of the response per SI unit of the reference ``quantity``.
    """
    name = header(source, position)
    found = unit_in_name(name) or (
        name.rsplit("_", 1)[-1] if re.search(r"_(db|percent)$", name, re.IGNORECASE) else ""
    )
    plain = found.translate(PLAIN).lower()
    if plain.startswith("db"):
        remedy = 'state magnitude_unit = "dB" under [table], and what 0 dB stands for as [response] scale'
        raise _contradiction(
            source, position, f"[table] {key}", "a linear magnitude", found, remedy
        )
    if plain in ("%", "percent"):
        remedy = "multiply it by the magnitude and divide by 100; and correct the header"
        raise _contradiction(
            source,
            position,
            f"[table] {key}",
            "a magnitude in its unit, not relative",
            found,
            remedy,
        )
    above, _, below = found.partition("/")
    below = below.strip().strip("()")
    if (
        not below
        or quantity == "drive"
        or not any(_factor(above, base) for base in ("V", "A", "C"))
    ):
        return
    own = quantity_of(below)
    if own is not None and own != quantity:
        remedy = f'set [reference] quantity = "{own}", or correct the header'
        raise _contradiction(
            source, position, f"[table] {key}", f"a response per {quantity}", found, remedy
        )
    numerator, denominator = _factor(above, unit), si_scale(quantity, below)
    factor = None if numerator is None or denominator is None else numerator / denominator
    _require_scale(
        source,
        position,
        f"[table] {key}",
        found,
        factor,
        scale,
        f"{unit} per SI unit of the reference",
    )


def require_response_unit(
    source: ColumnFile, position: int, key: str, unit: str, scale: float
) -> None:
    """Check the stated unit of a response or magnitude: charge is no voltage, nor is a converter's count, unscaled."""
    found, stated = unit_of_another_kind(source, position, unit), _base(unit)
    if found and abs(scale) == 1.0:
        remedy = f'set unit = "{found}"; or set scale to {unit} per {found}; or correct the header'
        raise _contradiction(
            source, position, f"{key} unit", f'{stated}, for unit = "{unit}"', found, remedy
        )


def unit_of_another_kind(source: ColumnFile, position: int, unit: str) -> str:
    """The electric unit that the header of a response or magnitude names, if it is no multiple of ``unit``; else ""."""
    found, known = unit_in_name(header(source, position)).partition("/")[0].strip(), _base(unit)
    return found if known and _base(found) in _ELECTRIC and _base(found) != known else ""


def require_standard_uncertainty(source: ColumnFile, position: int, key: str) -> None:
    """Check that the header of a column of uncertainties does not say that they are expanded ones, U = k u."""
    name = _short(header(source, position))
    factor = _COVERAGE.search(name)
    if factor is not None and float(factor.group(1).replace(",", ".")) != 1.0:
        found, by = f"k = {factor.group(1)}", factor.group(1)
    elif expanded := _EXPANDED.search(name):
        found, by = expanded.group(0), "its coverage factor k, usually 2"
    else:
        return
    remedy = f"divide it by {by}; and correct the header"
    raise _contradiction(
        source, position, f"[table] {key}", "standard uncertainties (k = 1)", found, remedy
    )


def _own_unit(
    source: ColumnFile, position: int, known: dict[str, float], key: str, expected: str, remedy: str
) -> float:
    name = header(source, position)
    found = _spelling(name, known)
    if found in known:
        return known[found]
    if found:
        raise _contradiction(
            source, position, key, f"a column in {expected}, or in a multiple of it", found, remedy
        )
    return 1.0


def _spelling(name: str, known: dict[str, float]) -> str:
    """The unit in a name, in plain lower case; "" if it is absent or not a unit."""
    name = _short(name)
    found = unit_in_name(name).translate(PLAIN)
    plain = found.strip("[]()").lower()
    if plain == "mhz" and found.startswith("M"):
        return "MHz"
    if plain in known or plain in _COUNTED or (found and _known_elsewhere(found)):
        return plain
    whole = name.strip().translate(PLAIN).lower()
    if whole in known and len(whole) > 1:
        return whole
    suffix = _RUN_ON.match(name.strip()) or _SUFFIX.match(name.strip())
    written = suffix.group(1) if suffix else ""
    plain = _SYMBOLS.get(written.lower(), written).translate(PLAIN).lower()
    return plain if plain in known else ""


def _short(name: str) -> str:
    """The name, stripped; "" for a very long one, for which patterns would take minutes."""
    return name.strip().translate(_WIDE_SIGNS) if len(name) <= _LONGEST_NAME else ""


def _known_elsewhere(found: str) -> bool:
    plain = found.lower()
    electric = any(_factor(found, unit) is not None for unit in ("V", "A", "C"))
    return (
        any(plain in units for units in (_SECONDS, _HERTZ, _RADIANS))
        or electric
        or quantity_of(found) is not None
    )


def _factor(found: str, unit: str) -> float | None:
    """The found unit in terms of the stated one; None if they are not multiples of one unit."""
    (base, factor), (other, stated) = (
        _MULTIPLES.get(u.translate(PLAIN).strip("()"), ("", 1.0)) for u in (found, unit)
    )
    return factor / stated if base and base == other else None


def _base(unit: str) -> str:
    """What a unit is a multiple of, "counts" of a converter's; "" if that is not known."""
    unit = unit.translate(PLAIN).strip("()")
    if unit.lower() in _CODES:
        return "counts"
    return _MULTIPLES.get(unit, ("", 1.0))[0]


def _require_scale(
    source: ColumnFile,
    position: int,
    key: str,
    found: str,
    factor: float | None,
    scale: float,
    unit: str,
) -> None:
    """A scale of one, or one that converts g, must match the header; another may include an amplifier's gain."""
    if factor is None or math.isclose(abs(scale), factor, rel_tol=_SAME):
        return
    if any(math.isclose(abs(scale), known, rel_tol=_SAME) for known in (1.0, STANDARD_GRAVITY)):
        expected = f"a unit for scale = {scale!r} (to {unit})"
        remedy = f"set scale = {factor!r} for values in {found}; or correct the header"
        raise _contradiction(source, position, f"{key} scale", expected, found, remedy)


def _contradiction(
    source: ColumnFile, position: int, key: str, expected: str, found: str, remedy: str
) -> InputError:
    return InputError(
        "The header of a column contradicts the calibration file.",
        expected=expected,
        found=f"{header(source, position)!r}, which names {found!r}",
        where=f"{source.file}, asked for by {key}",
        remedy=remedy,
    )
