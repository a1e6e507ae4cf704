"""Read a calibration file and its data into a Calibration."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from vibrident.base import sandbox
from vibrident.base.errors import InputError
from vibrident.base.process import Limits
from vibrident.data.io.calibration_file import CalibrationFile, read_calibration_file
from vibrident.data.io.columns import memory_for
from vibrident.data.io.header_units import SourceColumn, reference_unit, response_unit
from vibrident.data.io.known_files import as_channels, known_channel, known_files
from vibrident.data.io.mounting_section import mounting_of
from vibrident.data.io.reader import by_ending, open_columns
from vibrident.data.io.record_files import (
    CalibrationData,
    RecordRequest,
    data_files,
    named_requests,
    read_record,
    timing_effects,
)
from vibrident.data.io.sections import effects_at
from vibrident.data.io.table_file import read_table, table_response_unit
from vibrident.data.records import Calibration

#: Memory of a reading process for its libraries.
LIBRARIES_BYTES = 600_000_000
_COPIES = 2  # of a file's numbers that a reading process may hold
_MIN_SECONDS = 30.0  # that a reading process may take …
_SECONDS_PER_BYTE = 1e-6  # … and more for each byte of its files

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
    """Read as :func:`read` does, but binary data files in a separate process, with limits.

    A damaged file that crashes or hangs a native library is then an input error.

    Raises:
        InputError: as ``read`` does; or reading exceeded its limits, or crashed.
    """
    file = Path(path)
    document = read_calibration_file(file)
    names = [*data_files(document, file.parent, str(file)), *known_files(document)]
    readers = (by_ending().get(Path(name).suffix.lower()) for name in names)
    if all(reader is not None and reader.plain for reader in readers):
        return read(file)
    paths = (file.parent / name for name in names)
    size = sum(path.stat().st_size for path in paths if path.is_file())
    memory_bytes = int(LIBRARIES_BYTES + _COPIES * memory_for(size))
    seconds = _MIN_SECONDS + _SECONDS_PER_BYTE * size
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
    spans: Mapping[int, slice | None] | None = None,
) -> Calibration:
    """Read the data files of a checked calibration file.

    Args:
        document: the calibration file.
        folder: where relative paths start.
        where: the calibration file, for messages.
        spans: index of each record to read and the samples to read of it; None: all records.

    Raises:
        InputError: a data file cannot be used.
    """
    channels = _with_response_unit(as_channels(document), folder, where)
    data = _read_data(channels, folder, where, spans)
    update: dict[str, object] = {"response": channels.response}
    if document.interferometer is not None:
        motion = {"quantity": data.quantity, "unit": data.unit}
        update["reference"] = document.reference.model_copy(update=motion)
    stated = document.model_copy(update=update)
    reference = known_channel(stated, "reference", folder, where)
    response = known_channel(stated, "response", folder, where)
    temperatures = [record.circumstances.temperature_c for record in data.records]
    temperatures = [temperature for temperature in temperatures if temperature is not None]
    if not temperatures and document.certificate.temperature_c is not None:
        temperatures = [document.certificate.temperature_c]
    return Calibration(
        records=data.records,
        table=data.table,
        model=document.sensor.model,
        quantity=stated.reference.quantity,
        reference_unit=data.unit if reference.response is None else reference.measured,
        reference_standard_uncertainty=document.reference.standard_uncertainty,
        response_unit=response.measured,
        sensor=document.sensor_text,
        source=where,
        certificate=document.certificate.stated(),
        effects=(*effects_at(document.uncertainty, temperatures, where), *data.effects),
        capabilities=tuple(entry.capability for entry in document.cmc),
        reference_known_response=reference.response,
        response_known_response=response.response,
        mounting=None if document.mounting is None else mounting_of(document.mounting, where),
    )


def _read_data(
    document: CalibrationFile, folder: Path, where: str, spans: Mapping[int, slice | None] | None
) -> CalibrationData:
    """Read the records or the table of a calibration file; arguments as ``calibration_of``."""
    if document.interferometer is not None:
        # loads SciPy, which others do not need
        from vibrident.data.io.optical_files import read_optical

        return read_optical(document, folder, where)
    quantity = document.reference.quantity
    if document.table is not None:
        unit = reference_unit(document.reference, "")
        return CalibrationData(quantity, unit, table=read_table(document, folder, where))
    requests = named_requests(document, folder, where)
    unit = reference_unit(document.reference, _first_unit(document, requests[0][0], folder))
    spans = dict.fromkeys(range(len(requests))) if spans is None else spans
    readings = [
        read_record(*requests[index], document, folder, unit, span) for index, span in spans.items()
    ]
    records = tuple(reading.record for reading in readings)
    return CalibrationData(quantity, unit, records, effects=timing_effects(readings))


def _first_unit(document: CalibrationFile, request: RecordRequest, folder: Path) -> str:
    """Return the unit of a drive that the first file states; "" for none, or another quantity."""
    entry = request.entry
    column = document.reference.column
    if document.reference.quantity != "drive" or column is None or entry.excitation == "decay":
        return ""
    source = open_columns(folder / (entry.reference_file or request.file))
    return SourceColumn(source, source.position_of(column, "[reference] column")).file_unit[0]


def _with_response_unit(document: CalibrationFile, folder: Path, where: str) -> CalibrationFile:
    """Return the calibration file with the response's unit, which the first data file may state."""
    response = document.response
    if "unit" in response.model_fields_set:
        return document
    source = open_columns(folder / data_files(document, folder, where)[0])
    if document.table is not None:
        unit = table_response_unit(document, source)
    else:
        assert response.column is not None  # checked with the calibration file
        position = source.position_of(response.column, "[response] column")
        unit = response_unit(SourceColumn(source, position), response)
    if unit == response.unit:
        return document
    return document.model_copy(update={"response": response.model_copy(update={"unit": unit})})
