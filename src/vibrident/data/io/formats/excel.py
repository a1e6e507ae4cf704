"""Excel workbooks: the columns of numbers of the first sheet, below a row of names where there is one."""

from __future__ import annotations

import datetime
import warnings
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vibrident.data.io.columns import Channel, ColumnFile, library, reading, require_room
from vibrident.data.io.reader import Reader
from vibrident.data.records import FloatArray

_EXPECTED = "an Excel workbook (.xlsx) whose first sheet has columns of numbers"


class ExcelFile(ColumnFile):
    """The first sheet of a workbook, values as they were last computed; a cell without a number becomes NaN."""

    word = "column"

    def __init__(self, path: Path) -> None:
        openpyxl = library("openpyxl", "excel", path)
        with reading(path, _EXPECTED):
            with zipfile.ZipFile(path) as packed:  # a small file may unpack to a large one
                require_room(path, sum(part.file_size for part in packed.infolist()) // 8)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # parts of a workbook that openpyxl does not keep
                book = openpyxl.load_workbook(path, read_only=True, data_only=True)
            rows = [list(row) for row in book.worksheets[0].iter_rows(values_only=True)]
            book.close()
        rows = [row for row in rows if any(cell is not None for cell in row)]
        width = max((len(row) for row in rows), default=0)
        rows = [row + [None] * (width - len(row)) for row in rows]
        start = next(
            (n for n, row in enumerate(rows) if any(_is_number(cell) for cell in row)), len(rows)
        )
        self._rows = rows[start:]
        head = rows[start - 1] if start else [None] * width
        channels, refused = [], {}
        for column in range(width):
            name = "" if head[column] is None else str(head[column]).strip()
            cells = [row[column] for row in self._rows]
            if any(_is_number(cell) for cell in cells) and not any(
                isinstance(cell, str) for cell in cells
            ):
                timed = any(
                    isinstance(cell, datetime.datetime | datetime.timedelta) for cell in cells
                )
                channels.append(Channel(name, column, in_seconds=timed))
            else:
                refused[name or f"column {column + 1}"] = "no column of numbers"
        super().__init__(path, channels, refused)

    def load(self, positions: Sequence[int]) -> tuple[FloatArray, ...]:
        """Read these columns; each has shape (rows,). Times become seconds since the first."""
        columns = [
            [row[self._channels[position].handle] for row in self._rows] for position in positions
        ]
        return tuple(_numbers(column) for column in columns)


def _is_number(cell: Any) -> bool:
    return isinstance(
        cell, int | float | datetime.datetime | datetime.timedelta
    ) and not isinstance(cell, bool)


def _numbers(cells: Sequence[Any]) -> FloatArray:
    while cells and cells[-1] is None:
        cells = cells[:-1]
    first = next((cell for cell in cells if isinstance(cell, datetime.datetime)), None)
    found = []
    for cell in cells:
        if isinstance(cell, datetime.datetime) and first is not None:
            cell = cell - first
        found.append(cell.total_seconds() if isinstance(cell, datetime.timedelta) else cell)
    return np.array([np.nan if cell is None else float(cell) for cell in found])


EXCEL = Reader(name="excel", title="Excel", endings=(".xlsx", ".xlsm"), open=ExcelFile)
