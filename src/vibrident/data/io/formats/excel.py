"""Excel workbooks: the columns of numbers of all sheets, below their names and a row of units.

A column of another sheet than the first is "Sheet!column", as in a formula, or "Sheet/column".
"""

from __future__ import annotations

import itertools
import math
import warnings
import zipfile
from array import array
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime, time, timedelta
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
from vibrident.data.io.text_head import HeadLine, read_head
from vibrident.data.io.title_rows import names_and_units
from vibrident.data.io.units import without_brackets
from vibrident.data.records import FloatArray

_MAX_HEAD_ROWS = 200  # above the names
_ERRORS = frozenset({"#N/A", "#DIV/0!", "#VALUE!", "#REF!", "#NAME?", "#NUM!", "#NULL!"})
_GAP = "\t"  # between the cells of a head, which is read as that of a text file
_Row = Sequence[Any]


@dataclass
class _SheetColumn:
    """The cells of a column, as they come."""

    values: array[float]
    first: datetime | None = None  # of a column of dates
    kinds: set[str] = field(default_factory=set)  # "number", "time", or a text of the column
    filled: int = 0  # rows without the empty ones at the end

    def add(self, cell: Any) -> None:
        """Append a cell; dates as seconds since the first, empty ones and errors as NaN."""
        kind = "number" if _is_number(cell) else f"text such as {str(cell)[:40]!r}"
        if isinstance(cell, datetime):
            self.first = self.first or cell
            cell -= self.first
        elif isinstance(cell, time):
            cell = datetime.combine(datetime.min, cell) - datetime.min
        value = math.nan
        if isinstance(cell, timedelta):
            kind = "time"
            value = cell.total_seconds()
        elif kind == "number" and cell not in _ERRORS:
            value = float(cell)
        self.values.append(value)
        if cell is not None:
            self.kinds.add(kind)
            self.filled = len(self.values)


class ExcelFile(ColumnFile):
    """A workbook, values as they were last computed; a cell without a number becomes NaN."""

    expected = "an Excel workbook (.xlsx) whose sheets have columns of numbers"
    word = "column"

    def __init__(self, path: Path) -> None:
        openpyxl = library("openpyxl", "excel", path)
        channels: list[Channel] = []
        refused: dict[str, str] = {}
        self._sheets: list[str] = []
        self._numbered = 0
        with reading(path, self.expected):
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

    def _read(self, handles: Sequence[array[float]]) -> Iterator[FloatArray]:
        return (np.array(values, dtype=np.float64) for values in handles)

    def _take(
        self, rows: Iterator[_Row], channels: list[Channel], refused: dict[str, str], path: Path
    ) -> None:
        """Append the columns of a sheet, the last of ``_sheets``."""
        is_first = len(self._sheets) == 1
        head, data = _split(rows)
        columns = _columns(data)
        count = len(columns)
        titles = [_texts(row) + [""] * count for row in head]
        names, units = names_and_units([row for row in titles if any(row)], _GAP, count)
        lines = [HeadLine(n, _GAP.join(row)) for n, row in enumerate(titles, start=1)]
        where = f"{path}, sheet {self._sheets[-1]!r}"
        facts = read_head(lines, _GAP, ".", count, range(count), None, where)
        for n, column in enumerate(columns):
            name = names[n] if is_first else f"{self._sheets[-1]}!{names[n] or n + 1}"
            if column.kinds not in ({"number"}, {"time"}):
                kinds = sorted(column.kinds - {"number"}) or ["no numbers"]
                refused[name or f"column {n + 1}"] = f"a column with {kinds[-1]}"
                continue
            unit = without_brackets(units[n]) or facts[n].unit
            is_time = "time" in column.kinds
            clock = None if is_time else facts[n].clock
            start = None
            if column.first is not None:
                start = StartTime.on_date(np.datetime64(column.first))
            values = column.values[: column.filled]
            channels.append(Channel(name, values, clock, is_time, unit, start=start))
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


def _columns(rows: Iterable[_Row]) -> list[_SheetColumn]:
    columns: list[_SheetColumn] = []
    for count, row in enumerate(rows):
        while len(columns) < len(row):
            columns.append(_SheetColumn(array("d", itertools.repeat(math.nan, count))))
        for column, cell in itertools.zip_longest(columns, row):
            column.add(cell)
    return columns


def _split(rows: Iterator[_Row]) -> tuple[list[_Row], Iterable[_Row]]:
    """Return the rows above the numbers, and the others.

    A row of a text and one number, such as "Serial number" and 1234, is above them if names follow.
    """
    above: list[_Row] = []
    for row in rows:
        above.append(row)
        numbers = sum(map(_is_number, row))
        first = next((cell for cell in row if cell is not None), None)
        if numbers > 1 or (numbers and _is_number(first)) or len(above) == _MAX_HEAD_ROWS:
            break
    with_numbers = [n for n, row in enumerate(above) if any(map(_is_number, row))]
    below_names = [
        n for n in with_numbers if n and n - 1 not in with_numbers and any(_texts(above[n - 1]))
    ]
    start = (below_names[-1:] or with_numbers or [0])[0]
    return above[:start], itertools.chain(above[start:], rows)


def _texts(row: _Row) -> list[str]:
    return ["" if cell is None else str(cell).strip() for cell in row]


def _is_number(cell: Any) -> bool:
    """Return whether a cell is a number, a time, or an error in place of one."""
    if isinstance(cell, str):
        return cell in _ERRORS
    return isinstance(cell, int | float | datetime | timedelta | time) and not isinstance(
        cell, bool
    )


EXCEL = Reader(name="excel", title="Excel", endings=(".xlsx", ".xlsm"), open=ExcelFile)
