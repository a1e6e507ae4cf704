"""[certificate]: the contents of a certificate besides its numbers, in a file of either kind."""

from __future__ import annotations

import datetime
import itertools
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, ConfigDict, Field, model_validator

from vibrident.base.errors import InputError
from vibrident.data.io.keys import FormKind, key
from vibrident.data.io.schema_errors import validated
from vibrident.data.io.sections import FileSection, NotNegative, Number, Positive, Text
from vibrident.data.io.toml_text import read_toml, toml_document

Language = Literal["en", "de", "fr", "zh"]
#: Whether a part of a certificate is printed; it is where nothing is said.
Printed = Literal["print", "leave out"]
_PRINTED = ("print", "leave out")
#: Keys of the dates of a certificate, in the order in which they can be.
DATES = ("date_of_receipt", "date_of_calibration", "date_of_issue")
_LANGUAGES = ("English", "German", "French", "Chinese")


def _integer_as_text(value: Any) -> Any:
    """Return an integer, such as the number of an order, as text; other values as they are."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


def _date_as_text(value: Any) -> Any:
    """Return a date of TOML, or one in quotes, as text."""
    if isinstance(value, datetime.date) and not isinstance(value, datetime.datetime):
        return value.isoformat()
    if isinstance(value, str):
        return datetime.date.fromisoformat(value).isoformat()
    raise ValueError("not a date")


def _as_list(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


def _as_named(value: Any) -> Any:
    return {"name": value} if isinstance(value, str) else value


# A field's description is the "expected" of its error message.
_Text = Annotated[
    str,
    BeforeValidator(_integer_as_text),
    Field(min_length=1, description="text in quotes, not empty"),
]
_Address = Annotated[_Text, FormKind("lines")]
_Date = Annotated[
    str,
    BeforeValidator(_date_as_text),
    Field(description="a date such as 2025-03-31"),
    FormKind("date"),
]
_Lines = Annotated[
    list[Annotated[str, Field(min_length=1)]],
    BeforeValidator(_as_list),
    Field(min_length=1, description="text in quotes, or a list of such"),
]
_Quantities = Annotated[
    list[Literal["magnitude", "phase"]],
    BeforeValidator(_as_list),
    Field(min_length=1, description='"magnitude", "phase" or a list of both'),
    FormKind("lines"),
]
_Country = Annotated[
    str, Field(pattern="^[A-Z]{2}$", description="two capitals (ISO 3166-1), such as DE")
]
_Percent = Annotated[float, Field(ge=0, le=100, description="a number from 0 to 100")]


class InstrumentSection(FileSection):
    """Instrument used, and where its own traceability is stated."""

    name: _Text
    manufacturer: _Text | None = None
    type: _Text | None = None
    serial_number: _Text | None = None
    certificate: _Text | None = None
    calibrated_until: _Date | None = None


class RequirementSection(FileSection):
    """A specification to judge conformity by: of a parameter, or of the sensitivity over a band.

    ``quantity`` is a parameter's name with ``low`` and ``high`` in its unit; or
    ``sensitivity_deviation``, in percent from the sensitivity at the reference frequency, at each
    measured frequency from ``from_hz`` to ``to_hz``.
    """

    quantity: Text
    low: Number | None = key("Low limit")
    high: Number | None = key("High limit")
    from_hz: Positive | None = key("From", "Hz")
    to_hz: Positive | None = key("To", "Hz")
    source: _Text | None = None

    @model_validator(mode="after")
    def _limited(self) -> RequirementSection:
        if self.low is None and self.high is None:
            raise ValueError("a requirement has low or high, or both")
        for lower, upper in ((self.low, self.high), (self.from_hz, self.to_hz)):
            if lower is not None and upper is not None and lower > upper:
                raise ValueError("the lower limit is above the upper one")
        return self


_Instrument = Annotated[InstrumentSection, BeforeValidator(_as_named)]


class CertificateSection(FileSection):
    """[certificate]; see docs/report.md for the meaning of each key."""

    number: _Text | None = None
    laboratory: _Text | None = None
    laboratory_address: _Address | None = None
    accreditation: _Text | None = None
    customer: _Text | None = None
    customer_address: _Address | None = None
    order_number: _Text | None = None
    date_of_receipt: _Date | None = None
    date_of_calibration: _Date | None = None
    date_of_issue: _Date | None = None
    place: _Text | None = None
    condition: _Text | None = None
    mounting: _Text | None = None
    direction: _Text | None = None
    amplitude: _Text | None = None
    conditioning: _Text | None = None
    temperature_c: Number | None = key(unit="°C")
    temperature_uncertainty_c: NotNegative | None = key(unit="°C")
    relative_humidity_percent: _Percent | None = key(unit="%")
    relative_humidity_uncertainty_percent: NotNegative | None = key(unit="%")
    air_pressure_hpa: Positive | None = key(unit="hPa")
    air_pressure_uncertainty_hpa: NotNegative | None = key(unit="hPa")
    procedure: _Text | None = None
    traceability: _Text | None = None
    instruments: list[_Instrument] = Field(
        default=[], description="a list of names, or [[certificate.instruments]]"
    )
    reference_frequency_hz: Positive | None = key(unit="Hz")
    quantities: _Quantities | None = None
    operator: _Text | None = None
    approved_by: _Text | None = None
    remarks: _Lines | None = None
    deviations: _Lines | None = None
    external_results: _Lines | None = None
    opinions: _Lines | None = None
    requirements: list[RequirementSection] = Field(
        default=[],
        description="[[certificate.requirements]], each with a quantity and low or high or both, "
        "low at most high, and from_hz at most to_hz",
    )
    decision_rule: Literal["simple", "guarded"] | None = None
    budget: Printed | None = key("Uncertainty budget", words=_PRINTED)
    data_files: Printed | None = key("Data files with SHA-256", words=_PRINTED)
    replaces: _Text | None = None
    changes: _Lines | None = None
    language: Language | None = key(words=_LANGUAGES)
    second_language: Language | None = key(words=_LANGUAGES)
    country: _Country | None = None

    def stated(self) -> Mapping[str, Any]:
        """Return what the file states, as plain values; dates as text."""
        return self.model_dump(exclude_none=True, exclude_unset=True)


class _OwnSection(CertificateSection):
    """[certificate] of a certificate file, which may name other files, relative to it."""

    logo: _Text | None = None
    template: _Text | None = None
    before: _Text | None = None
    fonts: _Text | None = None


class _SensorText(FileSection):
    """[sensor] of a certificate file: further text about the sensor."""

    model_config: ClassVar[ConfigDict] = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, _Text] = Field(init=False)


class _CertificateFile(FileSection):
    certificate: _OwnSection = _OwnSection()
    sensor: _SensorText = Field(
        default_factory=_SensorText, description="text in quotes, one line a key"
    )


class _Form(FileSection):
    certificate: CertificateSection = CertificateSection()


@dataclass(frozen=True)
class CertificateData:
    """Data given for a certificate after the fit."""

    # as [certificate] of a calibration file, plain values, dates as text
    certificate: Mapping[str, Any] = field(default_factory=dict)
    sensor: Mapping[str, str] = field(default_factory=dict)  # further text of [sensor]
    logo: Path | None = None  # file of the laboratory's logo (SVG, PNG or JPEG)
    template: Path | None = None  # file of the laboratory's own typst template
    before: Path | None = None  # result.json of the calibration before an adjustment
    fonts: Path | None = None  # folder with further fonts


def certificate_data(files: Sequence[str | os.PathLike[str]]) -> CertificateData:
    """Read certificate files; a later file replaces what an earlier one states.

    Raises:
        InputError: a file cannot be read, is not TOML, names a file that is not there, or holds a
            key or value that is not allowed.
    """
    keys: dict[str, Any] = {}
    sensor: dict[str, str] = {}
    named: dict[str, Path] = {}
    for file in map(Path, files):
        document = validated(
            _CertificateFile, read_toml(file, "certificate"), str(file), "certificate"
        )
        section = dict(document.certificate.stated())
        for kind in section.keys() & {"logo", "template", "before", "fonts"}:
            named[kind] = _existing(file.parent / section.pop(kind), kind, str(file))
        keys |= section
        sensor |= {name: str(text) for name, text in (document.sensor.model_extra or {}).items()}
    return CertificateData(keys, sensor, **named)


def certificate_text(data: CertificateData) -> str:
    """Return what is stated as the text of a certificate file, without the files that it names."""
    return toml_document({"sensor": data.sensor, "certificate": data.certificate})


def certificate_section(values: Mapping[str, Any], where: str) -> Mapping[str, Any]:
    """Return the values of a form, checked as [certificate]; ``where`` names the form."""
    return validated(
        _Form, {"certificate": dict(values)}, where, "certificate"
    ).certificate.stated()


def check_dates(certificate: Mapping[str, Any], where: str) -> None:
    """Refuse dates of a certificate that cannot be true together.

    A sensor is received, calibrated, and then its certificate is issued; each instrument with a
    ``calibrated_until`` is valid on the day of the calibration (ISO/IEC 17025:2017, 6.4).

    Raises:
        InputError: a date cannot be read, comes before an earlier step, or an instrument was
            overdue.
    """
    dated = [(key, _day(certificate[key], key, where)) for key in DATES if certificate.get(key)]
    for (former, before), (latter, after) in itertools.pairwise(dated):
        if before > after:
            raise InputError(
                "The dates of the certificate contradict each other.",
                expected=" ≤ ".join(DATES),
                found=f"{former} {before}, {latter} {after}",
                where=f"{where}, [certificate]",
                remedy="correct the wrong one",
            )
    calibrated = dict(dated).get("date_of_calibration")
    for instrument in certificate.get("instruments") or ():
        until = instrument.get("calibrated_until") if isinstance(instrument, Mapping) else None
        if calibrated is None or not until:
            continue
        if _day(until, "calibrated_until", where) < calibrated:
            raise InputError(
                "An instrument was not valid on the day of the calibration.",
                expected=f"calibrated_until {calibrated} or later",
                found=f"{instrument.get('name')}, calibrated_until {until}",
                where=f"{where}, [[certificate.instruments]]",
                remedy="state its newer calibration, or calibrate with a valid instrument",
            )


def _day(value: object, key: str, where: str) -> datetime.date:
    """Return a date that is written as XML schema does; Python reads other forms too."""
    try:
        day = datetime.date.fromisoformat(str(value))
        if day.isoformat() == str(value):
            return day
    except ValueError:
        pass
    raise InputError(
        "A date of the certificate cannot be read.",
        expected="year, month and day, such as 2025-03-31",
        found=repr(value),
        where=f"{where}, certificate {key}",
        remedy="correct it in the calibration file and identify again, or in the certificate file",
    )


def _existing(path: Path, key: str, where: str) -> Path:
    if path.is_dir() if key == "fonts" else path.is_file():
        return path
    raise InputError(
        f"The {'folder' if key == 'fonts' else 'file'} of {key} cannot be read.",
        expected="a folder" if key == "fonts" else "a file, relative to the certificate file",
        found="none of that name",
        where=f"{where}, [certificate] {key} = {path.name!r}",
        remedy="correct the name",
    )
