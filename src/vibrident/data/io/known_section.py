"""[[reference.known_response]] and [[response.known_response]]: known responses of channels."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from vibrident.base.errors import InputError
from vibrident.data.io.keys import expert
from vibrident.data.io.sections import Column, FileSection, NotNegative, Number, Positive, Text

_Roots = Annotated[
    list[Annotated[list[Number], Field(min_length=2, max_length=2)]],
    Field(description="pairs of real and imaginary part in rad/s, such as [[-4.4, 4.4]]"),
]
_Corners = Annotated[list[Positive], Field(description="a list of frequencies in Hz above 0")]
_Coefficients = Annotated[
    list[Number], Field(min_length=1, description="a list of numbers, by powers of 1/z")
]
#: The ways to state a response → the keys that one of them needs, and those that go with it.
WAYS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "a file": (
        ("file",),
        (
            *("frequency", "magnitude", "phase", "magnitude_uncertainty", "phase_uncertainty"),
            *("phase_unit", "magnitude_unit", "coverage_factor", "correlation_octaves"),
            *("channel", "time"),
        ),
    ),
    "poles and zeros": (("poles", "zeros"), ("gain",)),
    "a digital filter": (("numerator",), ("denominator", "rate_hz")),
    "corners": (("highpass_hz", "lowpass_hz"), ("gain", "corner_uncertainty")),
}
_ANY = {"unit", "standard_uncertainty", "phase_standard_uncertainty"}


class KnownResponseEntry(FileSection):
    """Known response of a channel; several are a chain, from the recorder to the motion."""

    file: Text | None = expert(
        about="A table; StationXML, RESP or SACPZ; or the result.json of the reference sensor."
    )
    frequency: Column | None = expert(about="Of a table: in Hz, or the unit of its header.")
    magnitude: Column | None = expert()
    phase: Column | None = expert(about="Of the channel minus that of the motion: lag negative.")
    magnitude_uncertainty: Column | None = expert()
    phase_uncertainty: Column | None = expert()
    phase_unit: Literal["deg", "rad"] = expert(default="deg")
    magnitude_unit: Literal["", "dB"] = expert(default="", about="Where no header says dB: 20 lg.")
    coverage_factor: Positive = expert(
        default=1.0, about="k of the table's uncertainties; 2 where it states U."
    )
    correlation_octaves: Positive | None = expert(
        about="Over which a table's errors lose their correlation; without it they are common."
    )
    channel: Text | None = expert(about="Of StationXML and RESP with several: its code.")
    time: Text | None = expert(about="Of StationXML and RESP with several epochs: a date.")
    poles: _Roots | None = expert()
    zeros: _Roots | None = expert()
    gain: Number | None = expert(about="Factor of poles and zeros, or gain between the corners.")
    numerator: _Coefficients | None = expert(about="Digital filter: b_0 + b_1/z + …")
    denominator: _Coefficients | None = expert(about="Digital filter: a_0 + a_1/z + …")
    rate_hz: Positive | None = expert(about="Digital filter: rate at its input.")
    highpass_hz: _Corners | None = expert(about="Of a conditioner: first-order corners.")
    lowpass_hz: _Corners | None = expert(about="Of a conditioner: first-order corners.")
    corner_uncertainty: NotNegative = expert(default=0.0, about="Relative, of each corner.")
    unit: Text | None = expert(
        about='Of the response, such as "V/(m/s^2)", "mV/g", "V/pC"; "1" leaves the unit as it is.'
    )
    standard_uncertainty: NotNegative = expert(
        default=0.0, about="Of the magnitude, relative, common to all frequencies."
    )
    phase_standard_uncertainty: NotNegative = expert(
        default=0.0, about="Of the phase in rad, common to all frequencies."
    )


def check_known(entries: list[KnownResponseEntry], where: str) -> None:
    """Refuse an entry that states its response in no way or two, or keys of another way."""
    for number, entry in enumerate(entries, start=1):
        location = f"{where} entry {number}"
        stated_keys = entry.model_fields_set
        ways = [way for way, (needed, _) in WAYS.items() if stated_keys & set(needed)]
        if len(ways) != 1:
            raise InputError(
                "A known response is stated in one way.",
                expected="file, or poles and zeros, or numerator, or highpass_hz and lowpass_hz",
                found=" and ".join(ways) or "none of them",
                where=location,
                remedy="give the keys of one way; a chain has an entry for each of its parts",
            )
        needed, optional = WAYS[ways[0]]
        odd = sorted(stated_keys - {*needed, *optional} - _ANY)
        if odd:
            raise InputError(
                f"A key does not belong to {ways[0]}.",
                expected=f"one of {', '.join((*needed, *optional, *sorted(_ANY)))}",
                found=", ".join(odd),
                where=location,
                remedy=f"remove {', '.join(odd)}",
            )
        if entry.numerator is not None and entry.rate_hz is None:
            raise InputError(
                "A digital filter needs the rate at its input.",
                expected="rate_hz",
                found="numerator without rate_hz",
                where=location,
                remedy="add rate_hz = … (samples per second)",
            )
