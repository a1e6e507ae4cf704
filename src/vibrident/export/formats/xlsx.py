"""Excel: the tables of a result as sheets of one workbook, numbers unrounded.

It is a document for a customer: no U of the model is below that of the measured values, and the
sheet ``notes`` says so.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from vibrident.base.escaping import one_line
from vibrident.export.form import Format, Options, library
from vibrident.export.formats.csv import sheets
from vibrident.export.sensor import ExportedSensor
from vibrident.show.certified import describe_raised, raised_to_measured


def write(sensor: ExportedSensor, folder: Path, options: Options) -> list[Path]:
    """Write ``NAME.xlsx``."""
    openpyxl = library("openpyxl", "excel")
    book = openpyxl.Workbook()
    book.remove(book.active)
    bold = openpyxl.styles.Font(bold=True)
    result = raised_to_measured(sensor.result)
    tables = sheets(result)
    if notes := describe_raised(result):
        tables["notes"] = (("note",), [(str(note),) for note in notes])
    for name, (header, rows) in tables.items():
        sheet = book.create_sheet(name)
        for number, row in enumerate((header, *rows), 1):
            for column, value in enumerate(row, 1):
                _fill(sheet.cell(number, column), value)
        for cell in sheet[1]:
            cell.font = bold
        for column, title in enumerate(header, 1):
            sheet.column_dimensions[openpyxl.utils.get_column_letter(column)].width = max(
                12, len(title) + 2
            )
        sheet.freeze_panes = "B2"
    book.properties.creator = "vibrident"
    path = folder / f"{options.name}.xlsx"
    book.save(path)
    return [path]


def _fill(cell: Any, value: object) -> None:
    """Fill a cell; text is no formula, and a float keeps all 17 digits.

    Openpyxl itself would write 16 digits of a float, one too few.
    """
    if isinstance(value, str):
        cell.value = one_line(value)
        cell.data_type = "s"
    elif isinstance(value, float):
        cell.value = repr(float(value)) if math.isfinite(value) else None
        cell.data_type = "n"
    else:
        cell.value = value


XLSX = Format(
    name="xlsx",
    title="Excel workbook of all numbers",
    write=write,
    contents=(
        "parameters, u, intervals, correlation, curve and measured points with u, levels in dB, "
        "budgets"
    ),
    cannot_hold="settings, fit metrics",
    extra="excel",
)
