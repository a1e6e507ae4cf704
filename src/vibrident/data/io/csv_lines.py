"""The lines of a text file of numbers: which are rows, and whether each is complete."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from vibrident.base.errors import InputError
from vibrident.data.io.allowance import LONGEST_LINE
from vibrident.data.io.csv_layout import BLANKS, CsvLayout, split_line, too_long_a_line

_CHUNK_BYTES = 1 << 20  # counting needs ten times as much memory
_NEWLINE = 10
_SPACE = 32


def row_lines(path: Path, file: str, layout: CsvLayout) -> NDArray[np.int64]:
    """Return the line number, from 1, of every row; blank lines are not rows. Shape (rows,).

    Raises:
        InputError: a row has more or fewer fields than the layout says.
    """
    numbers: list[NDArray[np.int64]] = []
    line = layout.first_line
    with path.open("rb") as stream:
        stream.seek(layout.offset)
        for chunk in _chunks_of_lines(stream):
            if chunk is None:
                raise too_long_a_line(file, line)
            fields = _fields(chunk, layout)
            ragged = np.flatnonzero((fields != layout.fields) & (fields != 0))
            if ragged.size:
                bad = int(ragged[0])
                raise _ragged(file, line + bad, int(fields[bad]), layout)
            numbers.append(np.flatnonzero(fields) + line)
            line += fields.size
    return np.concatenate(numbers) if numbers else np.zeros(0, dtype=np.int64)


def numbered_rows(path: Path, layout: CsvLayout) -> Iterator[tuple[int, list[str]]]:
    """Give line number, from 1, and cells of every row: slow, to locate an error of a fast reader."""
    with path.open("rb") as stream:
        stream.seek(layout.offset)
        for number, line in enumerate(stream, start=layout.first_line):
            if line.strip():
                yield number, split_line(line.decode(layout.encoding, errors="replace"), layout.delimiter)


def _chunks_of_lines(stream: BinaryIO) -> Iterator[bytes | None]:
    """Whole lines, about a block at a time; None for a line that is too long."""
    rest = b""
    while block := stream.read(_CHUNK_BYTES):
        block = rest + block
        end = block.rfind(b"\n") + 1
        rest = block[end:]
        if end:
            yield block[:end]
        if len(rest) > LONGEST_LINE:
            yield None
    if rest:
        yield rest


def _fields(chunk: bytes, layout: CsvLayout) -> NDArray[np.int64]:
    """Count the fields of each line; 0 for a blank line."""
    if b'"' in chunk:
        return _fields_with_quotes(chunk, layout)
    bytes_ = np.frombuffer(chunk, dtype=np.uint8)
    if layout.delimiter != BLANKS and layout.fields > 1 and (rows := _complete_rows(bytes_, layout)):
        return np.full(rows, layout.fields)
    ends = np.flatnonzero(bytes_ == _NEWLINE)
    starts = np.concatenate(([0], ends + 1)) if chunk[-1] != _NEWLINE else np.concatenate(([0], ends[:-1] + 1))
    ink = bytes_ > _SPACE
    if layout.delimiter == BLANKS:
        begins = ink.copy()
        begins[1:] &= ~ink[:-1]
        return np.add.reduceat(begins, starts, dtype=np.int64)
    separators = bytes_ == ord(layout.delimiter)
    counts = np.add.reduceat(separators, starts, dtype=np.int64)
    filled = np.logical_or.reduceat(ink | separators, starts)
    return np.where(filled, counts + 1, 0)


def _complete_rows(bytes_: NDArray[np.uint8], layout: CsvLayout) -> int:
    """Number of lines if each ends with a line end and has as many delimiters as the layout says; else 0."""
    delimiter = ord(layout.delimiter)
    marks = bytes_[(bytes_ == delimiter) | (bytes_ == _NEWLINE)]
    if marks.size % layout.fields or bytes_[-1] != _NEWLINE:
        return 0
    rows = marks.reshape(-1, layout.fields)
    return len(rows) if np.all(rows[:, -1] == _NEWLINE) and np.all(rows[:, :-1] == delimiter) else 0


def _fields_with_quotes(chunk: bytes, layout: CsvLayout) -> NDArray[np.int64]:
    lines = chunk.decode(layout.encoding, errors="replace").removesuffix("\n").split("\n")
    return np.array([len(split_line(line, layout.delimiter)) if line.strip() else 0 for line in lines], dtype=np.int64)


def _ragged(file: str, line: int, found: int, layout: CsvLayout) -> InputError:
    return InputError(
        "A row has the wrong number of fields.",
        expected=f"{layout.fields} fields, as in line {layout.first_line}",
        found=f"{found} field{'s' if found != 1 else ''}",
        where=f"{file}, line {line}",
        remedy="repair or remove that line; a truncated last line can be removed",
    )
