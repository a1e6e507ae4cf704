"""Read a calibration file and its data into a Calibration."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from vibrident.base import sandbox
from vibrident.base.errors import InputError
from vibrident.base.process import Limits
from vibrident.data.effects import SystematicEffect
from vibrident.data.io.calibration_file import CalibrationFile, read_calibration_file
from vibrident.data.io.columns import memory_for
from vibrident.data.io.header_units import file_unit, reference_unit, response_unit
from vibrident.data.io.known_files import as_channels, known_channel, known_files
from vibrident.data.io.mounting_section import mounting_of
from vibrident.data.io.reader import by_ending, open_columns
from vibrident.data.io.record_files import (
    RecordRequest,
    data_files,
    named_requests,
    read_record,
    timing_effects,
)
from vibrident.data.io.sections import effects_at
from vibrident.data.io.table_file import read_table, table_response_unit
from vibrident.data.records import Calibration, Record

# Of a reading process: memory for its libraries, and more as a multiple of the numbers' limit;
# time, and more a byte.
LIBRARIES_BYTES = 600_000_000
_COPIES = 2
_SECONDS = 30.0
_SECONDS_PER_BYTE = 1e-6


#: A calibration, or the path of its calibration file.
GivenCalibration = Calibration | str | os.PathLike[str]


def as_calibration(calibration: GivenCalibration) -> Calibration:
    """Return a calibration, read from its file where a path is given.

    Args:
        calibration: a calibration, or the path of a calibration file.

    Raises:
        InputError: the file or its data cannot be used.
    """
    return calibration if isinstance(calibration, Calibration) else read(calibration)


def read_guarded(path: str | os.PathLike[str]) -> Calibration:
    """Read as :func:`read` does; binary data files in a separate process, with limits.

    A damaged file that crashes or hangs a native library is then merely bad input. The cost is one
    process a calibration.

    Raises:
        InputError: as ``read`` does; or reading takes more than it may, or crashed.
    """
    file = Path(path)
    document = read_calibration_file(file)
    names = [*data_files(document, file.parent, str(file)), *known_files(document)]
    readers = (by_ending().get(Path(name).suffix.lower()) for name in names)
    if all(reader is not None and reader.plain for reader in readers):
        return read(file)
    size = sum(
        (file.parent / name).stat().st_size for name in names if os.path.isfile(file.parent / name)
    )
    memory_bytes = int(LIBRARIES_BYTES + _COPIES * memory_for(size))
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
        Calibration: records, or a table, in physical units: the reference in m/s², m/s, m or the
        drive's own unit, the response in [response] unit.

    Raises:
        InputError: the file or the data cannot be used.

    Examples:
        >>> import vibrident
        >>> path = vibrident.simulate(frequencies_hz=[160, 400, 650], samples=2000).save("bench")
        >>> calibration = vibrident.read(path)
        >>> len(calibration.records), calibration.units
        (3, {'reference': 'm/s^2', 'response': 'V'})
    """
    file = Path(path)
    return calibration_of(read_calibration_file(file), file.parent, str(file))


def calibration_of(
    document: CalibrationFile,
    folder: Path,
    where: str,
    rows: Mapping[int, slice] | None = None,
) -> Calibration:
    """Return the calibration of a checked file, whose relative paths start at ``folder``.

    ``rows``: index of a record and its samples, of the records that are read; None: all.
    """
    quantity = document.reference.quantity
    described = document
    document = as_channels(document)
    records: tuple[Record, ...] = ()
    table = None
    more: tuple[SystematicEffect, ...] = ()
    document = _with_response_unit(document, folder, where)
    described = described.model_copy(update={"response": document.response})
    if document.interferometer is not None:
        # loads SciPy, which others do not need
        from vibrident.data.io.optical_files import read_optical

        records, quantity, unit, more = read_optical(document, folder, where)
        light = described.reference.model_copy(update={"quantity": quantity, "unit": unit})
        described = described.model_copy(update={"reference": light})
    elif document.table:
        unit = reference_unit(document.reference, "")
        table = read_table(document, folder, where)
    else:
        requests = named_requests(document, folder, where)
        unit = reference_unit(document.reference, _first_unit(document, requests[0][0], folder))
        spans = dict.fromkeys(range(len(requests))) if rows is None else rows
        readings = [
            read_record(*requests[number], document, folder, unit, span)
            for number, span in spans.items()
        ]
        records = tuple(reading.record for reading in readings)
        more = timing_effects(readings)
    temperatures = [
        t for record in records if (t := record.circumstances.temperature_c) is not None
    ]
    if not temperatures and document.certificate.temperature_c is not None:
        temperatures = [document.certificate.temperature_c]
    reference = known_channel(described, "reference", folder, where)
    response = known_channel(described, "response", folder, where)
    return Calibration(
        records=records,
        table=table,
        model=document.sensor.model,
        quantity=quantity,
        reference_unit=unit if reference.response is None else reference.measured,
        reference_standard_uncertainty=document.reference.standard_uncertainty,
        response_unit=response.measured,
        sensor=document.sensor_text,
        source=where,
        certificate=document.certificate.stated(),
        effects=(*effects_at(document.uncertainty, temperatures, where), *more),
        capabilities=tuple(entry.capability for entry in document.cmc),
        reference_known_response=reference.response,
        response_known_response=response.response,
        mounting=None if document.mounting is None else mounting_of(document.mounting, where),
    )


def _first_unit(document: CalibrationFile, request: RecordRequest, folder: Path) -> str:
    """Return the unit that the first file states of a drive; "" for none, or another quantity."""
    column = document.reference.column
    if (
        document.reference.quantity != "drive"
        or column is None
        or request.entry.excitation == "decay"
    ):
        return ""
    source = open_columns(folder / (request.entry.reference_file or request.file))
    return file_unit(source, source.position_of(column, "[reference] column"))[0]


def _with_response_unit(document: CalibrationFile, folder: Path, where: str) -> CalibrationFile:
    """Return the calibration file with the unit of the response decided, by the first data file."""
    response = document.response
    if "unit" in response.model_fields_set:
        return document
    first = data_files(document, folder, where)[0]
    source = open_columns(folder / first)
    if document.table is not None:
        unit = table_response_unit(document, source)
    else:
        assert response.column is not None  # checked with the calibration file
        position = source.position_of(response.column, "[response] column")
        unit = response_unit(source, position, response)
    if unit == response.unit:
        return document
    decided = response.model_copy(update={"unit": unit})
    return document.model_copy(update={"response": decided})
