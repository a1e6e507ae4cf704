"""The residuals in the form the optimisers take: compiled functions of (z, args) with all that varies in args."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx

from vibrident.backend import jax, jnp
from vibrident.network.sensitivity import Normal
from vibrident.problem.frequency_domain import inverse_residual, response_residual
from vibrident.problem.time_domain import evaluate


class Local(NamedTuple):
    """A residual's cost, gradient Jᵀr (J = −∂r/∂z) and JᵀJ at a point."""

    matrix: Any
    gradient: Any
    cost: Any


def time_objective(z: Any, args: Any) -> Normal:
    """The network's residual over all records; args: coordinates, layout, data, noise."""
    return evaluate(z, *args)


@eqx.filter_jit
def response_objective(z: Any, args: Any) -> Local:
    """The complex responses' residual; args: coordinates, (polar, has_phase, quantity), data."""
    coordinates, (polar, has_phase, quantity), data = args
    return _local(lambda y: response_residual(y, coordinates, polar, has_phase, quantity, data), z)


@eqx.filter_jit
def inverse_objective(z: Any, args: Any) -> Local:
    """The paper's least squares on 1/H; args: coordinates, quantity, (f, H, weight)."""
    coordinates, quantity, data = args
    return _local(lambda y: _real(inverse_residual(y, coordinates, quantity, data)), z)


@eqx.filter_jit
def inverse_jacobian(z: Any, args: Any) -> Any:
    """Jacobian of the residual of ``inverse_objective``, shape (2 n, p)."""
    coordinates, quantity, data = args
    return jax.jacfwd(lambda y: _real(inverse_residual(y, coordinates, quantity, data)))(z)


def _real(residual: Any) -> Any:
    return jnp.concatenate([jnp.real(residual), jnp.imag(residual)])


def _local(residual: Callable[[Any], Any], z: Any) -> Local:
    value, jacobian = residual(z), jax.jacfwd(residual)(z)
    return Local(jacobian.T @ jacobian, -jacobian.T @ value, value @ value)
