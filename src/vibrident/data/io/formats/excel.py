"""Excel workbooks: the columns of numbers of all sheets, below their names and a row of units.

A column of another sheet than the first is "Sheet!column", as in a formula, or "Sheet/column".
"""

from __future__ import annotations

import itertools
import math
import warnings
import zipfile
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, date, datetime, time, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.data.io.columns import (
    Channel,
    ColumnFile,
    StartTime,
    library,
    reading,
    require_few,
    require_room,
)
from vibrident.data.io.reader import Reader
from vibrident.data.io.stated import (
    Statement,
    clock_of,
    meaning_of,
    start_of,
    statements,
)
from vibrident.data.io.units import is_no_unit, parse_unit
from vibrident.data.records import FloatArray

_EXPECTED = "an Excel workbook (.xlsx) whose sheets have columns of numbers"
_MAX_HEAD_ROWS = 200  # above the names
_ERRORS = frozenset({"#N/A", "#DIV/0!", "#VALUE!", "#REF!", "#NAME?", "#NUM!", "#NULL!"})
_Row = Sequence[Any]


@dataclass
class _SheetColumn:
    """The cells of a column, as they come."""

    title: str
    unit: str
    values: array[float] = field(default_factory=lambda: array("d"))
    first: datetime | None = None  # of a column of dates
    kinds: set[str] = field(default_factory=set)  # "number", "time", or a text of the column
    filled: int = 0  # rows without the empty ones at the end

    def add(self, cell: Any) -> None:
        """Append a cell; dates as seconds since the first, empty ones and errors as NaN."""
        value = math.nan
        if isinstance(cell, datetime):
            self.first = self.first or cell
            value = (cell - self.first).total_seconds()
        elif isinstance(cell, timedelta):
            value = cell.total_seconds()
        elif isinstance(cell, time):
            since_midnight = datetime.combine(date.min, cell) - datetime.min
            value = since_midnight.total_seconds()
        elif _is_number(cell) and cell not in _ERRORS:
            value = float(cell)
        self.values.append(value)
        self.filled = self.filled if cell is None else len(self.values)
        if isinstance(cell, datetime | timedelta | time):
            self.kinds.add("time")
        elif cell is not None:
            self.kinds.add("number" if _is_number(cell) else f"text such as {str(cell)[:40]!r}")


class ExcelFile(ColumnFile):
    """A workbook, values as they were last computed; a cell without a number becomes NaN."""

    word = "column"

    def __init__(self, path: Path) -> None:
        openpyxl = library("openpyxl", "excel", path)
        channels: list[Channel] = []
        refused: dict[str, str] = {}
        self._sheets: list[str] = []
        self._numbered = 0
        with reading(path, _EXPECTED):
            with zipfile.ZipFile(path) as packed:  # a small file may unpack to a large one
                require_room(path, sum(member.file_size for member in packed.infolist()) // 8)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # parts of a workbook that openpyxl does not keep
                book = openpyxl.load_workbook(path, read_only=True, data_only=True)
                for sheet in book.worksheets:
                    self._sheets.append(sheet.title)
                    self._take(sheet.iter_rows(values_only=True), channels, refused, path)
                    require_few(path, channels, "columns")
            book.close()
        super().__init__(path, channels, refused)

    @property
    def numbered(self) -> tuple[int, ...]:
        """Return the columns of the first sheet."""
        return tuple(range(self._numbered))

    def load(self, positions: Sequence[int]) -> tuple[FloatArray, ...]:
        """Read these columns; each has shape (rows,). Times become seconds since the first."""
        handles = self._handles(positions)
        return tuple(np.array(values, dtype=np.float64) for values in handles)

    def _take(
        self, rows: Iterator[_Row], channels: list[Channel], refused: dict[str, str], path: Path
    ) -> None:
        """Append the columns of a sheet, the last of ``_sheets``."""
        is_first = len(self._sheets) == 1
        sheet_statements, columns = _read_sheet(rows)
        for number, column in enumerate(columns, start=1):
            name = column.title
            if not is_first:
                name = f"{self._sheets[-1]}!{name or number}"
            if column.kinds not in ({"number"}, {"time"}):
                kinds = sorted(column.kinds - {"number"}) or ["no numbers"]
                refused[name or f"column {number}"] = f"a column with {kinds[-1]}"
                continue
            is_time = "time" in column.kinds
            clock = None if is_time else clock_of([sheet_statements], f"{path}, column {name!r}")
            start = _start_of_dates(column.first) if is_time else start_of([sheet_statements])
            values = column.values[: column.filled]
            channels.append(Channel(name, values, clock, is_time, column.unit, start=start))
        if is_first:
            self._numbered = len(channels)

    def _plain_name(self, name: str) -> str:
        """Return the name in the form that ``names`` uses."""
        name = name.strip()
        for number, sheet in enumerate(self._sheets):
            for sign in "!/":
                if name.startswith(sheet + sign) and name not in self.names:
                    column = name.removeprefix(sheet + sign)
                    return f"{sheet}!{column}" if number else column
        return name


def _read_sheet(rows: Iterator[_Row]) -> tuple[Mapping[str, Statement], list[_SheetColumn]]:
    """Return what the rows above the names of a sheet state, and its columns."""
    head, data = _split(rows)
    sheet_statements = statements(dict(pair for row in head for pair in _statement(row)))
    titles = _texts(head[-1]) if head else []
    units: list[str] = []
    if len(head) > 1 and _are_units(titles) and any(_texts(head[-2])):
        units = [unit.strip("[](){} ") for unit in titles]
        titles = _texts(head[-2])
    columns: list[_SheetColumn] = []
    for count, row in enumerate(data):
        while len(columns) < len(row):
            n = len(columns)
            title = titles[n] if n < len(titles) else ""
            columns.append(_SheetColumn(title, units[n] if n < len(units) else ""))
            columns[n].values.extend(itertools.repeat(math.nan, count))
        for column, cell in itertools.zip_longest(columns, row):
            column.add(cell)
    return sheet_statements, columns


def _split(rows: Iterator[_Row]) -> tuple[list[_Row], Iterable[_Row]]:
    """Return the rows above the numbers, and the others.

    A row of a text and one number, such as "Serial number" and 1234, is above them if names follow.
    """
    rows = itertools.dropwhile(_is_empty, rows)
    above: list[_Row] = []
    for row in rows:
        above.append(row)
        numbers = sum(_is_number(cell) for cell in row)
        first = next((cell for cell in row if cell is not None), None)
        if numbers > 1 or (numbers and _is_number(first)) or len(above) == _MAX_HEAD_ROWS:
            break
    has_numbers = [any(_is_number(cell) for cell in row) for row in above]
    titles = [
        n
        for n, row in enumerate(above[:-1])
        if not has_numbers[n] and not _is_empty(row) and has_numbers[n + 1]
    ]
    start = titles[-1] + 1 if titles else next((n for n, has in enumerate(has_numbers) if has), 0)
    head = [row for row in above[:start] if not _is_empty(row)]
    return head, itertools.chain(above[start:], rows)


def _statement(row: _Row) -> Iterator[tuple[str, Any]]:
    """Yield the statement of a row of the head: a name, its value, and perhaps a unit."""
    filled = [cell for cell in row if cell is not None]
    if len(filled) == 1 and isinstance(filled[0], str):
        name, _, value = filled[0].replace("=", ":", 1).partition(":")
        filled = [name, value.strip()]
    if len(filled) in (2, 3) and isinstance(filled[0], str) and filled[1] != "":
        name = filled[0].strip(" :=")
        if len(filled) == 3:
            name = f"{name} {filled[2]}"
        if meaning_of(name)[0] in ("rate", "interval", "start"):
            yield name, filled[1]


def _texts(row: _Row) -> list[str]:
    return ["" if cell is None else str(cell).strip() for cell in row]


def _are_units(row: Sequence[str]) -> bool:
    """Return whether the cells of a row are units, or words for none."""
    units = [unit for unit in row if parse_unit(unit) is not None]
    return bool(units) and all(is_no_unit(unit) or unit in units for unit in row)


def _is_empty(row: _Row) -> bool:
    return all(cell is None for cell in row)


def _is_number(cell: Any) -> bool:
    """Return whether a cell is a number, a time, or an error in place of one."""
    if isinstance(cell, str):
        return cell in _ERRORS
    return isinstance(cell, int | float | datetime | timedelta | time) and not isinstance(
        cell, bool
    )


def _start_of_dates(first: datetime | None) -> StartTime | None:
    if first is None:
        return None
    since = first.replace(tzinfo=UTC) - datetime(1970, 1, 1, tzinfo=UTC)
    return StartTime(since // timedelta(microseconds=1) * 1000, epoch=True)


EXCEL = Reader(name="excel", title="Excel", endings=(".xlsx", ".xlsm"), open=ExcelFile)
