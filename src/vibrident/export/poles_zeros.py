"""Sensor as poles, zeros and gain: H(s) = k ∏(s − z)/∏(s − p), in rad/s.

Each add-on has its own factor of the denominator, of second order at most, so the poles come from
quadratics and are exact to rounding at any distance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.errors import InputError
from vibrident.data.records import FloatArray
from vibrident.export.sensor import Exported
from vibrident.physics.models import Rational


@dataclass(frozen=True, eq=False)
class PolesZeros:
    """Transfer function k ∏(s − z)/∏(s − p)."""

    zeros: np.ndarray  # rad/s, complex, conjugates side by side
    poles: np.ndarray  # rad/s, complex, conjugates side by side
    gain: float  # k

    def response(self, frequency_hz: FloatArray) -> np.ndarray:
        """Return the value at s = j 2π f.

        Zeros and poles alternate, so that no product overflows.
        """
        s = 2j * np.pi * np.asarray(frequency_hz, float)
        value = np.full(s.shape, complex(self.gain))
        for index in range(max(len(self.zeros), len(self.poles))):
            if index < len(self.zeros):
                value = value * (s - self.zeros[index])
            if index < len(self.poles):
                value = value / (s - self.poles[index])
        return value

    def times(self, factor: PolesZeros) -> PolesZeros:
        """Return this transfer function in series with another."""
        zeros = np.concatenate([self.zeros, factor.zeros])
        poles = np.concatenate([self.poles, factor.poles])
        return PolesZeros(zeros, poles, self.gain * factor.gain)

    def polynomials(self) -> tuple[np.ndarray, np.ndarray]:
        """Return numerator and denominator, real, descending powers of s."""
        return self.gain * np.atleast_1d(np.poly(self.zeros).real), np.atleast_1d(
            np.poly(self.poles).real
        )


def poles_zeros(sensor: Exported) -> PolesZeros:
    """Return the rational part of the sensor: without delay and boxcar.

    Raises:
        InputError: the core is no ratio of polynomials.
    """
    model = sensor.model
    values = sensor.values
    if model.core.factor is not None:
        raise InputError(
            f"Poles and zeros cannot hold the model {model.core.name!r}.",
            expected="a response that is a ratio of polynomials in s",
            found="another function of frequency",
            where="⟦export.form⟧",
            remedy="export the curve: csv, or correct and predict by the sensor itself",
        )
    system = model.rational(values, sensor.quantity)
    unit = Rational(1.0, (1.0,), (1.0,), system.angular_scale)
    rational_add_ons = [addon for addon in model.add_ons if addon.rational is not None]
    core = model.core.rational(values)
    factors = []
    for addon in rational_add_ons:
        if addon.moves_poles and addon.rational is not None:
            core = addon.rational(values, core)
        elif addon.rational is not None:
            factors.append(addon.rational(values, unit).denominator)
    factors.insert(0, core.denominator)
    poles = np.concatenate([roots(np.array(factor, float)) for factor in factors])
    numerator = np.trim_zeros(np.array(system.numerator, float), "b")
    return PolesZeros(roots(numerator), poles, float(system.gain) * float(numerator[-1]))


def roots(ascending: np.ndarray) -> np.ndarray:
    """Return the roots of a real polynomial, coefficients ascending.

    Zeros are exact, and quadratics have no cancellation.
    """
    at_zero = int(np.flatnonzero(ascending)[0])
    c = ascending[at_zero:] / ascending[-1]
    if len(c) == 1:
        nonzero = np.empty(0, complex)
    elif len(c) == 2:
        nonzero = np.array([-c[0]], complex)
    elif len(c) == 3:
        nonzero = _quadratic(c[1], c[0])
    else:
        nonzero = _polished(c)
    return np.concatenate([np.zeros(at_zero, complex), nonzero])


def _quadratic(b: float, c: float) -> np.ndarray:
    """Return the roots of x² + b x + c."""
    discriminant = 0.25 * b * b - c
    if discriminant < 0:
        root = complex(-0.5 * b, np.sqrt(-discriminant))
        return np.array([root, root.conjugate()])
    far = -0.5 * b - np.copysign(np.sqrt(discriminant), b)
    return np.array([far, c / far if far else 0.0], complex)


def _polished(c: np.ndarray) -> np.ndarray:
    """Return companion roots in a variable of the roots' size, refined by Newton's steps."""
    scale = float(np.abs(c[0])) ** (1.0 / (len(c) - 1))
    descending = (c * scale ** (np.arange(len(c)) - (len(c) - 1.0)))[::-1]
    estimates = np.roots(descending)
    slope = np.polyder(descending)
    for _ in range(3):
        step = np.polyval(descending, estimates) / np.polyval(slope, estimates)
        estimates = estimates - np.where(
            np.isfinite(step) & (np.abs(step) < 1e-3 * np.abs(estimates)), step, 0.0
        )
    return scale * paired(estimates)


def paired(all_roots: np.ndarray) -> np.ndarray:
    """Return real roots, then conjugates side by side, their imaginary parts exactly opposite."""
    upper = all_roots[np.imag(all_roots) > 1e-12 * np.abs(all_roots)]
    real = np.real(all_roots[np.abs(np.imag(all_roots)) <= 1e-12 * np.abs(all_roots)]).astype(
        complex
    )
    return np.concatenate([real, np.ravel(np.stack([upper, upper.conj()], axis=1))])


def uncertainties(sensor: Exported, kind: str) -> np.ndarray | None:
    """Return the standard uncertainties of the parts of ``poles`` or ``zeros``, as a complex array.

    They follow from the parameters' uncertainties and correlation, to first order; None if one is
    not stated.
    """
    identified = sensor.identified
    if not np.isfinite(identified.covariance).all():
        return None
    base = getattr(poles_zeros(sensor), kind)
    slopes = []
    for name in identified.model.parameter_names:
        step = 1e-6 * abs(identified.values[name]) or 1e-9
        moved = [
            {**identified.values, name: identified.values[name] + sign * step}
            for sign in (-1.0, 1.0)
        ]
        near = [replace(sensor, identified=replace(identified, values=values)) for values in moved]
        low, high = (getattr(poles_zeros(sensor_near), kind) for sensor_near in near)
        slopes.append(
            (high - low) / (2 * step) if len(low) == len(high) == len(base) else np.zeros(len(base))
        )
    slope: np.ndarray = np.stack(slopes, axis=1)  # (roots, parameters)
    real, imag = (
        np.sqrt(
            np.maximum(np.einsum("ri,ij,rj->r", component, identified.covariance, component), 0.0)
        )
        for component in (np.real(slope), np.imag(slope))
    )
    return real + 1j * imag
