"""The way in: a calibration file and the data it names become a Calibration."""

from __future__ import annotations

import os
from pathlib import Path

from vibrident.io.calibration_file import read_calibration_file
from vibrident.io.record_files import read_records
from vibrident.io.table_file import read_table
from vibrident.io.units import reference_unit
from vibrident.records import Calibration


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
    where = str(file)
    document = read_calibration_file(file)
    unit = reference_unit(document.reference.quantity, document.reference.unit, document.reference.scale, where)
    return Calibration(
        records=() if document.table else read_records(document, file.parent, where, unit),
        table=read_table(document, file.parent, where) if document.table else None,
        model=document.sensor.model,
        quantity=document.reference.quantity,
        reference_unit=unit,
        reference_standard_uncertainty=document.reference.standard_uncertainty,
        response_unit=document.response.unit,
        sensor=document.sensor_text,
        source=where,
        certificate=document.certificate.stated(),
        effects=tuple(entry.effect for entry in document.uncertainty),
    )
