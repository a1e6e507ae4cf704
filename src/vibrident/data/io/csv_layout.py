"""Find the layout of a text file of numbers: delimiter, decimal sign, titles and first row."""

from __future__ import annotations

import contextlib
import csv
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from vibrident.base.errors import InputError
from vibrident.data.io.columns import MAX_LINE_LENGTH, Channel, reading
from vibrident.data.io.plain_text import BLANKS, PlainText, respelled
from vibrident.data.io.text_head import (
    LABVIEW_END,
    HeadLine,
    is_statement,
    read_head,
)
from vibrident.data.io.title_rows import (
    COMMENTS,
    TIME_NAMES,
    columns_of,
    keys_over_values,
    names_and_units,
)
from vibrident.data.io.vocabulary import VOCABULARY

TEXT_OF_COLUMNS = "a text file of columns"
_MAX_HEAD_BYTES = MAX_LINE_LENGTH
_MAX_HEAD_LINES = 400
_MAX_SAMPLE_LINES = 25
_MIN_GROUPED = 8  # numbers of a column that look as if they had separators of thousands
_BOM = b"\xef\xbb\xbf"
_COMMENT = ("#", "%")
_EXPONENT = r"(?:[eE][+-]?\d+)?"
_NUMBER = {
    ".": re.compile(rf"[+-]?(?:\d+\.?\d*|\.\d+){_EXPONENT}|[+-]?inf(?:inity)?", re.IGNORECASE),
    ",": re.compile(rf"[+-]?(?:\d+(?:,\d+)?|,\d+){_EXPONENT}|[+-]?inf(?:inity)?", re.IGNORECASE),
}
_ODD = re.compile(r'[^0-9.,;eE" \t\r+-]|[+-](?![0-9.,])')  # beside plain numbers
_LETTER = re.compile(r"[\w%°]")  # a line of dashes below the titles has none
_DECIMAL_COMMA = re.compile(r"\d,\d")
#: What pandas takes for a missing value.
NO_VALUE = frozenset(VOCABULARY["missing"])
#: Delimiters and decimal signs, tried in this order; an earlier pair wins a tie. The comma is both
#: only in quoted cells.
_CANDIDATES = (
    *((";", "."), (";", ","), ("\t", "."), ("\t", ","), (",", "."), (BLANKS, "."), (BLANKS, ",")),
    (",", ","),
)
#: Two Chinese characters of GB 2312, which no text in Latin-1 holds side by side.
_CHINESE = re.compile(r"[\u4e00-\u9fff]{2}")
#: A number with separators of thousands: two of them, another sign behind, or a blank tell.
_GROUPED = re.compile(
    r"[+-]?\d{1,3}(?:([,.' \u00a0\u202f])\d{3}(?:(?:\1\d{3})+(?:[.,]\d+)?|(?!\1)[.,]\d+)"
    r"|[' \u00a0\u202f]\d{3})"
)


@dataclass(frozen=True)
class Dialect:
    """Delimiter and decimal sign of the cells of a text, and their number in a line.

    Attributes:
        delimiter: one character; ``BLANKS`` stands for runs of blanks and tabs.
        decimal: "." or ",".
        fields: number of fields in a data line, an empty one after a trailing separator included.
    """

    delimiter: str
    decimal: str
    fields: int

    def split(self, line: str) -> list[str]:
        """Split one line into its cells, without quotes and without blanks around them."""
        gap = self.delimiter
        if '"' in line:
            with contextlib.suppress(csv.Error):  # a cell beyond its limits is not a number
                plain = line.strip(" \r\n").replace("\r", " ")
                plain = plain.replace("\t", " ") if gap == BLANKS else plain
                cells = next(csv.reader([plain], delimiter=gap, skipinitialspace=True))
                return [cell.strip() for cell in cells]
        if gap == BLANKS:
            return line.split()
        return [cell.strip() for cell in line.strip("\r\n").split(gap)]

    def is_number(self, cell: str) -> bool:
        """Return whether the cell is a number, written with this decimal sign."""
        return _NUMBER[self.decimal].fullmatch(cell) is not None

    def columns_with_text(self, row: Sequence[str], numeric: Sequence[int]) -> list[int]:
        """Return the columns of numbers that hold text in this row."""
        return [
            column
            for column in numeric
            if column < len(row) and not self.is_number(row[column]) and row[column] not in NO_VALUE
        ]


@dataclass(frozen=True)
class CsvLayout(Dialect):
    """Layout of a text file of numbers.

    Attributes:
        names: of the columns; all "" without a header.
        units: row of units below the names; all "" without one.
        first_line: number of the first data line, from 1.
        offset: of that line in the file, bytes.
        encoding: of the plain bytes.
        has_comments: whether a remark may follow the cells of a row.
        facts: statements of the head about each column.
        read_head: reads a further head in the same layout.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    first_line: int
    offset: int
    encoding: str
    has_comments: bool
    facts: tuple[Channel, ...]
    read_head: Callable[[Sequence[HeadLine]], tuple[Channel, ...]]


def open_text(path: Path) -> tuple[PlainText, CsvLayout]:
    """Open a text file and find its layout from its first lines.

    InputError where it cannot be read or has no rows of numbers.
    """
    with reading(path, TEXT_OF_COLUMNS):
        text = PlainText(path)
        with text.open() as stream:
            head = stream.read(_MAX_HEAD_BYTES)
            is_complete = not stream.read(1)
        return text, _layout_of(*_head_lines(head, is_complete, str(path)), head, str(path))


def line_too_long(file: str, line: int) -> InputError:
    """Return the error of a line that is too long for a table of numbers."""
    return InputError(
        "A line of the file is too long.",
        expected=f"lines of at most {MAX_LINE_LENGTH} characters",
        found="a longer one",
        where=f"{file}, line {line}",
        remedy="export the data with one sample a line, and only the columns that are needed",
    )


def _head_lines(head: bytes, is_complete: bool, file: str) -> tuple[list[str], str]:
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
            expected="text in UTF-8, UTF-16 or Latin-1",
            found="zero bytes, as in a binary file",
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
    if not is_complete and b"\n" not in head:
        raise line_too_long(file, 1)
    head_of_lines = head if is_complete else head[: head.rfind(b"\n") + 1]
    try:
        text = head_of_lines.decode("utf-8-sig")
        encoding = "utf-8"
    except UnicodeDecodeError:
        text, encoding = _decoded_otherwise(head_of_lines)
    return text.split("\n")[:_MAX_HEAD_LINES], encoding


def _decoded_otherwise(data: bytes) -> tuple[str, str]:
    """Return text that is not UTF-8, and its encoding: GB 2312 (Chinese) or Latin-1."""
    try:
        text = data.decode("gb2312")
    except UnicodeDecodeError:
        text = ""
    return (text, "gb18030") if _CHINESE.search(text) else (data.decode("latin-1"), "latin-1")


def _layout_of(lines: list[str], encoding: str, head: bytes, file: str) -> CsvLayout:
    """Return the layout of a file.

    Args:
        lines: of its beginning.
        encoding: of them.
        head: the same, as bytes.
        file: for messages.
    """
    plain = [respelled(line, ",;\t ") if _ODD.search(line) else line for line in lines]
    rows = [i for i, line in enumerate(plain) if line.strip() and not _is_comment(line)]
    sample = rows[len(rows) // 2 :][-_MAX_SAMPLE_LINES:]
    dialect = _dialect([plain[i] for i in sample], [plain[i] for i in rows])
    delimiter = dialect.delimiter
    fields = dialect.fields
    cells = {i: dialect.split(plain[i]) for i in rows}
    numeric = _numeric_columns([cells[i] for i in sample if len(cells[i]) == fields], dialect)
    has_comments = any(
        len(row) == fields + 1 and row[-1].lower() in COMMENTS for row in cells.values()
    )
    if has_comments:
        cells = {i: row[:fields] for i, row in cells.items()}
    first = _first_row(cells, lines, numeric, dialect)
    if first is None:
        for i in sample:
            for cell in cells[i]:
                refuse_thousands(cell, f"{file}, line {i + 1}")
        raise _no_rows([lines[i] for i in rows], file)
    where = f"{file}, line {first + 1}"
    head_cells = {i: dialect.split(lines[i]) for i in rows if i < first}
    _refuse_commas_of_two_kinds([cells[i] for i in head_cells], dialect, where)
    texts = dialect.columns_with_text(cells[first], numeric)
    if texts:  # half header, half data: dropping or using it would be a guess
        raise InputError(
            "The first row of numbers holds text.",
            expected="a number in every column that holds numbers further down",
            found=f"{cells[first][texts[0]][:40]!r} in column {texts[0] + 1}",
            where=where,
            remedy="repair the value; or, if the line belongs to the header, put # in front of it",
        )
    data = {i: row for i, row in cells.items() if i >= first}
    _refuse_grouped_integers(data, numeric, dialect, file)
    width = columns_of([*data.values()], [*head_cells.values()][-2:], fields)
    titles = _titles(lines[:first], head_cells, dialect)
    names, units = names_and_units(titles, delimiter, width)
    head_lines = [HeadLine(i + 1, line) for i, line in enumerate(lines[:first])]
    head_lines += keys_over_values(head_cells, width)
    # Statements may stand in columns of text beside the numbers, in the first rows only.
    text_width = numeric[0] if numeric[0] > 1 and not any(cells[sample[-1]][: numeric[0]]) else 0
    if text_width:
        head_lines += [HeadLine(i + 1, delimiter.join(row[:text_width])) for i, row in data.items()]
    read = partial(
        read_head,
        delimiter=delimiter,
        decimal=dialect.decimal,
        width=width,
        file=file,
        numeric=numeric,
        x_column=next((i for i in numeric if TIME_NAMES.match(names[i])), text_width or None),
    )
    return CsvLayout(
        delimiter=delimiter,
        decimal=dialect.decimal,
        fields=fields,
        names=names,
        units=units,
        first_line=first + 1,
        offset=_offset_of_line(head, first),
        encoding=encoding,
        has_comments=has_comments,
        facts=read(head_lines),
        read_head=read,
    )


def _titles(
    head: Sequence[str], cells: Mapping[int, list[str]], dialect: Dialect
) -> list[list[str]]:
    """Return the rows above the data that name columns: uncommented ones, else comments.

    Args:
        head: lines above the data.
        cells: line's index to its cells, of the lines that are no comments.
        dialect: of the cells.
    """
    titles = [
        row
        for i, row in cells.items()
        if not is_statement(head[i], dialect.delimiter) and _LETTER.search(head[i])
    ]
    if titles:
        return titles
    comments = [
        dialect.split(line.lstrip("#% "))
        for line in head
        if _is_comment(line) and line.strip("#% \r") and not is_statement(line, dialect.delimiter)
    ]
    if comments and any(_NUMBER["."].fullmatch(cell) for cell in comments[-1]):
        return []  # the last comment is a row of data
    return comments


def _offset_of_line(head: bytes, index: int) -> int:
    """Return where a line of the file begins, in bytes; behind the byte-order mark."""
    if index == 0:
        return len(_BOM) if head.startswith(_BOM) else 0
    return sum(len(line) + 1 for line in head.split(b"\n", index)[:index])


def _numeric_columns(rows: Sequence[list[str]], dialect: Dialect) -> list[int]:
    """Return the columns most of whose cells hold numbers."""
    return [
        column
        for column in range(dialect.fields)
        if 2 * sum(dialect.is_number(row[column]) for row in rows) > len(rows)
    ]


def _first_row(
    cells: dict[int, list[str]], lines: Sequence[str], numeric: Sequence[int], dialect: Dialect
) -> int | None:
    """Return the first line of data; None where there is none."""
    last = next(reversed(cells), 0)
    is_labview = any(line.startswith(LABVIEW_END) for line in lines)
    for i, row in cells.items():
        numbers = [len(row) > column and dialect.is_number(row[column]) for column in numeric]
        excess = len(row) - dialect.fields
        is_longer = excess > 0 and dialect.delimiter != BLANKS and all(numbers)
        if not any(numbers) or (excess and not is_longer):
            continue
        if is_labview and row[0][:1].isalpha() and not cells[last][0]:
            continue  # a key above an empty column
        if all(numbers) or not is_statement(lines[i], dialect.delimiter):
            below = {j: row for j, row in cells.items() if j >= i}
            return _line_behind_names(below, numeric, dialect)
    return None


def _no_rows(lines: Sequence[str], file: str) -> InputError:
    return InputError(
        "The file holds no rows of numbers.",
        expected="rows of numbers, under a header line or without one",
        found=f"{len(lines)} lines of text" if lines else "only comments",
        where=f"{file}, first line: {lines[0].strip()[:60]!r}" if lines else file,
        remedy="export the data again; the file may hold the header alone",
    )


def refuse_thousands(cell: str, where: str) -> None:
    """Refuse a number with separators of thousands: its signs have two readings."""
    if _GROUPED.fullmatch(cell):
        raise _thousands(cell, where)


def _thousands(cell: str, where: str) -> InputError:
    return InputError(
        "A number has separators of thousands.",
        expected="numbers without them, such as 1234.5 or 1234,5",
        found=repr(cell),
        where=where,
        remedy="export the data without separators of thousands",
    )


def _refuse_grouped_integers(
    data: Mapping[int, list[str]], numeric: Sequence[int], dialect: Dialect, file: str
) -> None:
    """Refuse a column of 12.345 and 678: its decimal sign stands before three digits, or is absent.

    Decimals of a fixed number would stand in every row, others would be of different numbers.
    """
    grouped = re.compile(rf"[+-]?[1-9]\d{{0,2}}(?:{re.escape(dialect.decimal)}\d{{3}})+")
    for column in numeric:
        cells = {i: row[column] for i, row in data.items() if len(row) > column}
        lines = [i for i, cell in cells.items() if grouped.fullmatch(cell)]
        is_rest_short = all(
            len(cell.lstrip("+-")) <= 3 and cell.lstrip("+-").isdigit()
            for i, cell in cells.items()
            if not grouped.fullmatch(cell)
        )
        if is_rest_short and _MIN_GROUPED <= len(lines) < len(cells):
            raise _thousands(cells[lines[0]], f"{file}, line {lines[0] + 1}, column {column + 1}")


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(_COMMENT)


def _dialect(sample: list[str], lines: list[str]) -> Dialect:
    """Return the dialect that makes most cells of the sample numbers.

    One field a line is the last resort: "1,5" may be one number or two, usually two.
    """
    best = Dialect(BLANKS, ".", 1)
    best_score = 0.0
    for delimiter, decimal in _CANDIDATES:
        if delimiter != BLANKS and not any(delimiter in line for line in sample):
            continue
        dialect = Dialect(delimiter, decimal, 0)
        rows = [dialect.split(line) for line in sample]
        fields = _usual_length(rows, lines, dialect)
        regular = [row for row in rows if len(row) == fields]
        cells = [cell for row in regular for cell in row if cell]
        numbers = sum(
            dialect.is_number(cell) or _GROUPED.fullmatch(cell) is not None for cell in cells
        )
        score = numbers / max(len(cells), 1) * len(regular) / max(len(rows), 1)
        if fields > 1 and score > best_score:
            best = replace(dialect, fields=fields)
            best_score = score
    if best.decimal == "." and best.delimiter != ",":
        # by the whole head: the sample may hold integers alone
        cells = [cell for line in lines for cell in best.split(line)]
        commas = sum(
            _NUMBER[","].fullmatch(cell) is not None and _DECIMAL_COMMA.search(cell) is not None
            for cell in cells
        )
        points = sum(best.is_number(cell) and "." in cell for cell in cells)
        best = replace(best, decimal=",") if commas > points else best
    return best


def _usual_length(sample: list[list[str]], lines: list[str], dialect: Dialect) -> int:
    """Return the most frequent length in the sample; of equal ones, that in all lines."""
    in_sample = Counter(map(len, sample))
    if len(in_sample) == 1:
        return next(iter(in_sample))
    in_all = Counter(len(dialect.split(line)) for line in lines)
    return max(in_sample, key=lambda length: (in_sample[length], in_all[length]), default=1)


def _line_behind_names(rows: dict[int, list[str]], numeric: Sequence[int], dialect: Dialect) -> int:
    """Return the first data line: behind names, if each line above has text among its numbers."""
    last: list[int] = []
    for line, row in rows.items():
        texts = dialect.columns_with_text(row, numeric)
        if not any(row):
            continue
        if not texts:
            return line if last and len(last) == len(numeric) else next(iter(rows))
        last = texts
    return next(iter(rows))


def _refuse_commas_of_two_kinds(above: list[list[str]], dialect: Dialect, where: str) -> None:
    """Refuse rows with twice as many cells as names: commas are both decimal sign and delimiter."""
    headers = [row for row in above if not any(map(_NUMBER["."].fullmatch, row))]
    names = len(headers[-1]) if headers else 0
    if dialect.delimiter == "," and names > 1 and dialect.fields == 2 * names:
        raise InputError(
            "The commas of the file have two meanings.",
            expected=f"{names} numbers in a row, as there are names above",
            found=f"{dialect.fields} cells between commas; the comma is the decimal sign, too",
            where=where,
            remedy="export the data with semicolons or tabs between columns, or decimal points",
        )
