"""The calibration file: its keys and its reading. Data files are not opened here."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, ConfigDict, Field

from vibrident.base.errors import InputError
from vibrident.data.effects import Circumstances
from vibrident.data.io.certificate import CertificateSection
from vibrident.data.io.keys import basic, expert, key
from vibrident.data.io.known_section import KnownResponseEntry, check_known
from vibrident.data.io.mounting_section import MountingSection
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
    require_one,
    require_only_with,
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
_Name = Annotated[str, Field(min_length=1, description="the name of a complex array")]
_AnyText = Annotated[str, Field(description="text in quotes")]
#: Text, a number or a date: it is printed as it stands.
_Free = Annotated[Any, Field(description="text, a number or a date")]
_Label = Annotated[str | int, Field(description="a number, or text in quotes")]
_File = Annotated[
    str, Field(min_length=1, pattern=r"^[^\x00]*$", description="a file name in quotes")
]


#: Lower end of a band that states the upper one alone: below every frequency that is measured.
LOWEST_HZ = 1e-12
_EMPTY_BAND = "The band of the fit is empty."
_FULL_SCALE = "The most that the recorder holds, in units of the file."
_ABOUT_KNOWN_RESPONSE = (
    "Of the channel; the column is then in the channel's own unit (unit, else V)."
)
_SCALE = "Multiplies what is there after the unit that the file states."
_STANDARD = "Standard uncertainty (k = 1)."


class SensorSection(FileSection):
    """[sensor]: the model, and free text for reports."""

    model_config: ClassVar[ConfigDict] = ConfigDict(extra="allow")
    manufacturer: _Free = basic()
    type: _Free = basic()
    serial_number: _Free = basic()
    model: Text = basic(default=USUAL_MODEL, about='With add-ons: "accelerometer+delay".')

    @property
    def free(self) -> dict[str, Any]:
        """Return the keys but the model, as far as they are stated."""
        declared = type(self).model_fields.keys() & self.model_fields_set - {"model"}
        declared_values = {name: getattr(self, name) for name in sorted(declared)}
        return {**declared_values, **(self.model_extra or {})}


class ReferenceSection(FileSection):
    """[reference]: the channel of the interferometer, reference transducer or drive."""

    column: Column | None = basic("Reference: column")
    quantity: Quantity = basic(
        "Reference: quantity",
        default="acceleration",
        words=(
            "acceleration, m/s²",
            "velocity, m/s",
            "displacement, m",
            "drive, its own unit",
            "force, N",
        ),
    )
    scale: _Scale = basic("Reference: scale", default=1.0, about=_SCALE)
    unit: _AnyText = basic("Reference: unit", default="")
    standard_uncertainty: NotNegative = basic(
        "Reference: u, relative", default=0.0, about="Systematic: of its calibration."
    )
    full_scale: Positive | None = key("Reference: full scale", about=_FULL_SCALE)
    known_response: list[KnownResponseEntry] = expert(default=[], about=_ABOUT_KNOWN_RESPONSE)


class ResponseSection(FileSection):
    """[response]: the channel of the sensor under test."""

    column: Column | None = basic("Response: column")
    scale: _Scale = basic("Response: scale", default=1.0, about=_SCALE)
    unit: Text = basic("Response: unit", default="V")
    full_scale: Positive | None = key("Response: full scale", about=_FULL_SCALE)
    known_response: list[KnownResponseEntry] = expert(default=[], about=_ABOUT_KNOWN_RESPONSE)


class SamplingSection(FileSection):
    """[sampling]: a rate, or the column that holds the times."""

    rate_hz: Positive | None = basic("Sampling rate", "Hz", about="Else that of the file.")
    time_column: Column | None = basic("Time column", "s")


def stated_band(section: Any) -> tuple[float, float] | None:
    """Return the band between ``from_hz`` and ``to_hz`` of a section; None without them."""
    if section.from_hz is None and section.to_hz is None:
        return None
    return section.from_hz or LOWEST_HZ, section.to_hz or math.inf


class RecordsEntry(FileSection):
    """Entry [[records]]: a file or a glob, and its excitation."""

    file: _File = expert(default=..., about="A name or a glob.")
    excitation: Excitation = basic(default=...)
    frequency_hz: Positive | None = key(
        "Frequency of the sine", "Hz", about="A start value; it is found in the data otherwise."
    )
    start_s: NotNegative | None = key("Part of the record: from", "s", about="0: its start.")
    stop_s: Positive | None = key("Part of the record: to", "s", about="Not included.")
    from_hz: Positive | None = key("Band of the fit: from", "Hz", about="Not of free decays.")
    to_hz: Positive | None = key("Band of the fit: to", "Hz", about="Included.")
    name: Text | None = expert("Name in tables", about="For an entry with one file.")
    reference_file: _File | None = expert("File of the reference", about="If it is another.")
    rate_hz: Positive | None = key("Rate of these records", "Hz", about="If it is another.")
    start_time_s: Number | None = key("Clock time of the first sample", "s")
    run: _Label = key(default="", about="Which of several runs it belongs to.")
    mounting: _Label = key(default="", about="During which mounting of the sensor.")
    axis: Literal["", "x", "y", "z"] = key("Axis of the motion", default="", about="Sensor's own.")
    temperature_c: Number | None = key("Temperature of the sensor", "°C")

    @property
    def band_hz(self) -> tuple[float, float] | None:
        """Return the band that a fit takes; None: all."""
        return stated_band(self)

    @property
    def circumstances(self) -> Circumstances:
        """Return the circumstances of the records of the entry."""
        return Circumstances(str(self.run), str(self.mounting), self.axis, self.temperature_c)


class TableSection(FileSection):
    """[table]: a tabulated response instead of records, in one of ``TABLE_WAYS``."""

    file: _File = expert(default=...)
    frequency: Column | None = basic(about="In Hz, or the unit of its header.")
    magnitude: Column | None = basic()
    phase: Column | None = basic()
    real: Column | None = key("Real part", about="With imaginary, in place of magnitude.")
    imaginary: Column | None = key("Imaginary part")
    complex: _Name | None = key("Complex array", about="In place of magnitude and phase.")
    magnitude_uncertainty: Column | None = basic("u of the magnitude", about=_STANDARD)
    phase_uncertainty: Column | None = basic("u of the phase", about=_STANDARD)
    real_uncertainty: Column | None = key("u of the real part", about=_STANDARD)
    imaginary_uncertainty: Column | None = key("u of the imaginary part", about=_STANDARD)
    phase_unit: Literal["deg", "rad"] = basic(
        "Unit of the phase", default="deg", words=("as the file states, or deg", "deg", "rad")
    )
    magnitude_unit: Literal["", "dB"] = key(
        "Unit of the magnitude",
        default="",
        about="Where no header says dB: 20 lg, re 1 unit of the column.",
    )

    coverage_factor: Positive = key(
        "k of these uncertainties", default=1.0, about="2 where the table states U = k u."
    )
    from_hz: Positive | None = key("Band of the fit: from", "Hz")
    to_hz: Positive | None = key("Band of the fit: to", "Hz", about="Included.")

    @property
    def band_hz(self) -> tuple[float, float] | None:
        """Return the band that a fit takes; None: all."""
        return stated_band(self)

    @property
    def response_column(self) -> tuple[Column, str]:
        """Return the column whose unit is that of the response, and the key that names it."""
        if self.complex is not None:
            return f"{self.complex}.real", "[table] complex"
        if self.real is not None:
            return self.real, "[table] real"
        assert self.magnitude is not None  # by the check of the file
        return self.magnitude, "[table] magnitude"


#: How a table may give the response: the keys of each way, and those that must be there.
TABLE_WAYS = (
    (("magnitude", "phase", "magnitude_unit"), ("magnitude",)),
    (("real", "imaginary"), ("real", "imaginary")),
    (("complex",), ("complex",)),
)


class CalibrationFile(FileSection):
    """A calibration file, checked; see the documentation for each key."""

    sensor: SensorSection = key("Sensor and model", default=SensorSection())
    reference: ReferenceSection = key("Reference: motion of the sensor", default=ReferenceSection())
    interferometer: InterferometerSection | None = key("Raw signals of an interferometer")
    mounting: MountingSection | None = key("Mounting of the sensor")
    response: ResponseSection = key("Response: output of the sensor", default=ResponseSection())
    sampling: SamplingSection = key("Sampling and excitation", default=SamplingSection())
    records: list[RecordsEntry] = key("Records", default=[])
    table: TableSection | None = key("Columns of the table")
    certificate: CertificateSection = key(default=CertificateSection())
    uncertainty: list[UncertaintyEntry] = key("Sources of uncertainty", default=[])
    cmc: list[CapabilityEntry] = key("Capability (CMC)", default=[])

    @property
    def sensor_text(self) -> dict[str, str]:
        """Return the free text of [sensor]."""
        return {name: str(value) for name, value in self.sensor.free.items()}


def read_calibration_file(path: Path) -> CalibrationFile:
    """Read and check a calibration file.

    InputError where it is not TOML, or a key or value is not allowed.
    """
    return checked_calibration(read_toml(path), str(path))


def checked_calibration(document: Mapping[str, Any], where: str) -> CalibrationFile:
    """Return the keys of a calibration file, checked; ``where`` names it.

    Errors as :func:`read_calibration_file`.
    """
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
    for section in ("reference", "response"):
        entries = getattr(calibration, section).known_response
        check_known(entries, f"{where}, [[{section}.known_response]]")
    _check_content(calibration, where)
    return calibration


def _check_sensor(calibration: CalibrationFile, where: str) -> None:
    """Refuse a misspelt ``model``, which would be free text and change the result."""
    for name, value in calibration.sensor.free.items():
        if difflib.get_close_matches(name.lower(), ["model"], n=1, cutoff=0.8):
            raise InputError(
                f"The key {name!r} looks like a misspelt 'model'.",
                expected="model = …, or a key less similar to it",
                found=f"{name} = {value!r}",
                where=f"{where}, [sensor]",
                remedy="did you mean 'model'?",
            )
        if isinstance(value, dict | list):
            raise InputError(
                "[sensor] holds text for reports, one line a key.",
                expected="text, a number or a date",
                found=f"{name} = {value!r}"[:80],
                where=f"{where}, [sensor] {name}",
                remedy="write it as text",
            )


def _check_content(calibration: CalibrationFile, where: str) -> None:
    names = {"records": "[[records]] with file and excitation", "table": "[table]"}
    require_one(calibration, names, "A calibration needs either records or a table.", where)
    if calibration.interferometer is not None:
        stated_keys = calibration.reference.model_fields_set
        table = calibration.table is not None
        check_interferometer(calibration.interferometer, stated_keys, table, where)
    if calibration.table is not None:
        _check_table(calibration.table, f"{where}, [table]")
        return
    if calibration.response.column is None:
        raise _missing("[response] column", where)
    moved = calibration.interferometer is None and any(
        entry.excitation != "decay" for entry in calibration.records
    )
    if calibration.reference.column is None and moved:
        raise _missing("[reference] column", where)
    names = {"rate_hz": "rate_hz", "time_column": "time_column"}
    twice = "The sampling rate is given twice."
    location = f"{where}, [sampling]"
    require_one(calibration.sampling, names, twice, location, needed=False)
    for number, entry in enumerate(calibration.records, start=1):
        _check_entry(entry, f"{where}, [[records]] entry {number}")


def _check_table(section: TableSection, where: str) -> None:
    """Refuse a table that has no response or two, or keys that do not go together."""
    _require_rising(section, "from_hz", "to_hz", _EMPTY_BAND, where)
    stated_keys = section.model_fields_set
    ways = [way for way, _ in TABLE_WAYS if stated_keys & set(way)]
    is_polar = ways == [TABLE_WAYS[0][0]]
    if len(ways) != 1 or not stated_keys >= set(dict(TABLE_WAYS)[ways[0]]):
        raise InputError(
            "A table gives its response in one way.",
            expected="magnitude (and phase), or real and imaginary, or complex",
            found=" and ".join(name for way in ways for name in way if name in stated_keys)
            or "none",
            where=where,
            remedy="give the keys of one way, all of them",
        )
    if section.frequency is None and section.complex is None:
        raise _missing("[table] frequency", where.removesuffix(", [table]"))
    rectangular_keys = {"real_uncertainty", "imaginary_uncertainty"} & stated_keys
    polar_keys = {"magnitude_uncertainty", "phase_uncertainty"} & stated_keys
    if rectangular_keys and (len(rectangular_keys) == 1 or is_polar or polar_keys):
        raise InputError(
            "The uncertainties do not fit the response of the table.",
            expected="real_uncertainty and imaginary_uncertainty, both and alone, of a response "
            "in real and imaginary part; or magnitude_uncertainty and phase_uncertainty",
            found=", ".join(sorted(rectangular_keys | polar_keys)),
            where=where,
            remedy="give one of the two pairs",
        )
    if "phase_uncertainty" in stated_keys and is_polar and section.phase is None:
        raise InputError(
            "There is an uncertainty of the phase but no phase.",
            expected="phase where phase_uncertainty is given",
            found="phase_uncertainty alone",
            where=where,
            remedy="add phase = …, or remove phase_uncertainty",
        )


def _require_rising(section: Any, low: str, high: str, problem: str, where: str) -> None:
    """Refuse two keys of which the second is not above the first."""
    first = getattr(section, low)
    second = getattr(section, high)
    if first is not None and second is not None and second <= first:
        raise InputError(
            problem,
            expected=f"{high} above {low}",
            found=f"{low} = {first!r}, {high} = {second!r}",
            where=where,
            remedy="correct one of the two",
        )


def _check_entry(entry: RecordsEntry, where: str) -> None:
    _require_rising(entry, "from_hz", "to_hz", _EMPTY_BAND, where)
    _require_rising(entry, "start_s", "stop_s", "The part of the record is empty.", where)
    problem = "Only a sine has one frequency."
    require_only_with(entry, "frequency_hz", "excitation", "sine", problem, where, needed=False)


def _missing(key: str, where: str) -> InputError:
    section, name = key.split("] ")
    return InputError(
        f"The key {key} is missing.",
        expected="a column number from 1, or a header name",
        found="nothing",
        where=f"{where}, {section}]",
        remedy=f"add {name} = …",
    )
