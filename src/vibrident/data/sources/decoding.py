"""Decode bytes to chunks: lines of CSV, or raw float32 (little-endian, channels interleaved)."""

from __future__ import annotations

import io
import itertools
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from vibrident.base.errors import InputError, unknown
from vibrident.data.io.columns import Channel, ColumnFile
from vibrident.data.io.header_units import (
    SourceColumn,
    reference_conversion,
    reference_unit,
    response_conversion,
)
from vibrident.data.records import FloatArray
from vibrident.data.sources.source import Chunk, SourceRequest

FORMS = ("csv", "float32")
SEPARATORS = (b";", b"\t", b",")  # tried in this order; white space otherwise
MAX_PIECE_BYTES = 1_000_000  # bytes that a source gives at once; also the longest line
#: Standard uncertainty of a rounded time stamp, in sampling intervals.
STAMP_UNCERTAINTY = 0.1


def chunks(
    pieces: Iterator[bytes], request: SourceRequest, form: str, where: str, first_line: bytes = b""
) -> Iterator[Chunk]:
    """Yield the chunks in pieces of bytes: complete lines or frames, the rest with the next piece.

    Args:
        pieces: bytes as the source gives them.
        request: columns, units and sampling.
        form: one of ``FORMS``.
        where: source, for messages.
        first_line: of a source that is resumed in its middle, which may name the columns.
    """
    if form not in FORMS:
        raise unknown("The form of the samples is not known.", form, FORMS, where)
    decoder = (
        _LineDecoder(request, where, first_line) if form == "csv" else _FrameDecoder(request, where)
    )
    remainder = b""
    position = request.position
    for piece in pieces:
        complete, remainder = decoder.split(remainder + piece)
        position += len(complete)
        if len(remainder) > MAX_PIECE_BYTES:
            raise InputError(
                "A line does not end.", expected="lines of numbers", found="none", where=where
            )
        if complete and (columns := decoder.columns(complete)) is not None:
            yield from _chunks_between_jumps(columns, request, position)


def _chunks_between_jumps(
    columns: list[FloatArray], request: SourceRequest, position: int
) -> Iterator[Chunk]:
    """Yield one chunk, or several if the time stamps jump."""
    to = request.calibration
    reference = columns[0] * to.reference.scale
    response = columns[1] * to.response.scale
    if len(columns) == 2:
        yield Chunk(reference, response, position=position)
        return
    time = columns[2]
    clock = STAMP_UNCERTAINTY / request.rate_hz
    jumps = np.flatnonzero(~(np.abs(np.diff(time) * request.rate_hz - 1.0) < 0.5)) + 1
    edges = [0, *jumps.tolist(), len(time)]
    for first, last in itertools.pairwise(edges):
        start = float(time[first])
        stamped = start if math.isfinite(start) else None
        begin = position if last == len(time) else 0
        yield Chunk(reference[first:last], response[first:last], stamped, clock, position=begin)


def _requested_columns(request: SourceRequest) -> list[tuple[str, int | str | None]]:
    """Return the key and column of reference, response and, if any, time."""
    to = request.calibration
    channels = [
        ("[reference] column", to.reference.column),
        ("[response] column", to.response.column),
    ]
    time = to.sampling.time_column
    return channels if time is None else [*channels, ("[sampling] time_column", time)]


class _Header(ColumnFile):
    """Names of a stream's columns, for the rules of units."""

    word = "column"


class _LineDecoder:
    """Decoder of CSV, whose first line names the columns if it holds no numbers."""

    def __init__(self, request: SourceRequest, where: str, first_line: bytes) -> None:
        self._where = where
        self._line = 0
        self._separator: str | None = None
        self._positions: list[int] = []
        self._requested = _requested_columns(request)
        self._calibration = request.calibration
        self._factors = [1.0] * len(self._requested)  # of the units that the first line names
        if first_line:
            self._begin(first_line)

    def split(self, data: bytes) -> tuple[bytes, bytes]:
        """Return complete lines, and the remaining bytes."""
        end = data.rfind(b"\n") + 1
        return data[:end], data[end:]

    def columns(self, data: bytes) -> list[FloatArray] | None:
        """Return the requested columns, in order."""
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
            values = [
                table[position].to_numpy(dtype=float) * factor
                for position, factor in zip(self._positions, self._factors, strict=True)
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
        return values

    def _begin(self, first: bytes) -> bool:
        """Set separator, positions and units by the first line; return whether it names columns."""
        separator = next((candidate for candidate in SEPARATORS if candidate in first), b"")
        self._separator = separator.decode() or r"\s+"
        cells = first.decode("utf-8", "replace").split(separator.decode() or None)
        fields = [cell.strip().strip('"') for cell in cells]
        is_named = not all(_is_number_or_empty(field) for field in fields)
        channels = [Channel(field if is_named else "") for field in fields]
        header = _Header(Path(self._where), channels, {})
        self._positions = [header.position_of(column or "", key) for key, column in self._requested]
        self._factors = self._factors_of(header)
        return is_named

    def _factors_of(self, header: _Header) -> list[float]:
        """Return the factors of the units in the names; InputError where these contradict."""
        to = self._calibration
        first, second, *time_positions = self._positions
        reference = SourceColumn(header, first, "[reference]")
        response = SourceColumn(header, second, "[response]")
        times = [SourceColumn(header, position, "time_column") for position in time_positions]
        unit = reference_unit(to.reference, reference.file_unit[0])
        return [
            reference_conversion(reference, to.reference, unit).factor,
            response_conversion(response, to.response, to.response.unit).factor,
            *(time.seconds or 1.0 for time in times),
        ]


class _FrameDecoder:
    """Decoder of raw float32, of as many channels as the largest column number."""

    def __init__(self, request: SourceRequest, where: str) -> None:
        columns = [column for _, column in _requested_columns(request)]
        if not all(isinstance(column, int) for column in columns):
            raise InputError(
                "Raw samples have no names of columns.",
                expected="column numbers from 1",
                found=", ".join(repr(column) for column in columns),
                where=str(request.file),
                remedy="give [reference] column and [response] column as numbers",
            )
        self._positions = [int(column) - 1 for column in columns if isinstance(column, int)]
        self._width = max(self._positions) + 1

    def split(self, data: bytes) -> tuple[bytes, bytes]:
        """Return complete frames, and the remaining bytes."""
        end = len(data) - len(data) % (4 * self._width)
        return data[:end], data[end:]

    def columns(self, data: bytes) -> list[FloatArray]:
        """Return the requested columns, in order."""
        frames = np.frombuffer(data, dtype="<f4").reshape(-1, self._width).astype(float)
        return [frames[:, position] for position in self._positions]


def _is_number_or_empty(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return not text
    return True
