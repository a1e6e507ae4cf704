"""Read a signal from a user's table (CSV, Parquet, Excel); write it with further columns."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.io.alignment import ClockedChannel, align
from vibrident.data.io.calibration_file import ResponseSection
from vibrident.data.io.clocks import ClockReader
from vibrident.data.io.columns import library
from vibrident.data.io.csv_layout import open_text
from vibrident.data.io.header_units import SourceColumn, response_conversion
from vibrident.data.io.plain_text import BLANKS
from vibrident.data.io.reader import open_columns, sha256
from vibrident.data.records import FloatArray, Provenance, Record

ENDINGS = (".csv", ".txt", ".tsv", ".dat", ".parquet", ".pq", ".xlsx")


#: Words on entries of a calibration file → on the options of a table, in this order.
_WORDS_OF_OPTIONS = (
    (r"contradicts the calibration file", "contradicts the result"),
    (r"the calibration file", "⟦correct.rate_hz⟧"),
    (r"\[sampling\] time_column|\btime_column\b", "⟦correct.time⟧"),
    (r"\[response\] (?=scale)", ""),
    (r"\[response\]( unit)?", "⟦correct.column⟧"),
    (r"set unit = \"[^\"]*\"; or ", ""),
    (r"\brate_hz\b(?!⟧)", "⟦correct.rate_hz⟧"),
    (r"\bscale = ", "⟦correct.scale⟧ "),
    (r"(set|give|remove|or|by) scale\b", r"\1 ⟦correct.scale⟧"),
)


@contextmanager
def _in_words_of_options() -> Iterator[None]:
    """Name options where a message of a record's reader names entries of a calibration file."""
    try:
        yield
    except InputError as error:
        texts = dict(vars(error))
        for pattern, words in _WORDS_OF_OPTIONS:
            texts = {key: re.sub(pattern, words, text) for key, text in texts.items()}
        raise type(error)(**texts) from None


def read_signal(
    path: Path, column: str, time: str | None, rate_hz: float | None, scale: float | None, unit: str
) -> Record:
    """Return a column of a table as a record without reference.

    Args:
        path: the table.
        column: name, or number from 1, of the signal.
        time: the same of the times; None for one whose name says so, if any.
        rate_hz: where there are no times and the file states no rate.
        scale: response unit per unit of the column, after the factor of a stated unit; None: 1, and
            a stated unit of another kind is refused.
        unit: of the response.

    Raises:
        InputError: nothing states the sampling rate, or the file contradicts rate or unit.
    """
    with _in_words_of_options():
        return _read_signal(path, (column, time), rate_hz, scale, unit)


def _read_signal(
    path: Path,
    columns: tuple[str, str | None],
    rate_hz: float | None,
    scale: float | None,
    unit: str,
) -> Record:
    """Return the record of a table; ``columns``: of the signal and of the times."""
    column, time = columns
    source = open_columns(path)
    position = source.position_of(_key(column), "⟦correct.column⟧")
    signal = SourceColumn(source, position, "[response]")
    (values,) = source.load((position,))
    time_column = None if time is None else _key(time)
    reader = ClockReader(None if time is not None else rate_hz, time_column, str(path), source)
    clock = reader.clock_of(source, position, [position])
    if clock is None:
        raise InputError(
            "Nothing tells the sampling rate of the table.",
            expected="⟦correct.time⟧ with the column of the times, or ⟦correct.rate_hz⟧",
            found="neither",
            where=str(path),
            remedy="give ⟦correct.rate_hz⟧ if the table has no column of times",
        )
    section = ResponseSection(unit=unit)
    if scale is not None:  # a stated one converts units of another kind
        section = ResponseSection(unit=unit, scale=scale)
    conversion = response_conversion(signal, section, unit)
    factor = conversion.factor * section.scale
    aligned = align(ClockedChannel(signal, values, clock), None, None, None, str(path))
    if aligned.response.size != values.size or aligned.valid is not None:
        raise InputError(
            "The rows of the table are not even in time.",
            expected="a row a sample, at an even rate",
            found=f"{aligned.response.size} even samples in {values.size} rows",
            where=str(path),
            remedy="name the table in a calibration file, and give that in its place",
        )
    step = f"response: column {column} × {factor!r}"
    provenance = Provenance(path.name, sha256(path), (step,))
    response = aligned.response * factor
    return Record(path.name, None, response, aligned.rate_hz, "decay", provenance=provenance)


def _key(text: str) -> int | str:
    return int(text) if text.isdecimal() else text


def with_columns(path: Path, target: Path, columns: Mapping[str, FloatArray]) -> Path:
    """Write the table with further columns into ``target``; what it held stays as it was.

    ``columns``: heading to its values, one a row; InputError where the table has other rows, or
    such a column.
    """
    names = open_columns(path).names
    for name in columns:
        if name in names:
            raise InputError(
                "The table has a column of that name already.",
                expected=f"no column {name!r}",
                found=repr(name),
                where=str(path),
                remedy="rename the column, or give the table as it was",
            )
    write = {".parquet": _parquet, ".pq": _parquet, ".xlsx": _excel}.get(path.suffix.lower(), _text)
    write(path, target, columns)
    return target


def _parquet(path: Path, target: Path, columns: Mapping[str, FloatArray]) -> None:
    parquet = library("pyarrow.parquet", "parquet", path)
    arrow = library("pyarrow", "parquet", path)
    table = parquet.read_table(path)
    _require_rows(table.num_rows, columns, path)
    for name, values in columns.items():
        table = table.append_column(name, arrow.array(values))
    parquet.write_table(table, target)


def _excel(path: Path, target: Path, columns: Mapping[str, FloatArray]) -> None:
    openpyxl = library("openpyxl", "excel", path)
    book = openpyxl.load_workbook(path)
    sheet = book.worksheets[0]
    rows = [
        n
        for n, row in enumerate(sheet.iter_rows(values_only=True), 1)
        if any(cell is not None for cell in row)
    ]
    size = len(next(iter(columns.values())))
    _require_rows(min(len(rows), size), columns, path)
    data = rows[-size:]
    head = rows[: len(rows) - size]
    first = sheet.max_column + 1
    for offset, (name, values) in enumerate(columns.items()):
        if head:
            sheet.cell(head[-1], first + offset, name)
        for row, value in zip(data, values.tolist(), strict=True):
            sheet.cell(row, first + offset, value if np.isfinite(value) else None)
    for row in sheet.iter_rows():
        for cell in row:
            if isinstance(cell.value, float):  # openpyxl itself would write 16 digits, one too few
                cell.value = repr(cell.value)
                cell.data_type = "n"
    book.save(target)


def _text(path: Path, target: Path, columns: Mapping[str, FloatArray]) -> None:
    text, layout = open_text(path)
    gap = " " if layout.delimiter == BLANKS else layout.delimiter
    lines = text.read().decode(layout.encoding).splitlines()
    head = lines[: layout.first_line - 1]
    data = lines[layout.first_line - 1 :]
    filled = [n for n, line in enumerate(data) if line.strip()]
    _require_rows(len(filled), columns, path)
    texts = [
        [_number(value, layout.decimal) for value in values.tolist()] for values in columns.values()
    ]
    for n, cells in zip(filled, zip(*texts, strict=True), strict=True):
        data[n] = _joined(data[n], cells, gap)
    filled_lines = [n for n, line in enumerate(head) if line.strip()]
    if filled_lines and any(layout.names):
        has_units = any(layout.units) and len(filled_lines) > 1
        if has_units:
            head[filled_lines[-1]] = _joined(head[filled_lines[-1]], [""] * len(columns), gap)
        named = filled_lines[-2] if has_units else filled_lines[-1]
        head[named] = _joined(head[named], list(columns), gap)
    target.write_text(
        "\n".join([*head, *data]) + "\n",
        encoding=layout.encoding.removesuffix("-sig"),
        newline="\n",
    )


def _joined(line: str, cells: Sequence[str], gap: str) -> str:
    return f"{line if line.endswith(gap) and gap != ' ' else line + gap}{gap.join(cells)}"


def _number(value: float, decimal: str) -> str:
    return repr(value).replace(".", decimal) if np.isfinite(value) else ""


def _require_rows(rows: int, columns: Mapping[str, FloatArray], path: Path) -> None:
    size = len(next(iter(columns.values())))
    if rows != size:
        raise InputError(
            "The table has another number of rows than the signal has values.",
            expected=f"{size} rows of numbers",
            found=str(rows),
            where=str(path),
            remedy="remove rows that are no data",
        )
