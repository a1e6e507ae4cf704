"""The residuals in the form the optimisers take: pure functions of (z, args) with all that varies in args."""

from __future__ import annotations

from typing import Any

from vibrident.backend import jnp, lax
from vibrident.estimators.optimise import compressed
from vibrident.problem.frequency_domain import inverse_residual, response_residual
from vibrident.problem.time_domain import physical_normal


def time_objective(z: Any, args: Any) -> Any:
    """The network's residual over all records, compressed to p + 1 numbers; args: coordinates, layout, data, noise."""
    coordinates, layout, data, noise = args
    held = lax.stop_gradient(z)  # the normal equations carry the derivative themselves
    return compressed(physical_normal(held, coordinates, layout, data, noise), z)


def response_objective(z: Any, args: Any) -> Any:
    """The complex responses' residual; args: coordinates, (polar, has_phase, quantity), data."""
    coordinates, (polar, has_phase, quantity), data = args
    return response_residual(z, coordinates, polar, has_phase, quantity, data)


def inverse_objective(z: Any, args: Any) -> Any:
    """The paper's least squares on 1/H; args: coordinates, quantity, (f, H, weight)."""
    coordinates, quantity, data = args
    residual = inverse_residual(z, coordinates, quantity, data)
    return jnp.concatenate([jnp.real(residual), jnp.imag(residual)])
