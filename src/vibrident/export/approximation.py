"""Approximate a delay and an average over a window by poles and zeros (Padé's e^{−x}).

The [n/n] approximant Q(−x)/Q(x) is all-pass, and n is raised until the tolerance is met over the
band. The window's (1 − e^{−x})/x follows from the same Q: (Q(x) − Q(−x))/(x Q(x)), whose numerator
is divisible by x.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np

from vibrident.base.errors import InputError
from vibrident.export.poles_zeros import PolesZeros, paired, poles_zeros
from vibrident.export.sensor import Exported, require_linear
from vibrident.physics.models.base import AddOn
from vibrident.result.sensor import IdentifiedSensor
from vibrident.show.views import K

TOLERANCE = 1e-10  # largest relative error of an approximation over the band
MAX_ORDER = 12


def system(identified: IdentifiedSensor) -> PolesZeros:
    """Return a sensor as poles and zeros in rad/s; delay and window are approximated in its band.

    Raises:
        InputError: the model is not linear, or poles and zeros cannot hold it.
    """
    return approximate(Exported(identified, identified.model, identified.band_hz or (0.0, 0.0)))[0]


def approximate(sensor: Exported) -> tuple[PolesZeros, list[str]]:
    """Return the sensor as poles and zeros, and remarks on its approximations and their errors.

    Raises:
        InputError: the delay is negative, delay or window is too long for the band, or the model is
            not linear.
    """
    require_linear(sensor)
    system = poles_zeros(sensor)
    factors = []
    if sensor.model.has_delay and sensor.delay_s != 0.0:
        factors.append(_approximate_delay(sensor))
    for addon in sensor.model.add_ons:
        if addon.factor is not None:
            factors.append(_approximate_window(sensor, addon))
    if not factors:
        return system, []
    for factor, _ in factors:
        system = system.times(factor)
    remarks = [remark for _, remark in factors]
    error = np.max(np.abs(system.response(sensor.band) / sensor.response(sensor.band) - 1.0))
    remarks += [
        f"largest deviation from the model over the band, relative: {error:.1e}",
        "poles and zeros of an approximation are not valid outside the band",
    ]
    return system, remarks


def _approximate_delay(sensor: Exported) -> tuple[PolesZeros, str]:
    """Return the sensor's delay as poles and zeros, and a remark on it."""
    delay = sensor.delay_s
    name = next(addon.name for addon in sensor.model.add_ons if addon.delay is not None)
    if delay < 0 and -delay <= K * sensor.delay_u_s:
        empty = np.empty(0, complex)
        remark = f"delay of {delay!r} s, which is zero within its U (k = 2): left out"
        return PolesZeros(empty, empty, 1.0), remark
    if delay < 0:
        raise InputError(
            (
                "The response is ahead of the reference, which stable poles and zeros cannot "
                "represent."
            ),
            expected="a delay of 0 or above",
            found=f"delay = {delay!r} s",
            where="result.json, parameters",
            remedy=f"identify without {name}, or give the export ⟦export.without = [{name!r}]⟧: "
            "the file then states the error",
        )
    approximant = _find_approximant(
        partial(_delay, delay), lambda s: np.exp(-s * delay), sensor, name, delay
    )
    order = len(approximant.poles)
    return approximant, (
        f"delay of {delay!r} s: {order} poles and {order} zeros, before those of an average, are "
        f"its all-pass approximation of order {order} (Pade)"
    )


def _approximate_window(sensor: Exported, addon: AddOn) -> tuple[PolesZeros, str]:
    """Return an average over a window as poles and zeros, and a remark on it."""
    if not addon.window:
        raise InputError(
            f"Poles and zeros cannot hold {addon.name!r}.",
            expected="add-ons that are ratios of polynomials, delays or averages",
            found=f"{addon.name}: {addon.title}",
            where="⟦export.form⟧",
            remedy=(
                f"give ⟦export.without = [{addon.name!r}]⟧: the file then states the error "
                "over the band"
            ),
        )
    length = float(sensor.values[addon.window])
    approximant = _find_approximant(
        partial(_boxcar, length),
        lambda s: -np.expm1(-s * length) / (s * length),
        sensor,
        addon.name,
        length,
    )
    order = len(approximant.poles)
    return approximant, (
        f"{addon.name} of {length!r} s: the last {order} poles and {len(approximant.zeros)} zeros "
        f"are its approximation of order {order} (Pade)"
    )


def _find_approximant(
    make: Callable[[int], PolesZeros],
    exact: Callable[[np.ndarray], np.ndarray],
    sensor: Exported,
    name: str,
    seconds: float,
) -> PolesZeros:
    """Return the approximant of least order within the tolerance over the sensor's band.

    Args:
        make: order → approximant with as many poles.
        exact: s → response to be approximated.
        sensor: that is exported.
        name: of the add-on.
        seconds: delay or length of the window.

    Raises:
        InputError: the order would be too high.
    """
    exact_response = exact(2j * np.pi * sensor.band)
    # even orders: the delay's approximant is then +1 far above the band
    for order in range(2, MAX_ORDER + 1, 2):
        approximant = make(order)
        error = np.max(np.abs(approximant.response(sensor.band) / exact_response - 1.0))
        if error < 0.3 * TOLERANCE:
            return approximant
    raise InputError(
        f"The {name} is too long for poles and zeros over the band.",
        expected=f"an approximation of order {MAX_ORDER} at most, {TOLERANCE:g} off at most",
        found=f"{name} of {seconds!r} s, band up to {sensor.band_hz[1]:g} Hz",
        where="⟦export.form⟧",
        remedy=(
            f"give ⟦export.without = [{name!r}]⟧ (the file then states the error), or a narrower "
            "⟦export.band_hz⟧"
        ),
    )


def _coefficients(order: int) -> list[float]:
    """Return the coefficients of Q(x) = Σ c_j x^j, ascending, with e^{−x} ≈ Q(−x)/Q(x)."""
    n = order
    factorial = math.factorial
    return [
        factorial(2 * n - j) / (factorial(n - j) * factorial(j)) * factorial(n) / factorial(2 * n)
        for j in range(n + 1)
    ]


def _delay(delay_s: float, order: int) -> PolesZeros:
    poles = paired(np.roots(_coefficients(order)[::-1])) / delay_s
    return PolesZeros(-poles, poles, (-1.0) ** order)


def _boxcar(length_s: float, order: int) -> PolesZeros:
    q = _coefficients(order)
    poles = paired(np.roots(q[::-1]))
    odd = [2.0 * c for c in q[1::2]]  # (Q(x) − Q(−x))/x, a polynomial in x²
    zeros = np.ravel([[1j * np.sqrt(-v), -1j * np.sqrt(-v)] for v in np.roots(odd[::-1]).real])
    gain = odd[-1] / q[-1]
    excess = len(poles) - len(zeros)
    return PolesZeros(
        np.asarray(zeros, complex) / length_s, poles / length_s, gain / length_s**excess
    )
