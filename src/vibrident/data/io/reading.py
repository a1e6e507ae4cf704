"""From a calibration file and its data to a Calibration."""

from __future__ import annotations

import os
from pathlib import Path

from vibrident.base import sandbox
from vibrident.base.errors import InputError
from vibrident.base.process import Limits
from vibrident.data.io.calibration_file import CalibrationFile, read_calibration_file
from vibrident.data.io.columns import memory_for
from vibrident.data.io.header_units import reference_unit, unit_of_another_kind
from vibrident.data.io.reader import by_ending, open_columns
from vibrident.data.io.record_files import data_files, named_parts, read_record
from vibrident.data.io.sections import effects_at
from vibrident.data.io.table_file import read_table
from vibrident.data.records import Calibration

# Of a reading process: memory for its libraries, and more as a multiple of the numbers' limit; time, and more a byte.
_LIBRARIES_BYTES, _COPIES = 600_000_000, 2
_SECONDS, _SECONDS_PER_BYTE = 30.0, 1e-6


def read_guarded(path: str | os.PathLike[str]) -> Calibration:
    """Read as :func:`read` does; binary data files in a separate process, with limits on memory and time.

    A damaged file that crashes or hangs a native library is then merely bad input. The cost is one process a
    calibration.

    Raises:
        InputError: as ``read`` does; or reading takes more than it may, or crashed.
    """
    file = Path(path)
    names = data_files(read_calibration_file(file), file.parent, str(file))
    readers = (by_ending().get(Path(name).suffix.lower()) for name in names)
    if all(reader is not None and reader.plain for reader in readers):
        return read(file)
    size = sum(
        (file.parent / name).stat().st_size for name in names if os.path.isfile(file.parent / name)
    )
    memory_bytes = int(_LIBRARIES_BYTES + _COPIES * memory_for(size))
    seconds = _SECONDS + _SECONDS_PER_BYTE * size
    try:
        return sandbox.run(
            read, file, limits=Limits(seconds, memory_bytes, memory_bytes, memory_bytes)
        )
    except InputError as error:
        if error.where:
            raise
        raise error.at(f"{file}, one of its data files") from None


def read(path: str | os.PathLike[str]) -> Calibration:
    """Read a calibration file (TOML) and the data files that it names.

    Args:
        path: the calibration file; relative paths in it start at its folder.

    Returns:
        Calibration: records, or a table, in physical units: the reference in m/s², m/s, m or the drive's own unit,
        the response in [response] unit.

    Raises:
        InputError: the file or the data cannot be used; the message says what, where and what to do.
    """
    file = Path(path)
    return calibration_of(read_calibration_file(file), file.parent, str(file))


def calibration_of(document: CalibrationFile, folder: Path, where: str) -> Calibration:
    """The calibration of a checked file, whose relative paths start at ``folder``; errors as :func:`read`."""
    document = _with_unit_of_header(document, folder, where)
    quantity, records, table, more = document.reference.quantity, (), None, ()
    if document.interferometer is not None:
        from vibrident.data.io.optical_files import (
            read_optical,
        )  # loads SciPy, which others do not need

        records, quantity, unit, more = read_optical(document, folder, where)
    else:
        unit = reference_unit(quantity, document.reference.unit, document.reference.scale, where)
        if document.table:
            table = read_table(document, folder, where)
        else:
            parts = named_parts(document, folder, where)
            records = tuple(read_record(part, name, document, folder, unit) for part, name in parts)
    temperatures = [
        t for record in records if (t := record.circumstances.temperature_c) is not None
    ]
    if not temperatures and document.certificate.temperature_c is not None:
        temperatures = [document.certificate.temperature_c]
    return Calibration(
        records=records,
        table=table,
        model=document.sensor.model,
        quantity=quantity,
        reference_unit=unit,
        reference_standard_uncertainty=document.reference.standard_uncertainty,
        response_unit=document.response.unit,
        sensor=document.sensor_text,
        source=where,
        certificate=document.certificate.stated(),
        effects=(*effects_at(document.uncertainty, temperatures, where), *more),
        capabilities=tuple(entry.capability for entry in document.cmc),
    )


def _with_unit_of_header(document: CalibrationFile, folder: Path, where: str) -> CalibrationFile:
    """With the unit of the response in the header of its first file, where none is stated and that is no voltage."""
    response, table = document.response, document.table
    column, key = (
        (response.column, "[response] column")
        if table is None
        else (table.magnitude, "[table] magnitude")
    )
    if column is None or "unit" in response.model_fields_set or abs(response.scale) != 1.0:
        return document
    source = open_columns(folder / data_files(document, folder, where)[0])
    found = unit_of_another_kind(source, source.position_of(column, key), response.unit)
    return (
        document.model_copy(update={"response": response.model_copy(update={"unit": found})})
        if found
        else document
    )
