"""Normal equations of one problem, of tones or of lines, as functions that JAX compiles and maps over a batch.

They are those of :mod:`vibrident.problem`: the same residual and the same weights; the slopes are JAX's.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from vibrident.backend import jax, jnp
from vibrident.discretize import method
from vibrident.information import SMALLEST
from vibrident.lines import Trained
from vibrident.lines.transfer import transfer_of
from vibrident.models import SensorModel
from vibrident.problem import Coordinates, LineProblem
from vibrident.problem.frequency_domain import response_residual
from vibrident.records import FloatArray, Quantity

#: In place of a coordinate of zero, where |z| has no slope: the slope is then that of z.
_TINY = 1e-300


class Local(NamedTuple):
    """JᵀJ, Jᵀr with J = −∂r/∂z, and rᵀr."""

    matrix: Any
    gradient: Any
    cost: Any


Normal = Callable[[Any, Any], Local]


def tone_normal(model: SensorModel, polar: bool, has_phase: bool, quantity: Quantity) -> Normal:
    """Of measured responses: (z, (coordinates, data)) → Local."""

    def normal(z: Any, data: Any) -> Local:
        around, points = data
        coordinates = Coordinates(model, *around)

        def residual(z: Any) -> Any:
            return response_residual(z, coordinates, polar, has_phase, quantity, points)

        z = jnp.where(z == 0.0, _TINY, z)
        found, slopes = residual(z), jax.jacfwd(residual)(z)
        return Local(slopes.T @ slopes, -slopes.T @ found, found @ found)

    return normal


def line_data(problem: LineProblem, noise: FloatArray) -> tuple[Any, ...]:
    """The arrays of a problem of lines, a tuple for each of its batches."""
    found = []
    for batch, interval_s, fraction in problem.batches:
        level = noise[[problem.runs[number].record for number in batch.runs]]
        step = np.array([interval_s, fraction, problem.frame.delay_s])
        found.append(
            (batch.shifted()[0], batch.inputs, batch.response, np.sqrt(problem.counts(batch.samples)[0]), level, step)
        )
    return tuple(found)


def line_normal(model: SensorModel, method_name: str, terms: int, quantity: Quantity) -> Normal:
    """Of the lines of whole runs: (z, (coordinates, batches)) → Local; see :mod:`vibrident.lines.normal`."""
    trained = Trained(model, method(method_name), quantity, terms)

    def normal(z: Any, data: Any) -> Local:
        around, batches = data
        coordinates = Coordinates(model, *around)
        z = jnp.where(z == 0.0, _TINY, z)
        found = [_of_batch(trained, coordinates, z, batch) for batch in batches]
        return Local(*(sum(parts) for parts in zip(*found, strict=True)))

    return normal


def _of_batch(trained: Trained, coordinates: Coordinates, z: Any, batch: Any) -> Local:
    """The runs of a batch, each weighed by its noise, initial states taken out."""
    shifted, inputs, response, root, level, step = batch
    measured, runs = root * response, response.shape[0]

    def modelled(z: Any, states: Any) -> Any:
        return _modelled(trained, coordinates.physical(z), states, (shifted, inputs, root, step))

    none = jnp.zeros(trained.order)
    free = jax.jacfwd(lambda one: modelled(z, jnp.broadcast_to(one, (runs, trained.order))))(none)
    free = jnp.moveaxis(free, -1, 1)
    inverse = _inverse(_products(free, free))
    left = measured - modelled(z, jnp.zeros((runs, trained.order)))
    states = (inverse @ _products(free, left[:, None]))[..., 0]
    left = measured - modelled(z, states)
    slopes = jnp.moveaxis(jax.jacfwd(lambda moved: modelled(moved, states))(z), -1, 1)
    columns = jnp.concatenate([slopes, left[:, None]], axis=1)
    shared = _products(free, columns)
    freed = _products(columns, columns) - jnp.swapaxes(shared, -1, -2) @ inverse @ shared
    freed = jnp.sum(freed / level[:, None, None] ** 2, axis=0)
    return Local(freed[:-1, :-1], freed[:-1, -1], freed[-1, -1])


def _modelled(trained: Trained, values: Any, states: Any, at: Any) -> Any:
    """Weighted response of each run at its lines, with its n states, shape (R, n); the result (R, L) is complex."""
    shifted, inputs, root, step = at
    transfer = transfer_of(trained.weights(values, *step))
    denominator, numerator = transfer.denominator, transfer.numerator
    powers = shifted ** jnp.arange(denominator.size)[:, None]
    driven = jnp.einsum("kl,kq,rql->rl", powers, numerator, inputs)
    free = jnp.einsum("rk,kl->rl", states, powers[:-1]) * (1.0 + shifted)
    return root * (driven + free) / (denominator @ powers)


def _products(one: Any, other: Any) -> Any:
    """Re Σ one* other over lines: (R, i, L) and (R, j, L) → (R, i, j)."""
    return jnp.real(jnp.einsum("ril,rjl->rij", jnp.conj(one), other))


def _inverse(gram: Any) -> Any:
    """Inverse of scaled normal matrices, zero along directions that the data do not show."""
    diagonal = jnp.sqrt(jnp.maximum(jnp.diagonal(gram, axis1=-2, axis2=-1), np.finfo(float).tiny))
    values, vectors = jnp.linalg.eigh(gram / diagonal[..., :, None] / diagonal[..., None, :])
    kept = jnp.where(values > SMALLEST, 1.0 / jnp.maximum(values, SMALLEST), 0.0)
    inverse = jnp.einsum("rij,rj,rkj->rik", vectors, kept, vectors)
    return inverse / diagonal[..., :, None] / diagonal[..., None, :]
