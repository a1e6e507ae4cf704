"""Readback: sensor parameters from the weights of a network that was trained freely."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.special import spherical_jn

from vibrident.base.errors import ModelError
from vibrident.physics.discretisation import Weights
from vibrident.physics.models import SensorModel

Reading = Literal["eigenvalues", "elements"]


def network_response(
    weights: Weights, frequency_hz: NDArray, sampling_interval_s: float, method: str
) -> NDArray:
    """Return the network's own sensitivity curve: its steady state under tones, shape (points,).

    Args:
        weights: one set (no leading axis).
        frequency_hz: shape (points,), below half the sampling rate.
        sampling_interval_s: Ts.
        method: name of the discretisation, which defines the inputs for a tone.
    """
    phi, gamma, c, d = (np.asarray(w, dtype=float) for w in weights)
    inputs = _tone_inputs(
        2 * np.pi * np.asarray(frequency_hz) * sampling_interval_s, gamma.shape[1], method
    )
    z = np.exp(2j * np.pi * np.asarray(frequency_hz) * sampling_interval_s)
    states = np.linalg.solve(
        z[:, None, None] * np.eye(len(c)) - phi, (inputs @ gamma.T)[..., None]
    )[..., 0]
    return states @ c + inputs @ d


def _tone_inputs(angle: NDArray, terms: int, method: str) -> NDArray:
    """Return the inputs for e^{jωt}, which is 1 at the step's start, shape (points, terms).

    ``angle``: ω Ts, shape (points,).
    """
    z = np.exp(1j * angle)
    if method in ("euler", "zoh"):
        return np.ones((len(angle), 1), dtype=complex)
    if method in ("foh", "tustin"):
        return np.stack([0.5 * (z + 1), 0.5 * (z - 1)], axis=1)
    order = np.arange(terms)
    return (
        (2 * order + 1)
        * 1j**order
        * spherical_jn(order, angle[:, None] / 2)
        * np.exp(0.5j * angle)[:, None]
    )


def physics_from_weights(
    weights: Weights,
    sampling_interval_s: float,
    model: SensorModel,
    method: str,
    reading: Reading = "eigenvalues",
) -> dict[str, float]:
    """Return the sensor parameters that the weights of a second-order network stand for.

    Args:
        weights: one set, in any coordinates of its hidden states; the ``elements`` reading takes
            them as the paper's V and V̇.
        sampling_interval_s: Ts.
        model: the sensor model; only its core is read.
        method: name of the discretisation.
        reading: ``eigenvalues``: poles from the eigenvalues of W3 and the gain from the network's
            response, whatever the coordinates. ``elements``: the paper's, entry by entry of Euler's
            W1 and W3 (eq. 7).

    Raises:
        ModelError: the network has not two states, or its eigenvalues are not those of an
            oscillator.
    """
    phi = np.asarray(weights.transition, dtype=float)
    if phi.shape != (2, 2) or model.core.oscillator is None:
        raise ModelError(
            "Only a network with two hidden states can be read back as one oscillator.",
            expected="W3 of shape (2, 2)",
            found=f"shape {phi.shape}",
            where="network weights",
            remedy="train the tied network for larger models",
        )
    gain_name = model.gain_name
    frequency_name, damping_name = model.core.oscillator
    if reading == "elements":
        wn = np.sqrt(-phi[1, 0] / sampling_interval_s)
        damping = (1.0 - phi[1, 1]) / (2.0 * wn * sampling_interval_s)
        gain = float(np.asarray(weights.drive)[1, 0]) / sampling_interval_s
        gain = gain / wn**2 if model.core.output == "displacement" else gain
    else:
        poles = _continuous(np.linalg.eigvals(phi).astype(complex), sampling_interval_s, method)
        product = np.real(poles[0] * poles[1])
        pair = abs(np.imag(poles.sum())) <= 1e-9 * float(np.max(np.abs(poles)))
        if not (np.isfinite(product) and product > 0 and pair and np.all(np.real(poles) < 0)):
            raise ModelError(
                "The weights are not those of a stable oscillator.",
                expected="eigenvalues of W3 inside the unit circle, "
                "as a conjugate or a positive real pair",
                found=f"eigenvalues {np.linalg.eigvals(phi)}",
                where="network weights",
                remedy="train longer, or use the tied network",
            )
        wn = np.sqrt(product)
        damping = float(-np.real(poles.sum()) / (2.0 * wn))
        # An accelerometer's gain is read at zero frequency; a velocity pickup's, which has no
        # response there, at ωn.
        at = np.array([0.0 if model.core.output == "displacement" else wn / (2 * np.pi)])
        unit = dict.fromkeys(model.parameter_names, 0.0) | {
            gain_name: 1.0,
            frequency_name: wn / (2 * np.pi),
            damping_name: damping,
        }
        response = network_response(weights, at, sampling_interval_s, method)
        gain = float(np.real(response / model.frequency_response(unit, at + 0j))[0])
    return {
        gain_name: float(gain),
        frequency_name: float(wn / (2 * np.pi)),
        damping_name: float(damping),
    }


def _continuous(z: NDArray, ts: float, method: str) -> NDArray:
    """Return the poles of the continuous system whose discretisation has the eigenvalues z."""
    if method == "euler":
        return (z - 1.0) / ts
    if method == "tustin":
        return 2.0 / ts * (z - 1.0) / (z + 1.0)
    return np.log(z) / ts
