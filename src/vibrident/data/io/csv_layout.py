"""Layout of a text file of numbers, from its head: delimiter, decimal sign, header, first data line."""

from __future__ import annotations

import contextlib
import csv
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from vibrident.base.errors import InputError
from vibrident.data.io.columns import LONGEST_LINE, unreadable

#: Stands for one or more blanks or tabs.
BLANKS = " "

_HEAD_BYTES = LONGEST_LINE
_HEAD_LINES = 400
_SAMPLE_LINES = 25
_BOM = b"\xef\xbb\xbf"
_COMMENT = ("#", "%")
_EXPONENT = r"(?:[eE][+-]?\d+)?"
_NUMBER = {
    ".": re.compile(rf"[+-]?(?:\d+\.?\d*|\.\d+){_EXPONENT}|[+-]?inf(?:inity)?", re.IGNORECASE),
    ",": re.compile(rf"[+-]?(?:\d+(?:,\d+)?|,\d+){_EXPONENT}|[+-]?inf(?:inity)?", re.IGNORECASE),
}
_DECIMAL_COMMA = re.compile(r"\d,\d")
_MISSING = frozenset({"", "nan", "-nan", "na", "n/a", "#n/a", "null", "none", "<na>"})
#: Tried in this order; an earlier one wins a tie. The comma is both delimiter and decimal sign in quoted cells only.
_CANDIDATES = (
    *((";", "."), (";", ","), ("\t", "."), ("\t", ","), (",", "."), (BLANKS, "."), (BLANKS, ",")),
    (",", ","),
)
#: Two Chinese characters of GB 2312, which no text in Latin-1 holds side by side.
_CHINESE = re.compile(r"[\u4e00-\u9fff]{2}")
#: Names above a column that the rows do not have (LabVIEW).
_NO_COLUMN = frozenset({"", "comment", "comments"})
_UNIT = re.compile(
    r"[\[(<].*[\])>]|-|%|°|°C|deg|rad|dB|[numkMµμ]?(?:s|Hz|V|A|g|m|N|Pa|C|Ohm|Ω)|counts?|LSB|ticks?"
    r"|[numkµμ]?(?:m|g|V|C|A)\s*/.*|mV/.*"
)


@dataclass(frozen=True)
class CsvLayout:
    """Layout of a text file of numbers."""

    delimiter: str  # one character; ``BLANKS`` stands for runs of blanks and tabs
    decimal: str  # "." or ","
    fields: int  # fields in every data line, including an empty one behind a trailing separator
    names: tuple[str, ...]  # one a column; all "" without a header
    units: tuple[str, ...]  # the row of units below the names; all "" without one
    first_line: int  # number of the first data line, from 1
    offset: int  # position of that line, in bytes
    encoding: str  # of the text


def split_line(line: str, delimiter: str) -> list[str]:
    """Split one line into its cells, without quotes and without blanks around them."""
    if '"' in line:
        with contextlib.suppress(
            csv.Error
        ):  # a cell beyond the csv module's limits is not a number
            plain = line.strip(" \r\n").replace("\r", " ")
            plain = plain.replace("\t", " ") if delimiter == BLANKS else plain
            return [
                cell.strip()
                for cell in next(csv.reader([plain], delimiter=delimiter, skipinitialspace=True))
            ]
    if delimiter == BLANKS:
        return line.split()
    return [cell.strip() for cell in line.strip("\r\n").split(delimiter)]


def is_number(cell: str, decimal: str) -> bool:
    """Tell whether the cell is a number, written with this decimal sign."""
    return _NUMBER[decimal].fullmatch(cell) is not None


def detect_layout(path: Path, file: str) -> CsvLayout:
    """Find the layout of a text file from its first lines; InputError where it holds no rows of numbers."""
    try:
        with path.open("rb") as stream:
            head = stream.read(_HEAD_BYTES)
            whole = not stream.read(1)
    except OSError as error:
        raise unreadable(file, error, "a text file of columns") from error
    return _layout_of(*_head_lines(head, whole, file), head, file)


def too_long_a_line(file: str, line: int) -> InputError:
    """The error of a line that is too long for a table of numbers."""
    return InputError(
        "A line of the file is too long.",
        expected=f"lines of at most {LONGEST_LINE} characters",
        found="a longer one",
        where=f"{file}, line {line}",
        remedy="export the data with one sample a line, and only the columns that are needed",
    )


def _head_lines(head: bytes, whole: bool, file: str) -> tuple[list[str], str]:
    if not head.removeprefix(_BOM).strip():
        raise InputError(
            "The file is empty.",
            expected="a header line (optional) and rows of numbers",
            found=f"{len(head)} bytes, none of them a number",
            where=file,
            remedy="export the data again",
        )
    if b"\0" in head:
        raise InputError(
            "The file is not plain text.",
            expected="text in UTF-8 or Latin-1",
            found="zero bytes, as in a binary file or UTF-16",
            where=file,
            remedy="save it as UTF-8 text, or give the file its right ending",
        )
    if b"\n" not in head and b"\r" in head:
        raise InputError(
            "The lines of the file end with a bare carriage return.",
            expected="line feed, or carriage return and line feed",
            found="carriage returns only",
            where=file,
            remedy="save it with the line ends of Windows or Unix",
        )
    if not whole and b"\n" not in head:
        raise too_long_a_line(file, 1)
    complete = head if whole else head[: head.rfind(b"\n") + 1]
    try:
        text, encoding = complete.decode("utf-8-sig"), "utf-8"
    except UnicodeDecodeError:
        text, encoding = _national(complete)
    return text.split("\n")[:_HEAD_LINES], encoding


def _national(data: bytes) -> tuple[str, str]:
    """Text that is not UTF-8, and its encoding: Chinese (GB 2312) or Western European."""
    try:
        text = data.decode("gb2312")
    except UnicodeDecodeError:
        text = ""
    return (text, "gb18030") if _CHINESE.search(text) else (data.decode("latin-1"), "latin-1")


def _layout_of(lines: list[str], encoding: str, head: bytes, file: str) -> CsvLayout:
    rows = [i for i, line in enumerate(lines) if line.strip() and not _is_comment(line)]
    sample = [lines[i] for i in rows[len(rows) // 2 :][-_SAMPLE_LINES:]]
    delimiter, decimal, fields = _dialect(sample, [lines[i] for i in rows])
    if decimal == "." and delimiter != ",":
        decimal = _decimal_of([lines[i] for i in rows], delimiter)
    regular = [row for line in sample if len(row := split_line(line, delimiter)) == fields]
    numeric = [
        n
        for n in range(fields)
        if 2 * sum(is_number(row[n], decimal) for row in regular) > len(regular)
    ]
    cells = {i: split_line(lines[i], delimiter) for i in rows}
    first = next(
        (
            i
            for i, row in cells.items()
            if len(row) == fields and any(is_number(row[n], decimal) for n in numeric)
        ),
        None,
    )
    if first is None:
        raise InputError(
            "The file holds no rows of numbers.",
            expected="rows of numbers, under a header line or without one",
            found=f"{len(rows)} lines of text" if rows else "only comments",
            where=f"{file}, first line: {lines[rows[0]].strip()[:60]!r}" if rows else file,
            remedy="export the data again; the file may hold the header alone",
        )
    first = _behind_names({i: row for i, row in cells.items() if i >= first}, numeric, decimal)
    head_cells = [row for i, row in cells.items() if i < first]
    _refuse_commas_of_two_kinds(head_cells, delimiter, fields, f"{file}, line {first + 1}")
    _refuse_mixed_first_row(cells[first], numeric, decimal, f"{file}, line {first + 1}")
    data = (row for i, row in cells.items() if i >= first)
    trailing = fields > 1 and all(
        len(row) != fields or row[-1] == "" for row in data
    )  # a separator at the end
    columns = fields - 1 if trailing else fields
    names, units = _names(lines[:first], head_cells, delimiter, columns)
    offset = 0
    for _ in range(first):
        offset = head.index(b"\n", offset) + 1
    if first == 0 and head.startswith(_BOM):
        offset = len(_BOM)
    return CsvLayout(delimiter, decimal, fields, names, units, first + 1, offset, encoding)


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(_COMMENT)


def _dialect(sample: list[str], lines: list[str]) -> tuple[str, str, int]:
    """Return delimiter, decimal sign and number of fields that make most of the sample's cells numbers.

    One field a line is the last resort: "1,5" may be one number or two, usually two.
    """
    best, best_score = (BLANKS, ".", 1), 0.0
    for delimiter, decimal in _CANDIDATES:
        if delimiter != BLANKS and not any(delimiter in line for line in sample):
            continue
        rows = [split_line(line, delimiter) for line in sample]
        fields = _usual_length(rows, lines, delimiter)
        regular = [row for row in rows if len(row) == fields]
        numbers = sum(is_number(cell, decimal) for row in regular for cell in row)
        filled = sum(cell != "" for row in regular for cell in row)
        score = numbers / max(filled, 1) * len(regular) / max(len(rows), 1)
        if fields > 1 and score > best_score:
            best, best_score = (delimiter, decimal, fields), score
    return best


def _usual_length(sample: list[list[str]], lines: list[str], delimiter: str) -> int:
    """Return the most frequent length in the sample; of equally frequent ones, that in all lines."""
    in_sample = Counter(map(len, sample))
    if len(in_sample) == 1:
        return next(iter(in_sample))
    in_all = Counter(len(split_line(line, delimiter)) for line in lines)
    return max(in_sample, key=lambda length: (in_sample[length], in_all[length]), default=1)


def _decimal_of(lines: list[str], delimiter: str) -> str:
    """Tell the decimal sign from the whole head: the sample may hold integers alone."""
    cells = [cell for line in lines for cell in split_line(line, delimiter)]
    commas = sum(is_number(cell, ",") and _DECIMAL_COMMA.search(cell) is not None for cell in cells)
    points = sum(is_number(cell, ".") and "." in cell for cell in cells)
    return "," if commas > points else "."


def _texts(row: list[str], numeric: list[int], decimal: str) -> list[int]:
    """Columns of numbers that hold text in this row."""
    return [
        column
        for column in numeric
        if column < len(row)
        and not is_number(row[column], decimal)
        and row[column].lower() not in _MISSING
    ]


def _behind_names(rows: dict[int, list[str]], numeric: list[int], decimal: str) -> int:
    """The first data line: behind a row of names, if each line above has text among its numbers ("Channels, 2")."""
    last: list[int] = []
    for line, row in rows.items():
        texts = _texts(row, numeric, decimal)
        if not texts:
            return line if last and len(last) == len(numeric) else next(iter(rows))
        last = texts
    return next(iter(rows))


def _refuse_commas_of_two_kinds(
    above: list[list[str]], delimiter: str, fields: int, where: str
) -> None:
    """Refuse rows with twice as many cells as names: commas are both decimal sign and delimiter."""
    headers = [row for row in above if not any(is_number(cell, ".") for cell in row)]
    names = len(headers[-1]) if headers else 0
    if delimiter == "," and names > 1 and fields == 2 * names:
        raise InputError(
            "The commas of the file have two meanings.",
            expected=f"{names} numbers in a row, as there are names above",
            found=f"{fields} cells between commas; the comma is the decimal sign, too",
            where=where,
            remedy="export the data with semicolons or tabs between the columns, or with decimal points",
        )


def _refuse_mixed_first_row(row: list[str], numeric: list[int], decimal: str, where: str) -> None:
    """Refuse a line that is half header, half data: dropping or using it would be a guess."""
    text = _texts(row, numeric, decimal)
    if text:
        raise InputError(
            "The first row of numbers holds text.",
            expected="a number in every column that holds numbers further down",
            found=f"{row[text[0]][:40]!r} in column {text[0] + 1}",
            where=where,
            remedy="repair the value; or, if the line belongs to the header, put # in front of it",
        )


def _names(
    lines: list[str], cells: list[list[str]], delimiter: str, columns: int
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Take names and units from the lines above the data, a row of units below the names; or from the last comment."""
    without = ("",) * columns

    def fitting(row: list[str]) -> tuple[str, ...] | None:
        if columns == 1 and delimiter == BLANKS:
            return (" ".join(row),)  # the name of a single column may contain blanks
        trimmed = row[:-1] if len(row) == columns + 1 and row[-1].lower() in _NO_COLUMN else row
        return tuple(trimmed) if len(trimmed) == columns else None

    above = [fitting(row) for row in cells]
    if above and above[-1] is not None:
        names = above[-1]
        filled = [cell for cell in names if cell]
        units = bool(filled) and all(_UNIT.fullmatch(cell) for cell in filled)
        if units and len(above) > 1 and above[-2] is not None:
            return above[-2], names
        return names, without
    comments = [line for line in lines if _is_comment(line)]
    if comments and not above:
        names = fitting(split_line(comments[-1].strip().lstrip("#% "), delimiter))
        if (
            names is not None
            and (columns > 1 or names[0])
            and not any(is_number(name, ".") for name in names)
        ):
            return names, without
    return without, without
