"""Poles and zeros for a delay and an average over a window, by Padé's approximants of e^{−x}.

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
    """Return the sensor as poles and zeros, with the approximations and their errors in words.

    Raises:
        InputError: the delay is negative, delay or window is too long for the band, or the model is
            not linear.
    """
    require_linear(sensor)
    system = poles_zeros(sensor)
    words = []
    if sensor.model.has_delay and sensor.delay_s != 0.0:
        late, remark = _approximate_delay(sensor)
        system = system.times(late)
        words.append(remark)
    for addon in sensor.model.add_ons:
        if addon.factor is None:
            continue
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
        order = _find_order(
            partial(_boxcar, length), partial(_average_response, length), sensor, addon.name, length
        )
        system = system.times(_boxcar(length, order))
        words.append(
            f"{addon.name} of {length!r} s: the last {order} poles and "
            f"{len(_boxcar(length, order).zeros)} zeros are its approximation of order {order} "
            "(Pade)"
        )
    if words:
        error = float(
            np.max(np.abs(system.response(sensor.band) / sensor.response(sensor.band) - 1.0))
        )
        words.append(f"largest deviation from the model over the band, relative: {error:.1e}")
        words.append("poles and zeros of an approximation are not valid outside the band")
    return system, words


def _approximate_delay(sensor: Exported) -> tuple[PolesZeros, str]:
    """Return the sensor's delay, in poles and zeros and in words."""
    delay = sensor.delay_s
    name = next(addon.name for addon in sensor.model.add_ons if addon.delay is not None)
    if delay < 0 and -delay <= K * sensor.delay_u_s:
        none = np.empty(0, complex)
        return PolesZeros(
            none, none, 1.0
        ), f"delay of {delay!r} s, which is zero within its U (k = 2): left out"
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
    order = _find_order(partial(_delay, delay), lambda s: np.exp(-s * delay), sensor, name, delay)
    return _delay(delay, order), (
        f"delay of {delay!r} s: {order} poles and {order} zeros, before those of an average, are "
        f"its all-pass approximation of order {order} (Pade)"
    )


def _average_response(length_s: float, s: np.ndarray) -> np.ndarray:
    return -np.expm1(-s * length_s) / (s * length_s)


def _find_order(
    make: Callable[[int], PolesZeros],
    exact: Callable[[np.ndarray], np.ndarray],
    sensor: Exported,
    what: str,
    seconds: float,
) -> int:
    s = 2j * np.pi * sensor.band
    for order in range(
        2, MAX_ORDER + 1, 2
    ):  # even, so that the delay's approximant is +1 far above the band
        if np.max(np.abs(make(order).response(sensor.band) / exact(s) - 1.0)) < 0.3 * TOLERANCE:
            return order
    raise InputError(
        f"The {what} is too long for poles and zeros over the band.",
        expected=f"an approximation of order {MAX_ORDER} at most, {TOLERANCE:g} off at most",
        found=f"{what} of {seconds!r} s, band up to {sensor.band_hz[1]:g} Hz",
        where="⟦export.form⟧",
        remedy=(
            f"give ⟦export.without = [{what!r}]⟧ (the file then states the error), or a narrower "
            "⟦export.band_hz⟧"
        ),
    )


def _coefficients(order: int) -> list[float]:
    """Return the coefficients of Q(x) = Σ c_j x^j, ascending, with e^{−x} ≈ Q(−x)/Q(x)."""
    n = order
    return [
        math.factorial(2 * n - j) / (math.factorial(n - j) * math.factorial(j)) * math.factorial(n)
        / math.factorial(2 * n)
        for j in range(n + 1)
    ]  # fmt: skip


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
