"""Read the lines above the data of a text file: rate, interval, start and units of columns.

One rule for all makers: a line holds a key and its values, and the key is sought in one table, in
the usual languages.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from vibrident.base.errors import InputError
from vibrident.data.io.columns import Channel, Clock, StartTime
from vibrident.data.io.plain_text import BLANKS
from vibrident.data.io.sampling import agreed_clock, plainest_clock
from vibrident.data.io.stamps import has_fraction, is_stamp, parse_stamps
from vibrident.data.io.units import Unit, is_no_unit, parse_unit, without_brackets
from vibrident.data.io.vocabulary import VOCABULARY

#: Keys of a statement, by what they state.
_KEYS: dict[str, list[str]] = VOCABULARY["head"]
#: Names of many quantities, which state a sampling where a value with its unit follows.
GENERIC_NAMES = frozenset(
    {"rate", "sampling", "abtastung", "delta", "increment", "interval", "intervall"}
)
_CLOCKS = ("rate", "interval")
_SEPARATORS = ":=,;\t"
_STATEMENT = re.compile(
    r"(?:^|[,;|\t({]|//|\s{2})[\s#%*!]*(?:"
    + "|".join(
        f"(?P<{kind}>"
        + "|".join(
            re.escape(key).replace(r"\ ", r"[ _.\-]*") for key in sorted(keys, key=len)[::-1]
        )
        + ")"
        for kind, keys in _KEYS.items()
    )
    + r")\.? *(?:[\[(] *(?P<bracket>[^\])]{1,20}?) *[\])]"
    + r"|(?:in +|_|(?<= ))(?P<word>k?hz|[mµu]?s))? *"
    + rf"(?:[{_SEPARATORS}]|[-=]>|(?:is|[-–])(?= )|(?= [+-]?\.?\d))",
    re.IGNORECASE,
)
_NUMBER = re.compile(r"([+-]?\.?\d[\d.,']*(?:[eE][+-]?\d+)?)\s*(.*)")
_GROUPED = re.compile(r"[+-]?[1-9]\d{0,2}(?:[,.']\d{3})+")
_SAMPLES_PER_SECOND = re.compile(
    r"(?P<prefix>[kMG]?)"
    r"(?:(?:samples?|sa|smp|points|pts|scans|s)\s*(?:/|per)\s*s(?:ec(?:ond)?)?|sps)\b",
    re.IGNORECASE,
)
_PREFIXES = {"": 1.0, "k": 1e3, "m": 1e6, "g": 1e9}
#: A number of more digits may be rounded; an interval is often the reciprocal of a round number.
_EXACT_DIGITS = {"rate": 5, "interval": 3}
_MAX_RATE_HZ = 1e15  # far beyond any converter; a larger one is damage
LABVIEW_END = "***End_of_Header***"
_LABVIEW_EPOCH_S = -2_082_844_800  # 1904-01-01 since 1970-01-01


@dataclass(frozen=True)
class HeadLine:
    """Line above the data: its number from 1, and its text."""

    number: int
    text: str


@dataclass(frozen=True)
class HeadStatement:
    """Key and its values in a line."""

    kind: str
    values: tuple[str, ...]  # behind the key, without quotes and blanks around them
    unit: str  # beside the key
    is_row: bool  # a row of cells: value n belongs to column n + 1
    is_first: bool  # the line begins with it
    line: HeadLine


def statements(line: HeadLine, delimiter: str) -> Iterator[HeadStatement]:
    """Yield the statements of a line."""
    text = line.text.replace('"', "").rstrip("\r\n")
    for match in _STATEMENT.finditer(text):
        kind = next(kind for kind in _KEYS if match[kind] is not None)
        is_row = match[0].endswith(delimiter) and delimiter != BLANKS
        remainder = text[match.end() :] if is_row else text[match.end() :].lstrip(_SEPARATORS + " ")
        is_word = kind in ("units", "time_unit", "dimension")
        gap = delimiter if is_row or (delimiter not in (BLANKS, ",") and not is_word) else "[,;\t]"
        if is_word and not re.search(gap, remainder):
            gap = r"\s+"
        values = _trimmed([cell.strip() for cell in re.split(gap, remainder)])
        unit = (match["bracket"] or match["word"] or "").strip()
        numbers = [_NUMBER.match(value) for value in values]
        is_bare = match[0].strip(_SEPARATORS + "|({/#%*! ").lower() in GENERIC_NAMES and not (
            unit or any(number and _unit(number[2]) for number in numbers)
        )
        is_unit = kind == "dimension" or any(parse_unit(value) is not None for value in values)
        if (is_word and is_unit) or (not is_word and any(numbers) and not is_bare):
            yield HeadStatement(kind, tuple(values), unit, is_row, match.start() == 0, line)


def _trimmed(values: list[str]) -> list[str]:
    """Return cells without empty ones at the end, but the first."""
    while len(values) > 1 and not values[-1]:
        values = values[:-1]
    return values


def is_statement(text: str, delimiter: str) -> bool:
    """Tell whether a line begins with a statement."""
    return any(statement.is_first for statement in statements(HeadLine(0, text), delimiter))


def is_key(cell: str) -> bool:
    """Tell whether a cell is the name of a rate, interval or start, with its value or without."""
    match = _STATEMENT.match(cell.strip() + ":")
    return match is not None and any(match[kind] for kind in ("rate", "interval", "start"))


def read_head(
    lines: Sequence[HeadLine],
    delimiter: str,
    decimal: str,
    width: int,
    numeric: Sequence[int],
    x_column: int | None,
    file: str,
) -> tuple[Channel, ...]:
    """Return what the head states of each column: clock, unit, and values over frequency.

    Args:
        lines: above the data, and beside it.
        delimiter: of the cells.
        decimal: sign of the numbers.
        width: number of columns.
        numeric: columns of numbers.
        x_column: of times, to which units of the ordinate do not belong; None where there is none.
        file: for messages.

    Raises:
        InputError: a rate or interval has no usable number or unit, or two contradict each other.
    """
    stated = [
        (statement, _by_column(statement, width, numeric, x_column))
        for line in lines
        for statement in statements(line, delimiter)
    ]
    time_unit = next((s.values[0] for s, _ in stated if s.kind == "time_unit"), "")
    abscissa = parse_unit(time_unit)
    is_over_hertz = abscissa is not None and abscissa.dimension == (("s", -1),)
    for statement, values in stated:
        rates = {*values.values()} - {""}
        if statement.kind in _CLOCKS and (
            not values or (statement.kind == "rate" and len(rates) > 1)
        ):
            raise _unusable(statement, "one rate, or an interval for each column", file)
    labview = _labview_rows(lines, delimiter)
    channels = []
    for column in range(width):
        pairs = [(s, values[column]) for s, values in stated if values.get(column)]
        over_frequency = is_over_hertz
        for statement, value in pairs:
            if statement.kind == "dimension":
                over_frequency = value.lower().startswith("freq")
        units = [v for s, v in pairs if s.kind == "units" and not is_no_unit(v)]
        starts = [_start(s, v, decimal) for s, v in pairs if s.kind == "start"]
        start = next(filter(None, reversed(starts)), None)
        start = _labview_start(labview, column, start) if labview else start
        clocks = [
            (_clock(s, v, decimal, time_unit, file), s.line)
            for s, v in pairs
            if s.kind in _CLOCKS and not over_frequency
        ]
        clock = _agreed(clocks, file)
        clock = clock and replace(clock, start=start)
        unit = without_brackets(units[0]) if units else ""
        channels.append(Channel("", None, clock, False, unit, over_frequency, start))
    return tuple(channels)


def _by_column(
    statement: HeadStatement, width: int, numeric: Sequence[int], x_column: int | None
) -> dict[int, str]:
    """Return column → value: one for all, one for each, or for each but the first.

    A single unit is that of a single ordinate.
    """
    values = statement.values
    if statement.kind == "start" and is_stamp(stamp := " ".join(values)):
        return dict.fromkeys(range(width), stamp)
    if statement.kind in ("rate", "interval", "start") and not statement.is_row:
        values = values[:1]
    is_clock = statement.kind in _CLOCKS
    if is_clock and len(values) == 2 and values[1] and not _NUMBER.match(values[1]):
        values = (" ".join(values),)  # the unit in a cell of its own
    if len(values) == 1 and statement.kind == "units":
        ordinates = [column for column in numeric if column != x_column]
        return dict.fromkeys(ordinates, values[0]) if len(ordinates) == 1 else {}
    if len(values) == 1:
        return dict.fromkeys(numeric, values[0])
    if len(values) == width:
        return dict(enumerate(values))
    is_of_ordinates = len(values) < width and (statement.is_row or len(values) == width - 1)
    return dict(enumerate(values, start=1)) if is_of_ordinates else {}


def _clock(statement: HeadStatement, value: str, decimal: str, time_unit: str, file: str) -> Clock:
    """Return the clock of a rate or interval; its unit decides which it is."""
    written = _NUMBER.match(value)
    text = written[1].rstrip(".,'") if written else ""
    number = _number(text, decimal)
    header_unit = (written[2] if written else "").strip("()[]{} .;") or statement.unit
    default = "Hz" if statement.kind == "rate" else time_unit or "s"
    unit = _unit(header_unit or default)
    if number is None or unit is None or not 1 / _MAX_RATE_HZ < number * unit.factor < _MAX_RATE_HZ:
        raise _unusable(statement, "a number above 0, in Hz or s or a multiple", file)
    kind = "rate" if unit.dimension == (("s", -1),) else "interval"
    digits, half_unit = _precision(text)
    size = number * unit.factor
    half_unit *= unit.factor
    if digits <= _EXACT_DIGITS[kind] or (kind == "rate" and half_unit >= 0.5):
        return Clock(float(f"{size if kind == 'rate' else 1.0 / size:.15g}"))
    if kind == "rate":
        return plainest_clock(1.0 / size, half_unit / size**2)
    return plainest_clock(size, half_unit)


def _number(text: str, decimal: str) -> float | None:
    """Return a number of a head; None for one that has two readings."""
    other_sign = "." if decimal == "," else ","
    if _GROUPED.fullmatch(text) and not re.fullmatch(rf"[+-]?\d+{re.escape(decimal)}\d+", text):
        return None
    text = text.replace(",", ".") if decimal == "," else text
    try:
        return None if other_sign == "," and "," in text else float(text)
    except ValueError:
        return None


def _precision(text: str) -> tuple[int, float]:
    """Return the number of significant digits as written, and half a unit of the last place."""
    mantissa, _, exponent = text.lower().replace(",", ".").partition("e")
    decimals = len(mantissa.partition(".")[2])
    digits = mantissa.lstrip("+-").replace(".", "").strip("0")
    return len(digits), 0.5 * 10.0 ** (int(exponent or 0) - decimals)


def _unit(text: str) -> Unit | None:
    """Return a unit of rate or time; None for another."""
    samples = _SAMPLES_PER_SECOND.match(text)
    if samples:
        return Unit(_PREFIXES[samples["prefix"].lower()], (("s", -1),))
    plain = (text.split() or [""])[0].strip("()[]{}.,; ")
    parsed = None if plain == "mhz" else parse_unit(re.sub(r"^K(?=Hz)", "k", plain))
    return parsed if parsed and parsed.dimension in ((("s", 1),), (("s", -1),)) else None


def _agreed(stated: Sequence[tuple[Clock, HeadLine]], file: str) -> Clock | None:
    """Return the least rounded of the clocks; InputError where two contradict each other."""
    clocks = sorted(stated, key=lambda pair: pair[0].rate_rounding)
    numbers = sorted({line.number for _, line in clocks})
    return agreed_clock(
        [(f"line {line.number}, {line.text.strip()[:60]!r},", clock) for clock, line in clocks],
        f"{file}, lines {' and '.join(map(str, numbers))}",
        "The head of the file states two sampling rates.",
        "correct or remove one of the two lines",
    )


def _unusable(statement: HeadStatement, expected: str, file: str) -> InputError:
    return InputError(
        f"The sampling {statement.kind} in the head of the file cannot be used.",
        expected=expected,
        found=repr(statement.line.text.strip()[:80]),
        where=f"{file}, line {statement.line.number}",
        remedy="correct or remove that line",
    )


def _start(statement: HeadStatement, value: str, decimal: str) -> StartTime | None:
    """Return a start in seconds, or at a time of day to fractions of a second; None for others."""
    if is_stamp(value):
        return _epoch(value) if has_fraction(value) else None
    written = _NUMBER.match(value)
    number = _number(written[1].rstrip(".,'"), decimal) if written else None
    unit = _unit((written[2] if written else "") or statement.unit or "s")
    if number is None or unit is None or abs(number) >= _MAX_RATE_HZ:
        return None
    return StartTime.on_own_clock(number * unit.factor)


def _labview_rows(lines: Sequence[HeadLine], delimiter: str) -> dict[str, list[str]]:
    """Return key → values of the last head of a LabVIEW measurement; nothing for another file."""
    if not any(line.text.strip().startswith(LABVIEW_END) for line in lines):
        return {}
    gap = None if delimiter == BLANKS else delimiter
    cells = [[cell.strip() for cell in line.text.rstrip().split(gap)] for line in lines]
    return {key.lower(): values for key, *values in cells if values}


def _labview_start(
    rows: dict[str, list[str]], column: int, start: StartTime | None
) -> StartTime | None:
    """Return a start by the date and time that X0 counts from, or 1904 (an absolute Time_Pref)."""

    def cell(key: str) -> str:
        values = rows.get(key, [""])
        return values[0] if len(values) == 1 else "".join(values[max(column - 1, 0) :][:1])

    x0_ns = 0 if start is None else start.ns
    stamp = f"{cell('date')} {cell('time')}"
    begin = _epoch(stamp) if is_stamp(stamp) else None
    if x0_ns and cell("time_pref").lower() == "absolute":
        return StartTime(x0_ns + _LABVIEW_EPOCH_S * 10**9, epoch=True)
    return start if begin is None else StartTime(begin.ns + x0_ns, epoch=True)


def _epoch(stamp: str) -> StartTime | None:
    """Return the start that a single stamp states; None for a date with two readings."""
    try:
        parsed = parse_stamps([stamp], frozenset(), lambda row: "")
    except InputError:
        return None
    return StartTime(int(parsed.ns[0]), epoch=parsed.dated)
