"""[certificate]: statements of a calibration certificate besides the data, all optional."""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from vibrident.io.section import FileSection, NotNegative, Number, Positive


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
