"""From the confirmed form to the calibration file that reproduces it from the shell, and files told by their names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from vibrident.base.errors import InputError
from vibrident.data.io.guess import Columns
from vibrident.data.io.toml_text import toml_entry, toml_section
from vibrident.data.records import USUAL_MODEL
from vibrident.physics.models import ADD_ONS

#: Fields that name a column of a table.
POINTS = ("frequency", "magnitude", "phase", "magnitude_uncertainty", "phase_uncertainty")
ROLES = ("time", "reference", "first_signal", "second_signal", "response", *POINTS)  # fields that name a column


def delays() -> list[str]:
    """Add-ons that do nothing but delay: usual wherever there is a phase."""
    return [addon.name for addon in ADD_ONS.values() if addon.is_delay]


@dataclass
class Description:
    """The user's description of the data, starting with a guess. A column is its name, or its number from 1.

    ``reference_by`` is ``channel`` (a column in physical units), or the kind of an interferometer. Its signals may be
    in files of their own, whose names have ``optical_part`` more than those of the response.
    """

    table: bool = False
    time: int | str | None = None
    rate_hz: float | None = None
    reference: int | str | None = None
    quantity: str = "acceleration"
    scale: float | None = 1.0
    unit: str = ""
    standard_uncertainty: float | None = None
    reference_by: str = "channel"
    first_signal: int | str | None = None
    second_signal: int | str | None = None
    wavelength_nm: float | None = 632.991
    wavelength_relative_uncertainty: float | None = None
    passes: float | None = 1
    carrier_hz: float | None = None
    direction: int | None = None
    optical_rate_hz: float | None = None
    optical_part: str = ""
    optical_delay_s: float | None = None
    optical_delay_standard_uncertainty_s: float | None = None
    response: int | str | None = None
    response_scale: float | None = 1.0
    response_unit: str = "V"
    excitation: str = "sine"
    frequency: int | str | None = None
    magnitude: int | str | None = None
    phase: int | str | None = None
    magnitude_uncertainty: int | str | None = None
    phase_uncertainty: int | str | None = None
    phase_unit: str = "deg"
    core: str = USUAL_MODEL
    add_ons: list[str] = field(default_factory=delays)
    sensor: dict[str, str] = field(default_factory=lambda: {"manufacturer": "", "type": "", "serial_number": ""})

    @property
    def model(self) -> str:
        """The model's name, such as accelerometer+delay."""
        return "+".join((self.core, *self.add_ons))

    @property
    def signals(self) -> tuple[int | str | None, ...]:
        """Columns of the photodetector signals; empty if the reference is a channel."""
        if self.table or self.excitation == "decay" or self.reference_by == "channel":
            return ()
        both = (self.first_signal, self.second_signal)
        return both if self.reference_by == "quadrature" else both[:1]

    def pairs(self, files: Sequence[str]) -> list[tuple[str, str | None]]:
        """The file of each record, and that of its optical signals where these are apart."""
        return paired(files, self.optical_part if self.signals else "")


def described(guess: Columns, excitation: str = "sine") -> Description:
    """A guess as a description; the excitation is guessed separately."""
    same = ("time", "reference", "quantity", "scale", "unit", "response", "response_unit")
    known = {name: getattr(guess, name) for name in (*same, *POINTS)}
    table = guess.is_table
    if guess.detectors:
        known["reference_by"] = "quadrature" if len(guess.detectors) == 2 else "heterodyne"
        known |= dict(zip(("first_signal", "second_signal"), guess.detectors, strict=False))
    known["add_ons"] = [] if table and guess.phase is None else delays()
    radians = any("rad" in str(column).lower() for column in (guess.phase, guess.phase_uncertainty))
    return Description(table=table, excitation=excitation, phase_unit="rad" if radians else "deg", **known)


def calibration_text(given: Description, files: Sequence[str]) -> str:
    """The calibration file, as text; refused where a choice is missing."""
    _complete(given, files)
    sensor = {key: text for key, text in given.sensor.items() if text} | {"model": given.model}
    reference: dict[str, Any] = {"standard_uncertainty": given.standard_uncertainty}
    if not given.signals:
        reference |= {
            "column": None if given.table or given.excitation == "decay" else given.reference,
            "quantity": given.quantity,
            "scale": None if given.table else given.scale,
            "unit": (given.unit or None) if not given.table or given.quantity == "drive" else None,
        }
    column = None if given.table else given.response
    response = {"column": column, "scale": given.response_scale, "unit": given.response_unit}
    sections = [toml_section("sensor", sensor), toml_section("reference", _floats(reference))]
    if given.signals:
        sections.append(toml_section("interferometer", _interferometer(given)))
    sections.append(toml_section("response", _floats(response)))
    if given.table:
        columns = {name: getattr(given, name) for name in POINTS}
        unit = given.phase_unit if given.phase is not None else None
        return "\n".join((*sections, toml_section("table", {"file": files[0], **columns, "phase_unit": unit})))
    if given.time is not None or given.rate_hz is not None:
        sampling = {"time_column": given.time, "rate_hz": None if given.time is not None else given.rate_hz}
        sections.append(toml_section("sampling", _floats(sampling)))
    entries = [
        toml_entry("records", {"file": file, "reference_file": other, "excitation": given.excitation})
        for file, other in given.pairs(files)
    ]
    return "\n".join((*sections, *entries))


def _interferometer(given: Description) -> dict[str, Any]:
    """The section's keys; a key without a value is left to its default."""
    assert given.wavelength_nm is not None  # checked by _complete
    numbers = {
        "wavelength_m": given.wavelength_nm / 1e9,
        "wavelength_relative_uncertainty": given.wavelength_relative_uncertainty,
        "carrier_hz": given.carrier_hz if given.reference_by == "heterodyne" else None,
        "delay_s": given.optical_delay_s,
        "delay_standard_uncertainty_s": given.optical_delay_standard_uncertainty_s,
        "rate_hz": given.optical_rate_hz,
    }
    passes = given.passes
    whole = int(passes) if passes is not None and float(passes).is_integer() else passes
    known = {"kind": given.reference_by, "columns": list(given.signals), "passes": whole, "direction": given.direction}
    return known | {key: None if number is None else float(number) for key, number in numbers.items()}


def _floats(values: dict[str, Any]) -> dict[str, Any]:
    numbers = ("scale", "standard_uncertainty", "rate_hz")
    return {key: float(value) if key in numbers and value is not None else value for key, value in values.items()}


def _complete(given: Description, files: Sequence[str]) -> None:
    if given.table and len(files) != 1:
        raise _missing("A tabulated response is one file.", "one file", f"{len(files)} files", "remove the others")
    usual = "a number; 1 if the file has the unit itself"
    wanted = {"frequency": given.frequency, "magnitude": given.magnitude}
    numbers = {"scale of the response": (given.response_scale, usual)}
    if not given.table:
        wanted = {"response": given.response}
        if given.signals:
            names = ("cosine", "sine") if given.reference_by == "quadrature" else ("signal on the carrier",)
            wanted |= dict(zip(names, given.signals, strict=True))
            numbers["wavelength"] = (given.wavelength_nm, "a number in nm, such as 632.991")
            if given.reference_by == "heterodyne":
                numbers["carrier"] = (given.carrier_hz, "its frequency in Hz")
        else:
            numbers["scale of the reference"] = (given.scale, usual)
            if given.excitation != "decay":
                wanted["reference"] = given.reference
    for name, column in wanted.items():
        if column is None:
            raise _missing(f"No column is chosen for the {name}.", "a column of the file", "none", "choose one")
    for name, (number, expected) in numbers.items():
        if number is None:
            raise _missing(f"The {name} is empty.", expected, "none", "fill it in")
    if given.table or given.excitation == "decay":
        return
    motion = given.signals or (given.reference,)
    if given.response in motion and not (given.signals and given.optical_part):
        text = "Reference and response are the same column."
        raise _missing(text, "two columns", repr(given.response), "choose another for one of the two")
    if len(set(motion)) != len(motion):
        text = "Both photodetector signals are the same column."
        raise _missing(text, "two columns", repr(motion[0]), "choose another for one of the two")


def _missing(problem: str, expected: str, found: str, remedy: str) -> InputError:
    return InputError(problem, expected=expected, found=found, where="columns and units", remedy=remedy)


def mark(files: Sequence[str]) -> str:
    """The part of a name that optical files have beyond the response's, such as ``_optical``; empty for no pairs.

    Half of the files must have it, and each of them a partner without it.
    """
    if len(files) < 2 or len(files) % 2:
        return ""
    first, *others = (Path(file).stem for file in files)
    parts = (_added(*sorted((first, other), key=len)) for other in others)
    return next((part for part in parts if part and _partners(files, part) is not None), "")


def paired(files: Sequence[str], part: str) -> list[tuple[str, str | None]]:
    """Each file of a response with the file of its optical signals; without a part of names, all are in one."""
    if not part:
        return [(file, None) for file in files]
    found = _partners(files, part)
    if found is None:
        optical = [file for file in files if part in Path(file).stem]
        raise InputError(
            "The files with optical signals do not match those with responses.",
            expected=f"for each file a second one, with {part!r} more in its name",
            found=f"{len(files) - len(optical)} files without {part!r}, {len(optical)} with it",
            where="columns and units",
            remedy="add or rename files, or correct that part of the names; leave it empty for signals in one file",
        )
    return list(found)


def _partners(files: Sequence[str], part: str) -> list[tuple[str, str | None]] | None:
    """Pairs in the order of the responses; None if a file is left over."""
    optical = {Path(file).stem.replace(part, "", 1): file for file in files if part in Path(file).stem}
    others = [file for file in files if part not in Path(file).stem]
    if len(optical) != len(others) or len(files) != 2 * len(others) or not others:
        return None
    pairs = [(file, optical.get(Path(file).stem)) for file in others]
    return pairs if all(partner is not None for _, partner in pairs) else None


def _added(short: str, long: str) -> str:
    """What a name has beyond another, in one place; empty if they differ otherwise."""
    same = next((i for i, (a, b) in enumerate(zip(short, long, strict=False)) if a != b), len(short))
    more = len(long) - len(short)
    for start in range(same, -1, -1):
        if more and long[:start] + long[start + more :] == short:
            return long[start : start + more]
    return ""
