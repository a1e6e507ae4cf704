"""Sections of the calibration file that stand by themselves: strict, and the types of their keys.

[interferometer]; [[uncertainty]] and [[cmc]] by one number, by band, by table, and by temperature.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping, Sequence
from typing import Annotated, Any, ClassVar, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from vibrident.base.errors import InputError
from vibrident.data.effects import Capability, StatedKind, SystematicEffect
from vibrident.data.interferometer.setting import Interferometer
from vibrident.data.interferometer.setting import Kind as Signals
from vibrident.data.io.keys import FormKind, basic, expert, key


class FileSection(BaseModel):
    """A section: no other keys than its own, no conversion of types."""

    model_config: ClassVar[ConfigDict] = ConfigDict(extra="forbid", strict=True, frozen=True)


def _column(value: int | str) -> int | str:
    if value == "" or (isinstance(value, int) and value < 1):
        raise ValueError("not a column")
    return value


# A field's description is the "expected" of its error message.
Column = Annotated[
    int | str,
    AfterValidator(_column),
    Field(description="a column number from 1, or a header name"),
    FormKind("column"),
]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False, description="a finite number above 0")]
NotNegative = Annotated[
    float, Field(ge=0, allow_inf_nan=False, description="a finite number, 0 or above")
]
Number = Annotated[float, Field(allow_inf_nan=False, description="a finite number")]
Text = Annotated[str, Field(min_length=1, description="text in quotes, not empty")]


def require_one(
    section: Any, names: Mapping[str, str], problem: str, where: str, *, needed: bool = True
) -> None:
    """Refuse two keys that exclude each other and, where one is needed, neither of them.

    ``names``: key → how the message calls it.
    """
    present = [name for key, name in names.items() if getattr(section, key) not in (None, [])]
    if len(present) != 1 and (present or needed):
        raise InputError(
            problem,
            expected=" or ".join(names.values()),
            found=f"both, {' and '.join(present)}" if present else "neither",
            where=where,
            remedy="keep one of the two" if present else f"add {', or '.join(names.values())}",
        )


def require_only_with(
    section: Any, name: str, other_key: str, value: str, problem: str, where: str, *, needed: bool
) -> None:
    """Refuse a key unless ``other_key`` has this value; where it is needed, its absence then."""
    fits = getattr(section, other_key) == value
    is_present = getattr(section, name) is not None
    if is_present != fits and (is_present or needed):
        raise InputError(
            problem,
            expected=f'{name} with {other_key} = "{value}" alone',
            found=f"{other_key} = {getattr(section, other_key)!r}, "
            f"{name} = {getattr(section, name)!r}",
            where=where,
            remedy=f"add {name} = …" if fits else f"remove {name}, or correct {other_key}",
        )


#: Keys of [reference] that are not allowed beside [interferometer].
CHANNEL_KEYS = ("column", "quantity", "scale", "unit", "full_scale")
#: Shortest and longest wavelength of a laser, m: from excimer to CO2 lasers, with room.
_MIN_WAVELENGTH_M = 1e-7
_MAX_WAVELENGTH_M = 2e-5


class InterferometerSection(FileSection):
    """[interferometer]: the photodetectors' signals and the displacement of one radian of phase."""

    kind: Signals = basic(
        "Photodetector signals",
        default=...,
        words=("none", "two in quadrature, cos and sin", "one on a carrier"),
    )
    columns: Annotated[
        list[Column],
        Field(min_length=1, max_length=2, description="a list of column numbers or names"),
        FormKind("columns"),
    ] = basic("Signals", default=..., about="Of two, cos comes before sin.")
    wavelength_m: Positive = basic(
        "Wavelength in the medium", "m", default=..., in_form=("nm", 1e9)
    )
    wavelength_relative_uncertainty: NotNegative = basic("Wavelength: u, relative", default=0.0)
    passes: Annotated[int, Field(ge=1, le=1000, description="a whole number, 1 or above")] = basic(
        "Passes to the target and back", default=1
    )
    carrier_hz: Positive | None = basic("Carrier, approximately", "Hz")
    direction: Annotated[
        Literal[1, -1] | None, Field(description="1 or -1: the sign of x for growing phase")
    ] = basic(
        "Direction of x", words=("not known", "x grows with the phase", "x falls with the phase")
    )
    delay_s: Number = basic("Optical channel later by", "s", default=0.0)
    delay_standard_uncertainty_s: NotNegative = basic("u of this delay", "s", default=0.0)
    rate_hz: Positive | None = basic("Optical sampling rate, if another", "Hz")

    @property
    def setting(self) -> Interferometer:
        """Return the section as the interferometer that it describes."""
        return Interferometer(**self.model_dump(exclude={"columns", "rate_hz"}))


def check_interferometer(
    section: InterferometerSection, reference: Collection[str], table: bool, where: str
) -> None:
    """Refuse keys of the section, of [reference], or a [table] that contradict each other."""
    location = f"{where}, [interferometer]"
    if table:
        raise InputError(
            "An interferometer needs records.",
            expected="[[records]] with the photodetectors' signals",
            found="[table] and [interferometer]",
            where=location,
            remedy="keep one of the two",
        )
    _require_light(section.wavelength_m, location)
    channel_keys = [name for name in CHANNEL_KEYS if name in reference]
    if channel_keys:
        raise InputError(
            "The reference is given twice.",
            expected="[interferometer], and in [reference] at most standard_uncertainty",
            found=", ".join(f"[reference] {name}" for name in channel_keys),
            where=location,
            remedy="remove these keys, or [interferometer]",
        )
    signals = 2 if section.kind == "quadrature" else 1
    if len(section.columns) != signals:
        raise InputError(
            f"The kind {section.kind!r} has {'two signals' if signals == 2 else 'one signal'}.",
            expected=f"columns with {signals} entr{'ies' if signals == 2 else 'y'}",
            found=f"columns = {section.columns!r}",
            where=f"{location} columns",
            remedy="name the column of each photodetector signal, or correct kind",
        )
    problem = "Only a heterodyne signal has a carrier."
    require_only_with(section, "carrier_hz", "kind", "heterodyne", problem, location, needed=True)


def _require_light(wavelength_m: float, where: str) -> None:
    if _MIN_WAVELENGTH_M <= wavelength_m <= _MAX_WAVELENGTH_M:
        return
    plausible_m = [
        f"{wavelength_m * unit:.9g}"
        for unit in (1e-9, 1e-6)
        if _MIN_WAVELENGTH_M <= wavelength_m * unit <= _MAX_WAVELENGTH_M
    ]
    raise InputError(
        "The wavelength is not that of light.",
        expected=f"wavelength_m in metres, from {_MIN_WAVELENGTH_M:g} to {_MAX_WAVELENGTH_M:g}",
        found=f"wavelength_m = {wavelength_m!r}",
        where=f"{where} wavelength_m",
        remedy=f"write wavelength_m = {plausible_m[0]}"
        if plausible_m
        else "give it in metres, 632.991e-9 for a helium-neon laser",
    )


_EDGE_OCTAVES = 1e-9  # relative width of the edge of a band
_Table = Annotated[
    list[Annotated[list[NotNegative], Field(min_length=2, max_length=2)]],
    Field(
        min_length=1,
        description="pairs of frequency in Hz and value, such as [[10, 0.002], [1000, 0.004]]",
    ),
    FormKind("pairs"),
]


#: Kinds of contributions that may hold over a band.
_BANDED: tuple[StatedKind, ...] = ("gain", "phase")
_PERCENT = ("%", 100.0)
_DEGREES = ("°", 180.0 / math.pi)


class UncertaintyEntry(FileSection):
    """Entry [[uncertainty]]: a systematic contribution, common to all points."""

    source: Text = basic("Source", default=..., about="What it comes from, in words.")
    kind: StatedKind = basic(
        "Kind",
        default=...,
        words=("gain", "timing", "phase", "mounting", "clock"),
    )
    standard_uncertainty: NotNegative | None = basic(
        "Standard uncertainty",
        about="Gain, mounting and clock: relative; timing: in s; phase: in rad.",
        in_form_by=(
            "kind",
            {
                "gain": _PERCENT,
                "timing": ("µs", 1e6),
                "phase": _DEGREES,
                "mounting": _PERCENT,
                "clock": ("ppm", 1e6),
            },
        ),
    )
    table: _Table | None = expert("Standard uncertainty by frequency", about="Of gain and phase.")
    from_hz: Positive | None = basic("From", "Hz", about="Of gain, phase.", only=("kind", _BANDED))
    to_hz: Positive | None = basic("To", "Hz", about="Of gain, phase.", only=("kind", _BANDED))
    from_c: Number | None = key("From", "°C", about="By temperature_c of the records.")
    to_c: Number | None = key("To", "°C", about="By temperature_c of the records.")
    frequency_hz: Positive | None = basic("At", "Hz", only=("kind", ("mounting",)))
    degrees_of_freedom: Positive | None = basic("Degrees of freedom")

    @property
    def effect(self) -> SystematicEffect:
        """Return the entry as the record of an effect."""
        freedom = math.inf if self.degrees_of_freedom is None else self.degrees_of_freedom
        size = max((u for _, u in self.table or ()), default=self.standard_uncertainty or 0.0)
        scale = size if self.table and size else 1.0
        real, imaginary = (0.0, -1.0) if self.kind == "phase" else (1.0, 0.0)
        rows = tuple(
            (f, real * weight / scale, imaginary * weight / scale) for f, weight in self._shape
        )
        return SystematicEffect(self.source, self.kind, size, self.frequency_hz, freedom, rows)

    @property
    def _shape(self) -> list[tuple[float, float]]:
        """Return frequency and size of the rows of a table or a band; empty for neither."""
        if self.table:
            return [(float(f), float(u)) for f, u in self.table]
        low = self.from_hz
        high = self.to_hz
        below = [] if low is None else [(low * (1.0 - _EDGE_OCTAVES), 0.0), (low, 1.0)]
        return below + ([] if high is None else [(high, 1.0), (high * (1.0 + _EDGE_OCTAVES), 0.0)])


class CapabilityEntry(FileSection):
    """Entry [[cmc]]: the smallest expanded uncertainty (k = 2) that the laboratory may state."""

    quantity: Literal["magnitude", "phase"] = key(
        "Of", default="magnitude", words=("the magnitude", "the phase")
    )
    expanded_uncertainty: Positive = key(
        "Least U (k = 2)",
        default=...,
        about="Of the magnitude relative, of the phase in rad. "
        "Curve, points and gain are raised to it; budget and certificate say so.",
        in_form_by=("quantity", {"magnitude": _PERCENT, "phase": _DEGREES}),
    )
    from_hz: Positive | None = key("From", "Hz")
    to_hz: Positive | None = key("To", "Hz")

    @property
    def capability(self) -> Capability:
        """Return the entry as a capability."""
        return Capability(
            self.quantity, self.expanded_uncertainty, self.from_hz or 0.0, self.to_hz or math.inf
        )


def check_uncertainties(entries: Sequence[UncertaintyEntry], where: str) -> None:
    """Refuse an entry that has no size or two, or keys that its kind does not have."""
    for number, entry in enumerate(entries, start=1):
        location = f"{where}, [[uncertainty]] entry {number}"
        sizes = {"standard_uncertainty": "standard_uncertainty", "table": "table"}
        require_one(entry, sizes, "A contribution has one size.", location)
        problem = "Only a mounting effect has a frequency."
        require_only_with(entry, "frequency_hz", "kind", "mounting", problem, location, needed=True)
        band = [k for k in ("table", "from_hz", "to_hz") if getattr(entry, k) is not None]
        both = entry.table is not None and len(band) > 1
        if both or (band and entry.kind not in _BANDED):
            raise InputError(
                "A table or a band does not fit this entry.",
                expected='table, or from_hz and to_hz, with kind = "gain" or "phase"',
                found=f"kind = {entry.kind!r} with {' and '.join(band)}",
                where=location,
                remedy=f"remove {' and '.join(band[1:] if both else band)}",
            )
        rows = [row[0] for row in entry.table or ()]
        frequencies = rows or [f for f in (entry.from_hz, entry.to_hz) if f is not None]
        rising = all(lower < upper for lower, upper in itertools.pairwise([0.0, *frequencies]))
        if not rising:
            raise InputError(
                "The frequencies of a contribution do not rise.",
                expected="frequencies above zero, each above the one before",
                found=f"{frequencies}",
                where=location,
                remedy="put them in order",
            )


def effects_at(
    entries: Sequence[UncertaintyEntry], temperatures_c: Sequence[float], where: str
) -> tuple[SystematicEffect, ...]:
    """Return the effects that hold at all of these temperatures.

    InputError where an entry holds at some of them, or none is stated.
    """
    effects = []
    for number, entry in enumerate(entries, start=1):
        low = -math.inf if entry.from_c is None else entry.from_c
        high = math.inf if entry.to_c is None else entry.to_c
        inside = [low <= t <= high for t in temperatures_c]
        everywhere = low == -math.inf and high == math.inf
        if not everywhere and (not inside or any(inside) != all(inside)):
            temperatures = ", ".join(f"{t:g}" for t in dict.fromkeys(temperatures_c)) or "none"
            raise InputError(
                "A contribution holds at some temperatures, and those of the records do not decide "
                "whether it does.",
                expected="temperature_c of the records, or of [certificate], all from "
                f"{low:g} to {high:g}, or none",
                found=temperatures,
                where=f"{where}, [[uncertainty]] entry {number}",
                remedy="state temperature_c, or leave from_c and to_c out",
            )
        if all(inside):
            effects.append(entry.effect)
    return tuple(effects)
