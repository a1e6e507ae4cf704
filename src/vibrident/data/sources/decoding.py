"""Bytes that come in pieces → chunks: lines of CSV, or raw float32 (little-endian, channels in turn)."""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from vibrident.base.errors import InputError, unknown
from vibrident.data.io.columns import Channel, ColumnFile
from vibrident.data.io.header_units import (
    file_unit,
    reference_conversion,
    reference_unit,
    response_conversion,
    seconds_per_unit,
)
from vibrident.data.io.units import split_unit
from vibrident.data.records import FloatArray
from vibrident.data.sources.source import Chunk, Wanted

FORMS = ("csv", "float32")
SEPARATORS = (b";", b"\t", b",")  # looked for in this order; white space otherwise
PIECE = 1_000_000  # bytes that a source gives at once, and most of a line
#: Deviation of a time stamp that is a rounding of it, in sampling intervals.
ROUNDED = 0.1


def chunks(
    pieces: Iterator[bytes], wanted: Wanted, form: str, where: str, first_line: bytes = b""
) -> Iterator[Chunk]:
    """Yield chunks of pieces of bytes: complete lines or frames, the rest with the next piece.

    ``first_line``: of a source that goes on in its middle, which may name the columns.
    """
    if form not in FORMS:
        raise unknown("The form of the samples is not known.", form, FORMS, where)
    decoder = _Lines(wanted, where, first_line) if form == "csv" else _Frames(wanted, where)
    rest = b""
    position = wanted.position
    for piece in pieces:
        whole, rest = decoder.split(rest + piece)
        position += len(whole)
        if len(rest) > PIECE:
            raise InputError(
                "A line does not end.", expected="lines of numbers", found="none", where=where
            )
        if whole and (columns := decoder.columns(whole)) is not None:
            yield from _cut(columns, wanted, position)


def _cut(columns: list[FloatArray], wanted: Wanted, position: int) -> Iterator[Chunk]:
    """Yield one chunk, or several where the time stamps jump."""
    to = wanted.calibration
    reference = columns[0] * to.reference.scale
    response = columns[1] * to.response.scale
    if len(columns) == 2:
        yield Chunk(reference, response, position=position)
        return
    time = columns[2]
    clock = ROUNDED / wanted.rate_hz
    jumps = np.flatnonzero(~(np.abs(np.diff(time) * wanted.rate_hz - 1.0) < 0.5)) + 1
    edges = [0, *jumps.tolist(), len(time)]
    for first, last in itertools.pairwise(edges):
        start = float(time[first])
        stamped = start if math.isfinite(start) else None
        there = position if last == len(time) else 0
        yield Chunk(reference[first:last], response[first:last], stamped, clock, position=there)


def _columns(wanted: Wanted) -> list[tuple[str, int | str | None]]:
    """Return the key and column of reference, response and, where there is one, time."""
    to = wanted.calibration
    found = [("[reference] column", to.reference.column), ("[response] column", to.response.column)]
    time = to.sampling.time_column
    return found if time is None else [*found, ("[sampling] time_column", time)]


class _Header(ColumnFile):
    """The names of a stream's columns, for the rule of units."""

    word = "column"

    def load(self, positions: Sequence[int]) -> tuple[FloatArray, ...]:
        """Give nothing: a stream's numbers come in pieces."""
        raise NotImplementedError(positions)


class _Lines:
    """CSV: a first line that holds no numbers names the columns."""

    def __init__(self, wanted: Wanted, where: str, first_line: bytes) -> None:
        self._where = where
        self._line = 0
        self._separator: str | None = None
        self._positions: list[int] = []
        self._wanted = _columns(wanted)
        self._calibration = wanted.calibration
        self._factors = [1.0] * len(self._wanted)  # of the units that the first line names
        if first_line:
            self._begin(first_line)

    def split(self, data: bytes) -> tuple[bytes, bytes]:
        """Whole lines, and what is left."""
        end = data.rfind(b"\n") + 1
        return data[:end], data[end:]

    def columns(self, data: bytes) -> list[FloatArray] | None:
        """Return the columns wanted, in order."""
        from pandas import read_csv
        from pandas.errors import ParserError

        if self._separator is None:
            first, _, after = data.partition(b"\n")
            if self._begin(first):
                self._line = 1
                data = after
        if not data.strip():
            return None
        try:
            table = read_csv(
                io.BytesIO(data), sep=self._separator, header=None, skip_blank_lines=True
            )
            found = [
                table[place].to_numpy(dtype=float) * factor
                for place, factor in zip(self._positions, self._factors, strict=True)
            ]
        except (ParserError, ValueError, KeyError) as error:
            raise InputError(
                "A line of samples cannot be read.",
                expected=f"numbers in columns {', '.join(str(p + 1) for p in self._positions)}",
                found=str(error).splitlines()[0],
                where=f"{self._where}, after line {self._line}",
                remedy="repair the line, or leave the value empty: it is then a gap",
            ) from None
        self._line += len(table)
        return found

    def _begin(self, first: bytes) -> bool:
        """Take separator, places and units from the first line; returns whether it names columns."""
        separator = next((each for each in SEPARATORS if each in first), b"")
        self._separator = separator.decode() or r"\s+"
        cells = first.decode("utf-8", "replace").split(separator.decode() or None)
        fields = [cell.strip().strip('"') for cell in cells]
        is_named = not all(_number(field) for field in fields)
        names = fields if is_named else []
        self._positions = [self._place(key, column, names) for key, column in self._wanted]
        if is_named:
            self._factors = self._factors_of(names)
        return is_named

    def _factors_of(self, names: list[str]) -> list[float]:
        """Return the factors of the units in the names; InputError for a contradiction."""
        header = _Header(Path(self._where), [Channel(name) for name in names], {})
        to = self._calibration
        reference, response, *time = self._positions
        if max(self._positions) >= len(names):
            return self._factors
        unit = reference_unit(to.reference, file_unit(header, reference)[0])
        return [
            reference_conversion(header, reference, to.reference, unit).factor,
            response_conversion(header, response, to.response, to.response.unit).factor,
            *(seconds_per_unit(header, place) or 1.0 for place in time),
        ]

    def _place(self, key: str, column: int | str | None, names: list[str]) -> int:
        if isinstance(column, int):
            return column - 1
        if column in names:
            return names.index(str(column))
        plain = [split_unit(name)[0] for name in names]
        if plain.count(str(column)) == 1:
            return plain.index(str(column))
        raise InputError(
            "A column of the stream is not known.",
            expected=", ".join(names) or "the number of a column, as its first line holds no names",
            found=repr(column),
            where=f"{self._where}, {key}",
            remedy="give the column's number, counted from 1",
        )


class _Frames:
    """Raw float32: as many channels as the largest column number."""

    def __init__(self, wanted: Wanted, where: str) -> None:
        places = [column for _, column in _columns(wanted)]
        if not all(isinstance(place, int) for place in places):
            raise InputError(
                "Raw samples have no names of columns.",
                expected="column numbers from 1",
                found=", ".join(repr(place) for place in places),
                where=str(wanted.file),
                remedy="give [reference] column and [response] column as numbers",
            )
        self._places = [int(place) - 1 for place in places if isinstance(place, int)]
        self._width = max(self._places) + 1

    def split(self, data: bytes) -> tuple[bytes, bytes]:
        """Whole frames, and what is left."""
        end = len(data) - len(data) % (4 * self._width)
        return data[:end], data[end:]

    def columns(self, data: bytes) -> list[FloatArray]:
        """Return the columns wanted, in order."""
        frames = np.frombuffer(data, dtype="<f4").reshape(-1, self._width).astype(float)
        return [frames[:, place] for place in self._places]


def _number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return not text
    return True
