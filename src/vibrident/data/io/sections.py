"""Sections of the calibration file that stand by themselves: strict, and the types of their keys."""

from __future__ import annotations

import datetime
from collections.abc import Collection, Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from vibrident.base.errors import InputError
from vibrident.data.interferometer.setting import Interferometer


class FileSection(BaseModel):
    """A section: no other keys than its own, no conversion of types."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


def _column(value: int | str) -> int | str:
    if value == "" or (isinstance(value, int) and value < 1):
        raise ValueError("not a column")
    return value


# A field's description is the "expected" of its error message.
Column = Annotated[int | str, AfterValidator(_column), Field(description="a column number from 1, or a header name")]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False, description="a finite number above 0")]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False, description="a finite number, 0 or above")]
Number = Annotated[float, Field(allow_inf_nan=False, description="a finite number")]
Text = Annotated[str, Field(min_length=1, description="text in quotes, not empty")]


#: Keys of [reference] that are not allowed beside [interferometer].
_TAKEN = ("column", "quantity", "scale", "unit", "full_scale")
#: Shortest and longest wavelength of a laser, m: from excimer to CO2 lasers, with room.
_SHORTEST, _LONGEST = 1e-7, 2e-5


class InterferometerSection(FileSection):
    """[interferometer]: the photodetectors' signals and the displacement of one radian of phase."""

    kind: Literal["quadrature", "heterodyne"]
    columns: Annotated[list[Column], Field(min_length=1, max_length=2, description="a list of column numbers or names")]
    wavelength_m: Positive
    wavelength_relative_uncertainty: NotNegative = 0.0
    passes: Annotated[int, Field(ge=1, le=1000, description="a whole number, 1 or above")] = 1
    carrier_hz: Positive | None = None
    direction: Annotated[Literal[1, -1] | None, Field(description="1 or -1: the sign of x for growing phase")] = None
    delay_s: Number = 0.0
    delay_standard_uncertainty_s: NotNegative = 0.0
    rate_hz: Positive | None = None

    @property
    def setting(self) -> Interferometer:
        """The section as the interferometer that it describes."""
        return Interferometer(**self.model_dump(exclude={"columns", "rate_hz"}))


def check_interferometer(section: InterferometerSection, reference: Collection[str], table: bool, where: str) -> None:
    """Check the combination of the section's keys, with those of [reference], and whether there is a [table].

    Raises:
        InputError: they contradict each other.
    """
    here = f"{where}, [interferometer]"
    if table:
        raise InputError(
            "An interferometer needs records.",
            expected="[[records]] with the photodetectors' signals",
            found="[table] and [interferometer]",
            where=here,
            remedy="keep one of the two",
        )
    _require_light(section.wavelength_m, here)
    taken = [key for key in _TAKEN if key in reference]
    if taken:
        raise InputError(
            "The reference is given twice.",
            expected="[interferometer], and in [reference] at most standard_uncertainty",
            found=", ".join(f"[reference] {key}" for key in taken),
            where=here,
            remedy="remove these keys, or [interferometer]",
        )
    wanted = 2 if section.kind == "quadrature" else 1
    if len(section.columns) != wanted:
        raise InputError(
            f"The kind {section.kind!r} has {'two signals' if wanted == 2 else 'one signal'}.",
            expected=f"columns with {wanted} entr{'ies' if wanted == 2 else 'y'}",
            found=f"columns = {section.columns!r}",
            where=f"{here} columns",
            remedy="name the column of each photodetector signal, or correct kind",
        )
    if (section.carrier_hz is None) == (section.kind == "heterodyne"):
        raise InputError(
            "Only a heterodyne signal has a carrier.",
            expected='carrier_hz with kind = "heterodyne" alone',
            found=f"kind = {section.kind!r}, carrier_hz = {section.carrier_hz!r}",
            where=f"{here} carrier_hz",
            remedy="add carrier_hz = …" if section.kind == "heterodyne" else "remove carrier_hz, or correct kind",
        )


def _require_light(wavelength_m: float, here: str) -> None:
    if _SHORTEST <= wavelength_m <= _LONGEST:
        return
    meant = [f"{wavelength_m * unit:.9g}" for unit in (1e-9, 1e-6) if _SHORTEST <= wavelength_m * unit <= _LONGEST]
    raise InputError(
        "The wavelength is not that of light.",
        expected=f"wavelength_m in metres, from {_SHORTEST:g} to {_LONGEST:g}",
        found=f"wavelength_m = {wavelength_m!r}",
        where=f"{here} wavelength_m",
        remedy=f"write wavelength_m = {meant[0]}" if meant else "give it in metres, 632.991e-9 for a helium-neon laser",
    )


def _text(value: Any) -> Any:
    """A number (of a certificate, of an order) is text."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


def _date(value: Any) -> Any:
    """A date of TOML, or the same in quotes, as text."""
    if isinstance(value, datetime.date) and not isinstance(value, datetime.datetime):
        return value.isoformat()
    if isinstance(value, str):
        return datetime.date.fromisoformat(value).isoformat()
    raise ValueError("not a date")


def _lines(value: Any) -> Any:
    return [value] if isinstance(value, str) else value


def _named(value: Any) -> Any:
    return {"name": value} if isinstance(value, str) else value


# A field's description is the "expected" of its error message.
_Text = Annotated[str, BeforeValidator(_text), Field(min_length=1, description="text in quotes, not empty")]
_Date = Annotated[str, BeforeValidator(_date), Field(description="a date such as 2025-03-31")]
_Lines = Annotated[
    list[Annotated[str, Field(min_length=1)]],
    BeforeValidator(_lines),
    Field(min_length=1, description="text in quotes, or a list of such"),
]
_Percent = Annotated[float, Field(ge=0, le=100, description="a number from 0 to 100")]


class InstrumentSection(FileSection):
    """One of the instruments used, and where its own traceability is stated."""

    name: _Text
    manufacturer: _Text | None = None
    type: _Text | None = None
    serial_number: _Text | None = None
    certificate: _Text | None = None
    calibrated_until: _Date | None = None


_Instrument = Annotated[InstrumentSection, BeforeValidator(_named)]


class CertificateSection(FileSection):
    """[certificate]; see docs/report.md for the meaning of each key."""

    number: _Text | None = None
    laboratory: _Text | None = None
    laboratory_address: _Text | None = None
    accreditation: _Text | None = None
    customer: _Text | None = None
    customer_address: _Text | None = None
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
    temperature_c: Number | None = None
    temperature_uncertainty_c: NotNegative | None = None
    relative_humidity_percent: _Percent | None = None
    relative_humidity_uncertainty_percent: NotNegative | None = None
    air_pressure_hpa: Positive | None = None
    air_pressure_uncertainty_hpa: NotNegative | None = None
    procedure: _Text | None = None
    traceability: _Text | None = None
    instruments: list[_Instrument] = Field(default=[], description="a list of names, or [[certificate.instruments]]")
    reference_frequency_hz: Positive | None = None
    operator: _Text | None = None
    approved_by: _Text | None = None
    remarks: _Lines | None = None

    def stated(self) -> Mapping[str, Any]:
        """What the file states, as plain values; dates as text."""
        return self.model_dump(exclude_none=True, exclude_unset=True)
