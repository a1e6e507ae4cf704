"""Sections of the calibration file that stand by themselves: strict, and the types of their keys."""

from __future__ import annotations

from collections.abc import Collection
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

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
