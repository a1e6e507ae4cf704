"""The sensitivity curve with its uncertainty: magnitude and phase propagated from the parameters' covariance."""

from __future__ import annotations

from typing import Any

import equinox as eqx
import numpy as np

from vibrident.backend import jax, jnp
from vibrident.problem import Coordinates
from vibrident.records import FloatArray, Quantity
from vibrident.result import Curve

POINTS = 201


def frequencies(band_hz: tuple[float, float]) -> FloatArray:
    """Logarithmic grid over the band of the data; one point where the band is one frequency."""
    low, high = band_hz
    return np.geomspace(low, high, POINTS) if high > low else np.array([low])


def curve(
    coordinates: Coordinates, z: FloatArray, covariance: FloatArray, quantity: Quantity, frequency_hz: FloatArray
) -> Curve:
    """Curve of the model at ``frequency_hz``, shape (points,), with standard uncertainties."""
    log_magnitude, phase, slope_m, slope_p = (
        np.asarray(a) for a in _propagated(coordinates, jnp.asarray(z), quantity, jnp.asarray(frequency_hz))
    )
    magnitude = np.exp(log_magnitude)
    u_m = magnitude * np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", slope_m, covariance, slope_m), 0.0))
    u_p = np.sqrt(np.maximum(np.einsum("ni,ij,nj->n", slope_p, covariance, slope_p), 0.0))
    return Curve(
        tuple(frequency_hz.tolist()),
        tuple(magnitude.tolist()),
        tuple(np.rad2deg(phase).tolist()),
        tuple(u_m.tolist()),
        tuple(np.rad2deg(u_p).tolist()),
    )


@eqx.filter_jit
def _propagated(coordinates: Coordinates, z: Any, quantity: Quantity, frequency: Any) -> tuple[Any, ...]:
    def polar(y: Any) -> tuple[Any, Any]:
        response = coordinates.model.frequency_response(coordinates.physical(y), frequency, quantity)
        return jnp.log(jnp.abs(response)), jnp.angle(response)

    (log_magnitude, phase), slopes = polar(z), jax.jacfwd(polar)(z)
    return log_magnitude, phase, slopes[0], slopes[1]
