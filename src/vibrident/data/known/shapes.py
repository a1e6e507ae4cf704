"""Complex responses as functions of frequency: poles and zeros, a digital filter, a table.

All are for e^{+jωt}. They hold arrays and numbers alone, so that they travel between processes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vibrident.base.errors import InputError

#: Logarithm of the factor of frequency by which a table is extrapolated beyond its ends.
MAX_EXTRAPOLATION = np.log(4.0)
#: Fewest points of a table from which the error between them is estimated.
MIN_POINTS_FOR_ERROR = 7
FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class RationalResponse:
    """Response gain · Π(s − zeros) / Π(s − poles) · e^{−s delay}.

    Attributes:
        poles, zeros: rad/s, shapes (p,) and (z,).
        gain: factor of the products.
        delay_s: by which the channel comes later.

    Raises:
        InputError: a pole lies in the right half plane, or the response would not be real in time.
    """

    poles: ComplexArray
    zeros: ComplexArray
    gain: float = 1.0
    delay_s: float = 0.0

    def __post_init__(self) -> None:
        for name in ("poles", "zeros"):
            roots = np.atleast_1d(np.array(getattr(self, name), dtype=complex))
            object.__setattr__(self, name, roots)
            _require_pairs(name, roots)
        _require_numbers("gain", [self.gain], zero=False)
        unstable = self.poles[self.poles.real > 0.0]
        if unstable.size:
            raise _shape_error(
                "A pole lies in the right half plane: the channel would be unstable.",
                "poles whose real part is zero or below, in rad/s for e^{+jωt}",
                f"{unstable[0]:.6g} rad/s",
                "correct the sign of its real part",
            )

    def at(self, frequency_hz: FloatArray) -> ComplexArray:
        """Return the response at frequencies, of their shape."""
        s = 2j * np.pi * np.asarray(frequency_hz, dtype=float)
        value = np.asarray(self.gain * np.exp(-s * self.delay_s), dtype=complex)
        for number in range(max(self.zeros.size, self.poles.size)):  # in turn: no product overflows
            value = value * (s - self.zeros[number]) if number < self.zeros.size else value
            value = value / (s - self.poles[number]) if number < self.poles.size else value
        return np.asarray(value, dtype=complex)

    @property
    def time_poles(self) -> list[complex]:
        """Return the poles of its free motion in time, 1/s."""
        return [complex(pole) for pole in self.poles]

    @property
    def top_hz(self) -> float:
        """Return the highest frequency at which it is known."""
        return np.inf


def flat_gain(gain: float) -> RationalResponse:
    """Return the response that is this factor at all frequencies."""
    none = np.zeros(0, dtype=complex)
    return RationalResponse(none, none, float(gain))


@dataclass(frozen=True, eq=False)
class DigitalFilter:
    """Digital filter Σ b_k z^{−k} / Σ a_k z^{−k} · e^{+jω advance} with z = e^{jω/rate}.

    Attributes:
        numerator, denominator: b and a, by ascending powers of 1/z.
        rate_hz: samples per second at its input.
        advance_s: by which the stamps of its output were moved back for its delay.

    Raises:
        InputError: a number cannot be used, or a pole lies on the unit circle or outside.
    """

    numerator: FloatArray
    denominator: FloatArray
    rate_hz: float
    advance_s: float = 0.0

    def __post_init__(self) -> None:
        for name in ("numerator", "denominator"):
            values = np.atleast_1d(np.array(getattr(self, name), dtype=float))
            object.__setattr__(self, name, values)
            _require_numbers(name, values, zero=False)
        if not (np.isfinite(self.rate_hz) and self.rate_hz > 0.0):
            raise _shape_error(
                "A digital filter needs the rate at its input.",
                "a positive number of samples per second",
                f"rate_hz = {self.rate_hz!r}",
                "state rate_hz",
            )
        leading = self.denominator[0]
        poles = np.roots(self.denominator) if leading != 0.0 else np.array([np.inf])
        if np.any(np.abs(poles) >= 1.0):
            raise _shape_error(
                "The digital filter is not stable.",
                "poles inside the unit circle, coefficients by ascending powers of 1/z",
                f"a pole of magnitude {np.max(np.abs(poles)):.6g}",
                "correct the denominator, or its order",
            )

    def at(self, frequency_hz: FloatArray) -> ComplexArray:
        """Return the response at frequencies, of their shape."""
        angle = 2.0 * np.pi * np.asarray(frequency_hz, dtype=float)
        back = np.exp(-1j * angle / self.rate_hz)
        top, bottom = (np.polyval(c[::-1], back) for c in (self.numerator, self.denominator))
        return np.asarray(top / bottom * np.exp(1j * angle * self.advance_s), dtype=complex)

    @property
    def top_hz(self) -> float:
        """Return the highest frequency at which it is known."""
        return 0.5 * self.rate_hz

    @property
    def time_poles(self) -> list[complex]:
        """Return the poles of its free motion in time, 1/s."""
        roots = np.roots(np.trim_zeros(self.denominator, "b"))
        return [complex(pole) for pole in self.rate_hz * np.log(roots.astype(complex))]


@dataclass(frozen=True, eq=False)
class Tabulated:
    """Cubic spline of log magnitude and phase over log frequency, linear outside.

    It is extrapolated by two octaves, so that a filter has no kink at the ends of the table.

    Attributes:
        frequency_hz: rising, shape (n,).
        magnitude: positive, shape (n,).
        phase_rad: lag negative, shape (n,); turns between neighbours below half a turn.

    Raises:
        InputError: the columns do not fit each other, or the frequencies do not rise.
    """

    frequency_hz: FloatArray
    magnitude: FloatArray
    phase_rad: FloatArray

    def __post_init__(self) -> None:
        for name in ("frequency_hz", "magnitude", "phase_rad"):
            values = np.atleast_1d(np.array(getattr(self, name), dtype=float))
            object.__setattr__(self, name, values)
            _require_numbers(name, values, zero=True)
        sizes = self.frequency_hz.shape, self.magnitude.shape, self.phase_rad.shape
        if len(set(sizes)) > 1:
            raise _shape_error(
                "The columns of the table differ in length.",
                "one magnitude and one phase for each frequency",
                " and ".join(str(size[0]) for size in sizes),
                "give every column the same number of rows",
            )
        if np.any(self.magnitude <= 0.0):
            raise _shape_error(
                "A magnitude is not positive.",
                "magnitudes above zero; a reversed polarity is 180° of phase",
                f"{np.min(self.magnitude):.6g}",
                "correct the table",
            )
        if self.frequency_hz[0] <= 0.0 or np.any(np.diff(self.frequency_hz) <= 0.0):
            raise _shape_error(
                "The frequencies of the table are out of order.",
                "frequencies above zero, each above the one before",
                ", ".join(f"{hz:g}" for hz in self.frequency_hz[:6]),
                "sort the rows, and remove repeated ones",
            )
        object.__setattr__(self, "phase_rad", np.unwrap(self.phase_rad))

    def at(self, frequency_hz: FloatArray) -> ComplexArray:
        """Return the response at frequencies, of their shape."""
        columns = np.stack([np.log(self.magnitude), self.phase_rad], axis=-1)
        log_frequency = np.log(frequency_hz)
        if self.frequency_hz.size == 1:
            logarithm = np.broadcast_to(columns[0], (*np.shape(log_frequency), 2))
        else:
            x = np.log(self.frequency_hz)
            spline = _spline(x, columns)
            inside = np.clip(log_frequency, x[0], x[-1])
            beyond = np.clip(log_frequency - inside, -MAX_EXTRAPOLATION, MAX_EXTRAPOLATION)
            logarithm = spline(inside) + beyond[..., None] * spline(inside, 1)
        return np.asarray(np.exp(logarithm[..., 0] + 1j * logarithm[..., 1]))

    @property
    def top_hz(self) -> float:
        """Return the highest frequency at which it is known."""
        return float(self.frequency_hz[-1])

    def between_points(self) -> ComplexArray:
        """Return the estimated error of log response between points, at the points, shape (n,).

        A fourth of the error, at every second point, of a spline through the others. The error of a
        cubic spline falls with the fourth power of the distance, to a sixteenth; less if the points
        are few for the shape. Zero for fewer than seven points.
        """
        error = np.zeros(self.frequency_hz.size, dtype=complex)
        if error.size < MIN_POINTS_FOR_ERROR:
            return error
        index = np.arange(error.size)
        for first in (0, 1):
            fitted = index[first::2]
            columns = (
                column[fitted] for column in (self.frequency_hz, self.magnitude, self.phase_rad)
            )
            coarse = Tabulated(*columns)
            omitted = np.setdiff1d(index[fitted[0] : fitted[-1]], fitted)
            true_response = self.magnitude[omitted] * np.exp(1j * self.phase_rad[omitted])
            error[omitted] = np.log(coarse.at(self.frequency_hz[omitted]) / true_response) / 4.0
        return error


Shape = RationalResponse | DigitalFilter | Tabulated


def _spline(x: FloatArray, columns: FloatArray) -> Any:
    from scipy.interpolate import CubicSpline  # slow to load

    return CubicSpline(x, columns, bc_type="not-a-knot" if x.size > 2 else "natural")


def _require_pairs(name: str, roots: ComplexArray) -> None:
    """Refuse roots that are not finite, and complex ones without their conjugates."""
    _require_numbers(name, np.abs(roots), zero=True)
    lone = np.sort_complex(roots) - np.sort_complex(roots.conj())
    if roots.size and np.max(np.abs(lone)) > 1e-6 * np.max(np.abs(roots)):
        raise _shape_error(
            f"The {name} are not those of a real channel.",
            f"complex {name} in conjugate pairs",
            ", ".join(f"{root:.6g}" for root in roots[:6]),
            "state both of each pair",
        )


def _require_numbers(name: str, values: Any, *, zero: bool) -> None:
    array = np.asarray(values, dtype=float)
    if not np.all(np.isfinite(array)) or (not zero and not np.any(array != 0.0)):
        raise _shape_error(
            f"The {name} of a known response cannot be used.",
            "finite numbers" if zero else "finite numbers, not all zero",
            ", ".join(f"{value:g}" for value in array[:6]) or "none",
            f"correct {name}",
        )


def _shape_error(problem: str, expected: str, value: str, remedy: str) -> InputError:
    return InputError(
        problem, expected=expected, found=value, where="known response", remedy=remedy
    )
