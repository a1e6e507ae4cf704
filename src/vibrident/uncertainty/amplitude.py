"""Does the response depend on the amplitude? The score test of a cubic stiffness at the fundamentals.

A spring force with the term k3 V³ changes the response to a sine of response amplitude |V| by
ΔH/H = −(3/4) k3 |V|² H/S0 to first order (describing function; Nayfeh & Mook 1979, sec. 2.3). What of this the
parameters cannot imitate is looked for in the deviations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibrident.measure.response import ComplexArray
from vibrident.records import FloatArray
from vibrident.uncertainty.linearised import Linearised

SIGNIFICANT = 4.5  # the effect counts beyond this many standard deviations …
LEAST = 1e-3  # … above this relative size …
#: … where it leaves of χ² no more than this part of what it explains, or than noise does. A model that lacks something
#: else misses tones near a resonance, which are the large ones.
UNEXPLAINED = 0.1
OF_NOISE = 4.0  # … in standard deviations of χ²
#: The part of the effect's shape that the parameters cannot follow must be so many times, in squares, the part that
#: noise of the amplitudes makes. For a sensor that is flat over the tones only the latter is left.
CLEAR = 10.0


@dataclass(frozen=True)
class AmplitudeDependence:
    """An effect found."""

    largest: float  # its largest relative size at any tone
    sigma: float  # its size in standard deviations


def amplitude_dependence(
    linear: Linearised, model: ComplexArray, response: ComplexArray, relative_deviation: FloatArray
) -> AmplitudeDependence | None:
    """The effect, if it is significant.

    Args:
        linear: the tones, linearised at the estimate.
        model: the model's sensitivity at the tones, shape (n,).
        response: measured amplitudes, shape (n,).
        relative_deviation: of the measured sensitivity's real part, shape (n,).
    """
    count, parameters = len(model), linear.matrix.shape[1]
    if 2 * count < parameters + 4:
        return None
    effect = np.abs(response) ** 2 * model
    effect /= np.max(np.abs(effect))
    column = np.concatenate([(effect / relative_deviation).real, (effect / relative_deviation).imag])
    basis, _ = np.linalg.qr(linear.matrix)
    free = column - basis @ (basis.T @ column)
    rest = linear.rest - basis @ (basis.T @ linear.rest)
    power = float(free @ free)
    noise = 2.0 * np.abs(effect)  # of the column: |V|² is measured, and off by 2 σ of V
    if power <= CLEAR * float(noise @ noise):
        return None
    amount = float(free @ rest) / power
    explained = amount**2 * power
    sigma = np.sqrt(explained)
    freedom = 2.0 * count - parameters - 1.0
    noise_left = freedom + OF_NOISE * np.sqrt(2.0 * freedom)
    if sigma < SIGNIFICANT or abs(amount) < LEAST:
        return None
    if float(rest @ rest) - explained > max(UNEXPLAINED * explained, noise_left):
        return None
    return AmplitudeDependence(abs(amount), float(sigma))
