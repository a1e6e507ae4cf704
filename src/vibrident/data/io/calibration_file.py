"""The calibration file: its keys and its reading. Data files are not opened here."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, ConfigDict, Field

from vibrident.base.errors import InputError
from vibrident.data.effects import Circumstances
from vibrident.data.io.certificate import CertificateSection
from vibrident.data.io.schema_errors import validated
from vibrident.data.io.sections import (
    CapabilityEntry,
    Column,
    FileSection,
    InterferometerSection,
    NotNegative,
    Number,
    Positive,
    Text,
    UncertaintyEntry,
    check_interferometer,
    check_uncertainties,
)
from vibrident.data.io.toml_text import read_toml
from vibrident.data.records import USUAL_MODEL, Excitation, Quantity


def _scale(value: float) -> float:
    if value == 0:
        raise ValueError("zero")
    return value


_Scale = Annotated[
    float,
    AfterValidator(_scale),
    Field(allow_inf_nan=False, description="a finite number other than 0"),
]
_Label = Annotated[str | int, Field(description="a number, or text in quotes")]
_File = Annotated[
    str, Field(min_length=1, pattern=r"^[^\x00]*$", description="a file name in quotes")
]


class SensorSection(FileSection):
    """[sensor]: the model, and free text for reports."""

    model_config = ConfigDict(extra="allow")
    model: Text = USUAL_MODEL


class ReferenceSection(FileSection):
    """[reference]: the channel of the interferometer, reference transducer or drive."""

    column: Column | None = None
    quantity: Quantity = "acceleration"
    scale: _Scale = 1.0
    unit: str = Field(default="", description="text in quotes")
    standard_uncertainty: NotNegative = 0.0
    full_scale: Positive | None = None


class ResponseSection(FileSection):
    """[response]: the channel of the sensor under test."""

    column: Column | None = None
    scale: _Scale = 1.0
    unit: Text = "V"
    full_scale: Positive | None = None


class SamplingSection(FileSection):
    """[sampling]: a rate, or the column that holds the times."""

    rate_hz: Positive | None = None
    time_column: Column | None = None


class RecordsEntry(FileSection):
    """One [[records]] entry: a file or a glob, and its excitation."""

    file: _File
    excitation: Excitation
    frequency_hz: Positive | None = None
    start_s: NotNegative | None = None
    stop_s: Positive | None = None
    name: Text | None = None
    reference_file: _File | None = None
    rate_hz: Positive | None = None
    start_time_s: Number | None = None
    run: _Label = ""
    mounting: _Label = ""
    axis: Literal["", "x", "y", "z"] = ""
    temperature_c: Number | None = None

    @property
    def circumstances(self) -> Circumstances:
        """Under which the records of the entry were made."""
        return Circumstances(str(self.run), str(self.mounting), self.axis, self.temperature_c)


class TableSection(FileSection):
    """[table]: a tabulated response instead of records."""

    file: _File
    frequency: Column
    magnitude: Column
    phase: Column | None = None
    magnitude_uncertainty: Column | None = None
    phase_uncertainty: Column | None = None
    phase_unit: Literal["deg", "rad"] = "deg"
    magnitude_unit: Literal["", "dB"] = ""


class CalibrationFile(FileSection):
    """A calibration file, checked; see the documentation for each key."""

    sensor: SensorSection = SensorSection()
    reference: ReferenceSection = ReferenceSection()
    response: ResponseSection = ResponseSection()
    sampling: SamplingSection = SamplingSection()
    records: list[RecordsEntry] = Field(
        default=[], description="one or more [[records]], in double brackets"
    )
    table: TableSection | None = None
    interferometer: InterferometerSection | None = None
    certificate: CertificateSection = CertificateSection()
    uncertainty: list[UncertaintyEntry] = Field(
        default=[], description="one or more [[uncertainty]], in double brackets"
    )
    cmc: list[CapabilityEntry] = Field(
        default=[], description="one or more [[cmc]], in double brackets"
    )

    @property
    def sensor_text(self) -> dict[str, str]:
        """The free text of [sensor]."""
        return {key: str(value) for key, value in (self.sensor.model_extra or {}).items()}


def read_calibration_file(path: Path) -> CalibrationFile:
    """Read and check a calibration file; InputError where it is not TOML, or a key or value is not allowed."""
    return checked_calibration(read_toml(path), str(path))


def checked_calibration(document: Mapping[str, Any], where: str) -> CalibrationFile:
    """The keys of a calibration file, checked; ``where`` names it. Errors as :func:`read_calibration_file`."""
    for section in ("response", "reference"):
        if isinstance(document.get(section), list):
            raise InputError(
                f"The file has several [[{section}]]: it is a calibration of several axes.",
                expected=f"one [{section}]",
                found=f"[[{section}]], {len(document[section])} of them",
                where=where,
                remedy="use ⟦command = axes⟧, or write the section in single brackets",
            )
    calibration = validated(CalibrationFile, document, where)
    _check_sensor(calibration, where)
    check_uncertainties(calibration.uncertainty, where)
    _check_content(calibration, where)
    return calibration


def _check_sensor(calibration: CalibrationFile, where: str) -> None:
    """[sensor] allows any key, so a misspelt ``model`` would be free text and change the result."""
    for key, value in (calibration.sensor.model_extra or {}).items():
        if difflib.get_close_matches(key.lower(), ["model"], n=1, cutoff=0.8):
            raise InputError(
                f"The key {key!r} looks like a misspelt 'model'.",
                expected="model = …, or a key less similar to it",
                found=f"{key} = {value!r}",
                where=f"{where}, [sensor]",
                remedy="did you mean 'model'?",
            )
        if isinstance(value, dict | list):
            raise InputError(
                "[sensor] holds text for reports, one line a key.",
                expected="text, a number or a date",
                found=f"{key} = {value!r}"[:80],
                where=f"{where}, [sensor] {key}",
                remedy="write it as text",
            )


def _check_content(calibration: CalibrationFile, where: str) -> None:
    if bool(calibration.records) == (calibration.table is not None):
        raise InputError(
            "A calibration needs either records or a table.",
            expected="[[records]] or [table]",
            found="both" if calibration.records else "neither",
            where=where,
            remedy="keep one of the two"
            if calibration.records
            else "add [[records]] with file and excitation, or [table]",
        )
    if calibration.interferometer is not None:
        given = calibration.reference.model_fields_set
        check_interferometer(
            calibration.interferometer, given, calibration.table is not None, where
        )
    if calibration.table is not None:
        return
    if calibration.response.column is None:
        raise _missing("[response] column", where)
    moved = calibration.interferometer is None and any(
        entry.excitation != "decay" for entry in calibration.records
    )
    if calibration.reference.column is None and moved:
        raise _missing("[reference] column", where)
    sampling = calibration.sampling
    if sampling.rate_hz is not None and sampling.time_column is not None:
        raise InputError(
            "The sampling rate is given twice.",
            expected="rate_hz or time_column",
            found=f"rate_hz = {sampling.rate_hz!r} and time_column = {sampling.time_column!r}",
            where=f"{where}, [sampling]",
            remedy="keep the one that you trust",
        )
    for number, entry in enumerate(calibration.records, start=1):
        _check_entry(entry, f"{where}, [[records]] entry {number}")


def _check_entry(entry: RecordsEntry, where: str) -> None:
    if entry.start_s is not None and entry.stop_s is not None and entry.stop_s <= entry.start_s:
        raise InputError(
            "The part of the record is empty.",
            expected="stop_s above start_s",
            found=f"start_s = {entry.start_s!r}, stop_s = {entry.stop_s!r}",
            where=where,
            remedy="correct one of the two",
        )
    if entry.frequency_hz is not None and entry.excitation != "sine":
        raise InputError(
            "Only a sine has one frequency.",
            expected='frequency_hz with excitation = "sine" alone',
            found=f"frequency_hz = {entry.frequency_hz!r} with excitation = {entry.excitation!r}",
            where=where,
            remedy="remove frequency_hz, or correct the excitation",
        )


def _missing(key: str, where: str) -> InputError:
    section, name = key.split("] ")
    return InputError(
        f"The key {key} is missing.",
        expected="a column number from 1, or a header name",
        found="nothing",
        where=f"{where}, {section}]",
        remedy=f"add {name} = …",
    )
