"""A mounting that is known: the motion of the surface over that of the sensor's housing.

With the coupling's stiffness k, its damping c and the sensor's whole mass m it is 1 + s²/P with
P = 2 δ_m ω_m s + ω_m², ω_m² = k/m, 2 δ_m ω_m = c/m. Where the seismic mass is the part
μ/(1 + μ) of m, on a spring of natural frequency ωn and damping ratio δ, the s² becomes
s² (1 + μ R)/(1 + μ) with R = (2 δ ωn s + ωn²)/(s² + 2 δ ωn s + ωn²).
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.effects import SystematicEffect
from vibrident.data.known.response import KnownResponse
from vibrident.data.known.shapes import FloatArray, RationalResponse

#: Decades around the mounting frequency over which an effect is tabulated, and rows of the table.
DECADES_BELOW = 3.5
DECADES_ABOVE = 1.0
ROWS = 600
#: Half-widths of the resonance over which its rows lie closer, and their number.
HALF_WIDTHS = 20.0
ROWS_AT_RESONANCE = 201
#: Relative step of the derivative of an effect.
STEP = 1e-5


@dataclass(frozen=True)
class Mounting:
    """Known properties of a sensor's mounting.

    Attributes:
        frequency_hz: √(k/m)/2π of the coupling's stiffness and the sensor's whole mass; None where
            a fit of ``+mounting`` is to find it, and the mass ratio alone is known.
        standard_uncertainty: of the frequency, relative.
        damping_ratio: of the mounted resonance.
        damping_uncertainty: its standard uncertainty.
        mass_ratio: seismic mass over that of the housing.
        mass_ratio_uncertainty: its standard uncertainty.
        natural_frequency_hz: of the sensor on a fixed base, where the mass ratio is above zero.
        sensor_damping_ratio: of the sensor on a fixed base.

    Raises:
        InputError: a value cannot be used, or one that is needed is missing.

    Examples:
        >>> import vibrident
        >>> mounting = vibrident.Mounting(30e3, standard_uncertainty=0.05)
        >>> abs(mounting.response.value([10e3])).round(4).tolist()  # surface over housing
        [0.8889]
    """

    frequency_hz: float | None = None
    standard_uncertainty: float = 0.0
    damping_ratio: float = 0.0
    damping_uncertainty: float = 0.0
    mass_ratio: float = 0.0
    mass_ratio_uncertainty: float = 0.0
    natural_frequency_hz: float | None = None
    sensor_damping_ratio: float = 0.0

    def __post_init__(self) -> None:
        require_usable(vars(self), ("frequency_hz", "natural_frequency_hz"), "[mounting]")
        if self.frequency_hz is None and not self.mass_ratio > 0.0:
            raise _refused(
                "Nothing is stated of the mounting.",
                "frequency_hz, or stiffness_n_per_m and mass_kg; or mass_ratio for a fit",
                "none of them",
                "state one of them, or leave the mounting out",
            )
        if self.is_known and self.mass_ratio > 0.0 and self.natural_frequency_hz is None:
            raise _refused(
                "A mass ratio needs the sensor's own resonance.",
                "natural_frequency_hz of the sensor on a fixed base",
                "mass_ratio without it",
                "add natural_frequency_hz, or leave mass_ratio out: the whole mass is then rigid",
            )

    @property
    def is_known(self) -> bool:
        """Return whether its frequency is stated, so that it is taken out of the data."""
        return self.frequency_hz is not None

    @property
    def response(self) -> KnownResponse:
        """Return the motion of the surface over that of the housing, with its uncertainty."""
        return KnownResponse(
            (self._shape,), "1", effects=tuple(self._effects()), source=self._source
        )

    @property
    def _source(self) -> str:
        assert self.frequency_hz is not None
        return f"mounting at {self.frequency_hz:.6g} Hz"

    @property
    def _shape(self) -> RationalResponse:
        """Return surface over housing by poles and zeros, rad/s."""
        assert self.frequency_hz is not None
        w = 2.0 * np.pi * self.frequency_hz
        coupling = np.array([2.0 * self.damping_ratio, 1.0])  # by falling powers of s/w
        masses = np.polyadd([1.0, 0.0, 0.0], coupling)
        if self.mass_ratio > 0.0:
            assert self.natural_frequency_hz is not None
            ratio = self.natural_frequency_hz / self.frequency_hz
            spring = np.array([2.0 * self.sensor_damping_ratio * ratio, ratio**2])
            sensor = np.polyadd([1.0, 0.0, 0.0], spring)
            moved = np.polyadd(sensor, self.mass_ratio * spring) / (1.0 + self.mass_ratio)
            masses = np.polyadd(np.polymul(coupling, sensor), np.append(moved, [0.0, 0.0]))
            coupling = np.polymul(coupling, sensor)
        zeros = np.asarray(w * np.roots(masses), dtype=complex)
        poles = np.asarray(w * np.roots(coupling), dtype=complex)
        lead = masses[0] / np.trim_zeros(coupling, "f")[0]
        gain = float(lead * w ** (len(poles) - len(zeros)))
        return RationalResponse(poles, zeros, gain)

    def _effects(self) -> Iterator[SystematicEffect]:
        """Yield the effects of its uncertainties: changes of log response over frequency."""
        assert self.frequency_hz is not None
        uncertainties = {
            "frequency_hz": (self.standard_uncertainty, self.frequency_hz),  # relative
            "damping_ratio": (self.damping_uncertainty, 1.0),
            "mass_ratio": (self.mass_ratio_uncertainty if self.mass_ratio > 0.0 else 0.0, 1.0),
        }
        frequency_hz = self._table_frequencies()
        for name, (u, unit) in uncertainties.items():
            if u == 0.0:
                continue
            value = float(getattr(self, name))
            step = STEP * (value or 1.0)
            low = max(value - step, 0.0)
            high = value + step
            below, above = (
                replace(self, **{name: end})._shape.at(frequency_hz) for end in (low, high)
            )
            change = unit * np.log(above / below) / (high - low)
            columns = frequency_hz.tolist(), change.real.tolist(), change.imag.tolist()
            source = f"{self._source}, its {name.removesuffix('_hz').replace('_', ' ')}"
            pattern = tuple(zip(*columns, strict=True))
            yield SystematicEffect(source, "mounting", u, pattern=pattern)

    def _table_frequencies(self) -> FloatArray:
        """Return the frequencies at which effects are tabulated, Hz, rising."""
        assert self.frequency_hz is not None
        decades = np.linspace(-DECADES_BELOW, DECADES_ABOVE, ROWS)
        centres = [(self.frequency_hz, max(self.damping_ratio, 1e-3))]
        if self.mass_ratio > 0.0 and self.natural_frequency_hz is not None:
            centres.append((self.natural_frequency_hz, max(self.sensor_damping_ratio, 1e-3)))
        near = [
            hz * (1.0 + np.linspace(-1, 1, ROWS_AT_RESONANCE) * min(HALF_WIDTHS * damping, 0.9))
            for hz, damping in centres
        ]
        return np.sort(np.concatenate([self.frequency_hz * 10.0**decades, *near]))


def require_usable(
    values: Mapping[str, float | None], above_zero: Collection[str], where: str
) -> None:
    """Check that the properties of a mounting are finite, and none is negative.

    Args:
        values: by name; None: not stated.
        above_zero: names of those that are not zero either.
        where: names the place for the error.

    Raises:
        InputError: a value cannot be used.
    """
    for name, value in values.items():
        positive = name in above_zero
        if value is None or (
            np.isfinite(value) and (value > 0.0 or (value == 0.0 and not positive))
        ):
            continue
        raise InputError(
            f"The {name.removesuffix('_hz').replace('_', ' ')} of a mounting cannot be used.",
            expected="a finite number above 0" if positive else "a finite number, 0 or above",
            found=f"{name} = {value!r}",
            where=where,
            remedy=f"correct {name}",
        )


def _refused(problem: str, expected: str, value: str, remedy: str) -> InputError:
    return InputError(problem, expected=expected, found=value, where="[mounting]", remedy=remedy)
