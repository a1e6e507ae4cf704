"""Text files of columns, at the speed of pandas; each row complete, each error with its line."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.io.columns import (
    MAX_LINE_LENGTH,
    ColumnFile,
    IntArray,
    Positions,
    StartTime,
    reading,
)
from vibrident.data.io.csv_layout import (
    NO_VALUE,
    TEXT_OF_COLUMNS,
    CsvLayout,
    line_too_long,
    open_text,
    refuse_thousands,
)
from vibrident.data.io.plain_text import BLANKS, TAIL_BYTES, PlainText, respelled
from vibrident.data.io.reader import Reader
from vibrident.data.io.stamps import Stamps, is_stamp, parse_stamps
from vibrident.data.io.text_cleaning import clean
from vibrident.data.io.units import without_brackets
from vibrident.data.records import FloatArray

_CHUNK_BYTES = 1 << 20  # counting needs ten times as much memory


def row_lines(text: PlainText, file: str, layout: CsvLayout) -> IntArray:
    """Return the line number, from 1, of every row; InputError for one of other fields."""
    numbers: list[IntArray] = []
    line = layout.first_line
    with text.open() as stream:
        stream.seek(layout.offset)
        for chunk in _chunks_of_lines(stream):
            if chunk is None:
                raise line_too_long(file, line)
            fields = _field_counts(chunk, layout)
            ragged = np.flatnonzero((fields != layout.fields) & (fields != 0))
            if ragged.size:
                bad = int(ragged[0])
                field_count = int(fields[bad])
                raise InputError(
                    "A row has the wrong number of fields.",
                    expected=f"{layout.fields} fields, as in line {layout.first_line}",
                    found=f"{field_count} field{'s' if field_count != 1 else ''}",
                    where=f"{file}, line {line + bad}",
                    remedy="repair or remove that line; a truncated last line can be removed",
                )
            numbers.append(np.flatnonzero(fields) + line)
            line += fields.size
    return np.concatenate(numbers) if numbers else np.zeros(0, dtype=np.int64)


def numbered_rows(text: PlainText, layout: CsvLayout) -> Iterator[tuple[int, list[str]]]:
    """Yield line number, from 1, and cells of every row: slow, to locate an error of a parser."""
    with text.open() as stream:
        stream.seek(layout.offset)
        for number, line in enumerate(stream, start=layout.first_line):
            if line.strip():
                yield number, layout.split(line.decode(layout.encoding, errors="replace"))


def _chunks_of_lines(stream: BinaryIO) -> Iterator[bytes | None]:
    """Yield whole lines, about a block at a time; None for a line that is too long."""
    remainder = b""
    while block := stream.read(_CHUNK_BYTES):
        block = remainder + block
        end = block.rfind(b"\n") + 1
        remainder = block[end:]
        if end:
            yield block[:end]
        if len(remainder) > MAX_LINE_LENGTH:
            yield None
    if remainder:
        yield remainder


def _field_counts(chunk: bytes, layout: CsvLayout) -> IntArray:
    """Return the number of fields of each line; 0 for a blank line."""
    lines = chunk.removesuffix(b"\n").split(b"\n")
    if b'"' in chunk:
        texts = [line.decode(layout.encoding, errors="replace") for line in lines]
        counts = [len(layout.split(text)) if text.strip() else 0 for text in texts]
    elif layout.delimiter == BLANKS:
        counts = [len(line.split()) for line in lines]
    else:
        gap = layout.delimiter.encode()
        counts = [line.count(gap) + 1 if gap in line or line.strip() else 0 for line in lines]
    return np.array(counts, dtype=np.int64)


SAMPLED_ROWS = 16  # at the top of a file, which tell most columns from times
MAX_LIGHT_BYTES = 1 << 20  # files up to this size are read without pandas: loading it takes longer
PLAIN = b"0123456789+-eE\n"  # numbers and lines, beside delimiter and decimal sign


class CsvFile(ColumnFile):
    """A text file of columns: layout from its first lines, numbers from pandas' C parser."""

    expected = TEXT_OF_COLUMNS
    word = "column"

    def __init__(self, path: Path) -> None:
        self._text, self._layout = open_text(path)
        self._parsed: dict[int, Stamps] = {}
        layout = self._layout
        channels = [
            replace(channel, name=name, unit=without_brackets(unit) or channel.unit)
            for channel, name, unit in zip(layout.facts, layout.names, layout.units, strict=True)
        ]
        super().__init__(path, channels, {})

    @cached_property
    def _row_lines(self) -> IntArray:
        try:
            return row_lines(self._text, self.file, self._layout)
        except InputError:
            if not self._clean():
                raise
            return row_lines(self._text, self.file, self._layout)

    def _clean(self) -> bool:
        """Bring the text into the form that the parsers take; return whether that changed it."""
        changed = clean(self._text, self._layout, self.file)
        if changed:
            for name in ("_row_lines", "_numbers", "_sampled_rows"):
                vars(self).pop(name, None)
        return changed

    def in_seconds(self, position: int) -> bool:
        """Return whether the column holds times of day, with or without dates."""
        return position < len(self._first_row) and is_stamp(self._first_row[position])

    def _first_date(self, position: int) -> StartTime:
        stamps = self._stamps(position)
        return StartTime(int(stamps.ns[0]), epoch=stamps.dated)

    def load(self, positions: Positions) -> tuple[FloatArray, ...]:
        """Parse these columns; each has shape (rows,).

        An empty cell is NaN; a time of day is in seconds since the first.
        """
        with reading(self._path, self.expected):
            numbers = [position for position in positions if not self.in_seconds(position)]
            loaded = self._load_numbers(numbers) if numbers else ()
            columns = dict(zip(numbers, loaded, strict=True))
            return tuple(
                columns[position] if position in columns else self._stamps(position).elapsed_s
                for position in positions
            )

    def may_rise(self, position: int) -> bool:
        """Return whether the first rows and the last leave it possible that a column rises."""
        delimiter = self._layout.delimiter
        rows = [row for row in self._sampled_rows if position < len(row)]
        cells = [respelled(row[position], delimiter) for row in rows]
        if not all(self._layout.is_number(cell) for cell in cells):
            return False
        values = np.array([float(cell.replace(self._layout.decimal, ".")) for cell in cells])
        return bool(np.all(np.diff(values) >= 0.0) and values[-1] > values[0])

    @property
    def _first_row(self) -> list[str]:
        return self._sampled_rows[0]

    @cached_property
    def _sampled_rows(self) -> list[list[str]]:
        """Return the cells of the first rows and of the last."""
        layout = self._layout
        with reading(self._path, self.expected):
            rows = itertools.islice(numbered_rows(self._text, layout), SAMPLED_ROWS)
            last = layout.split(respelled(self._last_line(), layout.delimiter))
            return [*(cells for _, cells in rows), last]

    def _stamps(self, position: int) -> Stamps:
        """Return a column of times of day, which is kept."""
        if position not in self._parsed:
            size = self._row_lines.size  # which refuses uneven rows
            span = self._span(position)
            cells = [" ".join(row[span]) for _, row in numbered_rows(self._text, self._layout)]
            if len(cells) != size:
                raise self._torn_rows(len(cells))
            self._parsed[position] = parse_stamps(
                cells, NO_VALUE, lambda row: self.locate(position, row)
            )
        return self._parsed[position]

    def _span(self, position: int) -> slice:
        """Return the cells of a stamp: a date, the time, and AM, PM or a zone."""
        row = self._first_row
        begin = position
        end = position + 1
        if position and is_stamp(f"{row[position - 1]} {row[position]}"):
            begin -= 1
        if row[end:] and row[end].isalpha() and is_stamp(f"{row[position]} {row[end]}"):
            end += 1
        return slice(begin, end)

    def _torn_rows(self, row_count: int) -> InputError:
        return InputError(
            "The rows of the file cannot be separated.",
            expected=f"{self._row_lines.size} rows, one a line",
            found=f"{row_count} rows; a quoted cell may hold a line end",
            where=self.file,
            remedy="export the data without line ends inside cells",
        )

    def _load_numbers(self, positions: Positions) -> tuple[FloatArray, ...]:
        try:
            self._refuse_summary()
            return self._load_quickly(positions)
        except (ValueError, TypeError, OverflowError) as error:
            if not self._clean():
                raise self._text_error(positions, error) from error
        return self._load_numbers(positions)

    def _load_quickly(self, positions: Positions) -> tuple[FloatArray, ...]:
        """Return columns of numbers; ValueError and its like for other text."""
        rows = self._row_lines.size
        fields = self._layout.fields
        if self._numbers is not None and self._numbers.size == rows * fields:
            table = self._numbers.reshape(rows, fields)
            return tuple(table[:, position].copy() for position in positions)
        frame = self._parse(sorted(set(positions)))  # pandas.errors.ParserError is a ValueError
        if len(frame) != rows:
            raise self._torn_rows(len(frame))
        return tuple(frame[position].to_numpy() for position in positions)

    def locate(self, position: int, row: int) -> str:
        """Return file, line and column of a value."""
        return f"{self.file}, line {self._row_lines[row]}, {self._column(position)}"

    def _column(self, position: int) -> str:
        name = self.names[position]
        return f"column {position + 1}" + (f" ({name!r})" if name else "")

    @cached_property
    def _numbers(self) -> FloatArray | None:
        """Return all numbers of a small file in a row; None if it needs the parser of pandas.

        An empty cell shows in their count.
        """
        layout = self._layout
        if self._path.stat().st_size > MAX_LIGHT_BYTES:
            return None
        data = self._text.read()[layout.offset :]
        if b"\r" in data:  # one sign is sought far quicker than two
            data = data.replace(b"\r\n", b"\n")
        separator = layout.delimiter.encode()
        if layout.delimiter != BLANKS and b" " in data:
            data = data.replace(separator + b" ", separator)
        signs = separator + layout.decimal.encode()
        blanks = b" \t" if layout.delimiter == BLANKS else b""
        if data.translate(None, PLAIN + signs + blanks):
            return None
        try:
            # Delimiters become blanks, which no cell contains.
            return np.fromstring(data.translate(bytes.maketrans(signs, b" .")), sep=" ")
        except (ValueError, DeprecationWarning):  # not a number: the parser locates it
            return None

    def _parse(self, positions: list[int]) -> Any:
        import pandas

        layout = self._layout
        # Before 3.1 the default parser may miss the nearest float by one unit in the last place;
        # since then it is exact, and the option is deprecated.
        old = tuple(int(number) for number in pandas.__version__.split(".")[:2]) < (3, 1)
        exact: dict[str, Any] = {"float_precision": "round_trip"} if old else {}
        with self._text.open() as stream:
            stream.seek(layout.offset)
            return pandas.read_csv(
                stream,
                sep=r"\s+" if layout.delimiter == BLANKS else layout.delimiter,
                header=None,
                usecols=positions,
                dtype=np.float64,
                decimal=layout.decimal,
                skipinitialspace=True,
                encoding=layout.encoding,
                encoding_errors="replace",
                engine="c",
                **exact,
            )

    def _refuse_summary(self) -> None:
        """Refuse a last row that begins with a word where others begin with a number."""
        first = (self._first_row or [""])[0]
        word = (self._sampled_rows[-1] or [""])[0]
        numeric = self._layout.is_number(first) or is_stamp(first)
        if word[:1].isalpha() and word not in NO_VALUE and numeric:
            raise InputError(
                "The last row of the file is not like the others.",
                expected=f"rows that begin with a number, as line {self._layout.first_line} does",
                found=repr(self._last_line().strip()[:60]),
                where=f"{self.file}, line {self._row_lines[-1]}",
                remedy="remove the lines below the data, such as mean and maximum",
            )

    def _last_line(self) -> str:
        with self._text.open() as stream:
            size = stream.seek(0, 2)
            stream.seek(max(self._layout.offset, size - TAIL_BYTES))
            tail = stream.read().decode(self._layout.encoding, errors="replace")
        return tail.rstrip().rpartition("\n")[2]

    def _text_error(self, positions: Positions, error: Exception) -> InputError:
        """Return the error of the first cell that the parser refused."""
        sign = self._layout.decimal
        for line, cells in numbered_rows(self._text, self._layout):
            for position in positions:
                cell = cells[position]
                if cell not in NO_VALUE and not self._layout.is_number(cell):
                    where = f"{self.file}, line {line}, {self._column(position)}"
                    refuse_thousands(cell, where)
                    return InputError(
                        "A cell that must hold a number holds text.",
                        expected=f"a number, with decimal sign {sign!r}",
                        found=repr(cell[:40]),
                        where=where,
                        remedy="repair the cell, or name another column",
                    )
        return InputError(
            "The numbers of the file cannot be read.",
            expected=f"numbers with decimal sign {sign!r}",
            found=str(error)[:200],
            where=f"{self.file}, " + ", ".join(self._column(position) for position in positions),
            remedy="check these columns",
        )


CSV = Reader(
    name="csv",
    title="text files of columns",
    endings=(".csv", ".txt", ".dat", ".asc", ".tsv", ".lvm"),
    open=CsvFile,
    plain=True,
)
