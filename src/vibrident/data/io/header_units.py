"""Apply the units that files state of columns of records, or refuse them.

A unit stands in a format's own field, in a row below the names, or in a name: "Time (ms)",
"time_us", "t/min", "a in mm/s²". Whatever the place, the rule is the same:

- A unit of the quantity wanted (mm/s, g, mV, ms) gives the factor; ``scale`` multiplies what is
  left. A ``scale`` that equals the factor would convert twice and is refused.
- A unit of another kind than the calibration file states is refused, unless ``scale`` converts it:
  V for an acceleration, counts or pC for volts.
- A word elsewhere in a name that may be a unit of the quantity ("acc_g", "[g] filtered") is refused
  unless ``scale`` is given: it is either converted or not, and both would be a guess.
- Where the calibration file leaves the unit of a response open, the file's is taken.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from vibrident.base.errors import InputError
from vibrident.data.io.calibration_file import ReferenceSection, ResponseSection
from vibrident.data.io.columns import ColumnFile
from vibrident.data.io.units import (
    MAX_NAME_LENGTH,
    PLAIN_BRACKETS,
    QUANTITY_UNITS,
    Unit,
    factor_between,
    is_no_unit,
    is_row_counter,
    parse_unit,
    quantity_of,
    split_unit,
)
from vibrident.data.io.vocabulary import VOCABULARY
from vibrident.data.records import REFERENCE_UNITS, STANDARD_GRAVITY

_SAME_FACTOR = 1e-3  # relative; a scale this close to a conversion is that conversion (9.81 for g)
#: A unit behind an underscore or a blank, of times only: "_m" or "_a" are ambiguous.
_SUFFIX = re.compile(r"^.*\w[_.\s-]+([^\W\d_]+)$")
_RUN_ON = re.compile(r"^(?:t|time|timestamp|zeit|elapsed)(ms|us|ns|µs|μs)$", re.IGNORECASE)
_TIME_NAMES = frozenset(VOCABULARY["times"])
#: What parts the words of a name; of a dash, one between letters.
_BETWEEN_WORDS = re.compile(r"[\s\[\](){}<>,;:|_.=\"']+|(?<=[^\W\d])-(?=[^\W\d])")
#: What stands in square brackets in place of a unit: an axis, or a channel's name or number.
_LABEL = re.compile(r"[xyz]|[\W_]*|\w*\d+", re.IGNORECASE)
_NOT_ASCII = re.compile(r"^[^!-~]+")
_PREPOSITIONS = frozenset({"in"})  # the inch is written in brackets


@dataclass(frozen=True)
class ChannelConversion:
    """Factor from a number in a file to the unit of its channel, before ``scale``."""

    factor: float
    unit: str  # that the file states; "" for none


@dataclass(frozen=True, eq=False)
class SourceColumn:
    """A column of a file that a key, or a section, of the calibration file asks for."""

    source: ColumnFile
    position: int
    key: str = ""

    @property
    def asked_for_by(self) -> str:
        """Return the key as messages print it."""
        return self.key

    @property
    def last_name(self) -> str:
        """Return the name without the path in front of it."""
        name = self.source.names[self.position]
        return name.rsplit("/", 1)[-1] if self.source.names_are_paths else name

    @property
    def header(self) -> str:
        """Return the name, with the unit that the file states beside it."""
        unit = self.source.stated_unit(self.position)
        return f"{self.last_name} ({unit})" if unit else self.last_name

    @property
    def file_unit(self) -> tuple[str, bool]:
        """Return the unit that the file states, and whether it stands in a place for units.

        That is a field, or square brackets. Elsewhere in a name, a unit is a guess: only known ones
        count. "" for none.
        """
        unit = self.source.stated_unit(self.position)
        if unit and not is_no_unit(unit):
            return unit, True
        name = short_name(self.last_name)
        unit = unit_in_name(name)
        if parse_unit(unit) is not None:
            return unit, False
        is_unknown = name.endswith("]") and not is_no_unit(unit) and not _LABEL.fullmatch(unit)
        return (unit, True) if is_unknown else ("", False)

    @property
    def seconds(self) -> float | None:
        """Return the seconds in a unit of a column of times; None if no unit is stated.

        Raises:
            InputError: the unit is not one of time.
        """
        if self.source.in_seconds(self.position):
            return 1.0
        unit = _unit_of_time(self.header)
        parsed = parse_unit(unit)
        if parsed is not None and parsed.dimension == (("s", 1),):
            return parsed.factor
        if is_row_counter(unit) or (parsed is not None and parsed.dimension):
            remedy = "give rate_hz instead of time_column"
            expected = "a column in seconds, or in a multiple of it"
            raise self.refused(expected, unit, remedy)
        return None

    def refused(self, expected: str, value: str, remedy: str, key: str = "") -> InputError:
        """Return the error of a header that says otherwise than the calibration file.

        ``key``: of the section that asks for the column.
        """
        return InputError(
            "The header of a column contradicts the calibration file.",
            expected=expected,
            found=f"{self.header!r}, which names {value!r}",
            where=f"{self.source.file}, asked for by {self.asked_for_by} {key}".rstrip(),
            remedy=remedy,
        )


def unit_in_name(name: str) -> str:
    """Return the unit at the end of a column's name, as written; "" if none."""
    return split_unit(short_name(name))[1]


def _hidden_unit(name: str, target: Unit) -> str:
    """Return a word in a name that may be another unit of a kind, whatever its case; "" for none.

    A letter that is no ASCII may be a prefix in another encoding ("æV" for µV).
    """
    for word in _BETWEEN_WORDS.split(short_name(name)):
        spellings = (word, word[:1].lower() + word[1:], word.lower(), _NOT_ASCII.sub("", word))
        units = [unit for unit in map(parse_unit, spellings) if unit is not None]
        kinds = [unit for unit in units if unit.dimension == target.dimension]
        if kinds and word not in _PREPOSITIONS and parse_unit(word) != target:
            return word
    return ""


def states_a_time_unit(name: str) -> bool:
    """Tell whether a column's name states the unit of its times."""
    return _is_a_time(_unit_of_time(name))


def is_time(name: str) -> bool:
    """Tell whether a column's name is that of times, with a unit or without."""
    name = short_name(name)
    plain = name.lower()
    base = re.split(r"[\[(<{/_,]|\s+in\s", plain, maxsplit=1)[0].strip()
    numbered = base.rstrip("0123456789").rstrip()  # "t2": the clock of another channel
    if plain in _TIME_NAMES:
        return True
    if plain == base:
        return numbered in _TIME_NAMES or _RUN_ON.match(plain) is not None
    return numbered in _TIME_NAMES and states_a_time_unit(name)


def _unit_of_time(name: str) -> str:
    """Return the unit in the name of a column of times; "" if none."""
    short = short_name(name)
    unit = unit_in_name(short)
    if parse_unit(unit) is not None or is_row_counter(unit):
        return unit
    if len(short) > 1 and _is_a_time(short):  # "seconds"
        return short
    suffix = _RUN_ON.match(short) or _SUFFIX.match(short)
    unit = suffix.group(1) if suffix else ""
    return unit if _is_a_time(unit) or _is_a_time(unit.lower()) else ""


def _is_a_time(text: str) -> bool:
    parsed = parse_unit(text)
    return parsed is not None and parsed.dimension == (("s", 1),)


def short_name(name: str) -> str:
    """Return the stripped name with plain brackets; "" for a very long one."""
    if len(name) > MAX_NAME_LENGTH:
        return ""
    return name.strip().translate(PLAIN_BRACKETS)


def reference_unit(section: ReferenceSection, first_unit: str) -> str:
    """Return the unit of the reference after conversion: SI, or the drive's own.

    ``first_unit``: that the first data file states, for a drive without a unit; "" for none.
    """
    if section.quantity != "drive":
        return REFERENCE_UNITS[section.quantity]
    if section.unit or abs(section.scale) != 1.0:
        return section.unit or REFERENCE_UNITS["drive"]
    return first_unit or REFERENCE_UNITS["drive"]


def reference_conversion(
    column: SourceColumn, section: ReferenceSection, unit: str
) -> ChannelConversion:
    """Return the factor to the reference's ``unit``; InputError where the file contradicts it.

    ``[reference] unit`` may name the SI unit, which confirms it, or the unit in the file.
    """
    header_unit, sure = column.file_unit
    if section.quantity == "drive":
        return _convert(column, header_unit, unit, section)
    declared = _declared_unit(section, header_unit, column.source)
    text = declared or header_unit
    parsed = parse_unit(text)
    quantity_unit = QUANTITY_UNITS[section.quantity]
    if not text:
        _refuse_hidden_unit(column, section, quantity_unit, unit)
        return ChannelConversion(1.0, header_unit)
    if parsed is not None and parsed.dimension == quantity_unit.dimension:
        if declared:
            return ChannelConversion(declared_factor(section, column.source), text)
        _refuse_second_conversion(column, section, parsed.factor, text)
        return ChannelConversion(parsed.factor, text)
    quantity = quantity_of(text)
    if quantity is not None:
        remedy = f'set quantity = "{quantity}", or correct the unit in the file'
        raise column.refused(f"a unit of {section.quantity}", text, remedy, "quantity")
    if (parsed is not None or sure) and "scale" not in section.model_fields_set:
        si = REFERENCE_UNITS[section.quantity]
        remedy = f'set scale to {si} per {text}, or quantity = "drive"; or correct the file'
        raise column.refused(f"a unit of {section.quantity}", text, remedy, "scale")
    return ChannelConversion(1.0, header_unit)


def _declared_unit(section: ReferenceSection, header_unit: str, source: ColumnFile) -> str:
    """Return ``[reference] unit`` where it is the unit in the file; "" for SI or none."""
    si = REFERENCE_UNITS[section.quantity]
    if not section.unit or factor_between(section.unit, si) == 1.0:
        return ""
    factor = factor_between(section.unit, header_unit) if header_unit else 1.0
    if header_unit and parse_unit(section.unit) is not None and factor != 1.0:
        raise InputError(
            "The unit of the reference contradicts the file.",
            expected=f"{header_unit!r}, as the file states",
            found=f"unit = {section.unit!r}",
            where=f"{source.file}, asked for by [reference] unit",
            remedy=f"leave unit out; the file's is converted to {si}",
        )
    declared_factor(section, source)
    return section.unit


def declared_factor(section: ReferenceSection, source: ColumnFile) -> float:
    """Return the factor to SI of ``[reference] unit``: 1 for SI, none, and one that scale converts.

    Raises:
        InputError: neither the unit nor scale converts to SI, or both would.
    """
    si = REFERENCE_UNITS[section.quantity]
    factor = factor_between(section.unit, si)
    if section.quantity == "drive" or not section.unit or factor == 1.0:
        return 1.0
    is_scaled = abs(section.scale) != 1.0
    if factor is not None and not is_scaled:
        return factor
    if is_scaled and (factor is None or is_same_factor(section.scale, factor)):
        return 1.0
    raise InputError(
        f"The unit of the reference does not fit the quantity {section.quantity!r} and the scale.",
        expected=f"a unit of {section.quantity} without scale, or scale to {si} without unit",
        found=f"unit = {section.unit!r} with scale = {section.scale!r}",
        where=f"{source.file}, asked for by [reference] unit",
        remedy=f"correct unit or quantity; or leave unit out where scale leads to {si}",
    )


def _refuse_second_conversion(
    column: SourceColumn, section: ReferenceSection, factor: float, text: str
) -> None:
    """Refuse a scale that is the factor of the file's unit, or of g where the file has SI."""
    if factor != 1.0 and is_same_factor(section.scale, factor):
        raise _double_conversion_error(column, text, section.scale)
    if factor == 1.0 and is_same_factor(section.scale, STANDARD_GRAVITY):
        remedy = "set scale = 1.0; or correct the unit in the file"
        raise column.refused("values in g", text, remedy, "scale")


def response_unit(column: SourceColumn, section: ResponseSection) -> str:
    """Return the unit of the response: as stated, else of the file, volts for multiples of V.

    Raises:
        InputError: the file states another kind than volts, and ``scale`` may lead from it to any.
    """
    if "unit" in section.model_fields_set:
        return section.unit
    text, sure = column.file_unit
    parsed = parse_unit(text)
    scaled = abs(section.scale) != 1.0
    if parsed is None:
        return text if sure and not scaled else section.unit
    of_volts = parsed.dimension == (("V", 1),)
    if of_volts or (not sure and _is_time_like(parsed)):
        return section.unit
    if not scaled:
        return text
    if parsed.dimension == (("counts", 1),):
        return section.unit
    raise InputError(
        "The unit of the response is not stated.",
        expected="unit beside scale, as the file's is not V",
        found=f"{column.header!r}, which names {text!r}, with scale = {section.scale!r}",
        where=f"{column.source.file}, asked for by [response] scale",
        remedy=f'state [response] unit: "V" if scale leads to volts, "{text}" if it is a gain',
    )


def _is_time_like(unit: Unit) -> bool:
    bases = {base for base, _ in unit.dimension}
    return bool(bases) and bases <= {"s", "rad"}


def response_conversion(
    column: SourceColumn, section: ResponseSection, unit: str
) -> ChannelConversion:
    """Return the factor to the response's ``unit``; InputError where the file contradicts it."""
    return _convert(column, column.file_unit[0], unit, section)


def _convert(
    column: SourceColumn, text: str, unit: str, section: ReferenceSection | ResponseSection
) -> ChannelConversion:
    """Return the conversion of a channel that has a unit of its own."""
    parsed = parse_unit(text)
    target = parse_unit(unit)
    if not text and target is not None:
        _refuse_hidden_unit(column, section, target, unit)
    if not text or text == unit:
        return ChannelConversion(1.0, text)
    if parsed is not None and target is not None and parsed.dimension == target.dimension:
        factor = parsed.factor / target.factor
        if factor != 1.0 and is_same_factor(section.scale, factor):
            raise _double_conversion_error(column, text, section.scale)
        return ChannelConversion(factor, text)
    sure = column.file_unit[1] or (parsed is not None and not _is_time_like(parsed))
    if (
        sure
        and "scale" not in section.model_fields_set
        and not is_no_unit(text)
        and unit != REFERENCE_UNITS["drive"]
    ):
        remedy = f'set unit = "{text}"; or set scale to {unit} per {text}; or correct the file'
        raise column.refused(f"a multiple of {unit}", text, remedy, "unit")
    return ChannelConversion(1.0, text)


def _refuse_hidden_unit(
    column: SourceColumn, section: ReferenceSection | ResponseSection, target: Unit, unit: str
) -> None:
    """Refuse a name with a word that may be its unit, unless a scale says what the numbers are."""
    word = _hidden_unit(column.last_name, target)
    if not word or "scale" in section.model_fields_set:
        return
    factor = factor_between(word, unit)
    conversion = f"to {unit} per {word}" if factor is None else f"= {factor:.9g}"
    raise InputError(
        "The name of a column may state its unit.",
        expected=f"a unit behind the name in brackets, as in 'name [{unit}]', or scale",
        found=f"{column.last_name!r}, where {word!r} may be the unit",
        where=f"{column.source.file}, asked for by {column.key}",
        remedy=f"set scale {conversion} if it is; scale = 1.0 if the column is in {unit}",
    )


def is_same_factor(scale: float, factor: float) -> bool:
    """Tell whether a scale is a conversion, as 9.81 is that of g."""
    return math.isclose(abs(scale), factor, rel_tol=_SAME_FACTOR)


def _double_conversion_error(column: SourceColumn, text: str, scale: float) -> InputError:
    return InputError(
        "The scale would convert a unit that is converted already.",
        expected=f"no scale: the file states {text!r}, and its factor is applied",
        found=f"scale = {scale!r}, which is that factor",
        where=f"{column.source.file}, column {column.header!r}, asked for by {column.key} scale",
        remedy="remove scale",
    )
