"""Normal equations of the unrolled network, for least squares over records of any length.

The derivative of the state obeys the network's own recursion, driven by the derivative of the weights
(forward sensitivity; the same numbers as forward-mode differentiation, tested against it):

    ∂x_{k+1} = Φ ∂x_k + ∂Φ x_k + ∂Γ c_k,    ∂y_k = C ∂x_k + ∂C x_k + ∂D c_k.

Each chunk runs from ∂x = 0; the contributions of the true ∂x at the start, of initial states and of offsets are added
with the free response C Φ^k, chunk by chunk.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

from vibrident.base.backend import jax, jnp, lax
from vibrident.physics.discretisation.weights import Weights
from vibrident.physics.network.unroll import (
    Lanes,
    Nuisance,
    Projection,
    dot,
    free_part,
    free_response,
    from_rest,
    imitable,
    nuisance_of,
    nuisance_response,
    per_lane,
    projection,
    start_states,
)


class Normal(NamedTuple):
    """Accumulated least-squares problem of P parameters, initial states and offsets projected out."""

    matrix: Any  # JᵀJ, shape (P, P), J = ∂(weighted response)/∂parameters
    gradient: Any  # Jᵀr, shape (P,), r the weighted residual measured − network
    cost: Any  # rᵀr
    squares: Any  # Σ r² of every segment, not weighted by the noise, shape (S,)
    response: Any  # the network's response with the best initial states and offsets, shape (L, M)
    columns: Any  # P columns of J, initial states and offsets projected out, each of shape (L, M)


def normal_equations(weights: Weights, slopes: Weights, lanes: Lanes, noise: Any, segments: int) -> Normal:
    """Normal equations at ``weights``.

    ``weights``: one set a sampling interval (leading axis R); ``slopes``: ∂weights/∂parameters, each with a trailing
    axis of P; ``noise``: standard deviation of the response noise, by lane, shape (M,).
    """
    known = _known(weights, lanes, segments)
    # Without their projections, shape (P, S, n + 1), on initial states and offset.
    p, proj = slopes.output.shape[-1], known.projection
    ends, in_chunk, response = _derivatives(weights, slopes, lanes, known.starts)
    response = response + known.nuisance.offset[lanes.segment]
    scale = lanes.weight / noise
    residual = (lanes.response - response) * scale
    # True derivative of the state at each chunk's start; zero at a segment's start, where it is a fixed nuisance.
    d_starts = _chain(per_lane(known.power, lanes.rate), ends, lanes.first)  # (P, n, M)
    columns = [
        (slope + free_part(proj.rows, lanes.rate, d)) * scale for slope, d in zip(in_chunk, d_starts, strict=True)
    ]
    matrix = jnp.stack(
        [jnp.stack([jnp.vdot(columns[max(a, b)], columns[min(a, b)]) for b in range(p)]) for a in range(p)]
    )
    gradient = jnp.stack([jnp.vdot(column, residual) for column in columns])
    # Projection on initial states and offset: moments of J against them, by segment; (P, S, n + 1).
    totals = jnp.stack([imitable(proj, lanes, column) for column in columns])
    squares = jax.ops.segment_sum(noise**2 * jnp.sum(residual**2, axis=0), lanes.segment, segments)
    matrix = matrix - jnp.einsum("psi,sij,qsj->pq", totals, proj.inverse, totals)
    freed = [
        column - lanes.weight * nuisance_response(proj, lanes, Nuisance(share[:, :-1], share[:, -1]))
        for column, share in zip(columns, jnp.einsum("sij,psj->psi", proj.inverse, totals), strict=True)
    ]
    return Normal(matrix, gradient, jnp.vdot(residual, residual), squares, response, freed)


class _Known(NamedTuple):
    """Estimated initial states and offsets, and the state at the start of every lane, (n, M)."""

    projection: Projection
    nuisance: Nuisance
    power: Any
    starts: Any


def _known(weights: Weights, lanes: Lanes, segments: int) -> _Known:
    n = weights.output.shape[-1]
    proj = projection(weights, lanes, segments)
    _, power = free_response(weights, lanes.response.shape[0])
    forced, ends = from_rest(weights, lanes)
    at_rest = start_states(power, ends, lanes, jnp.zeros((segments, n)))
    signal = (lanes.response - forced - free_part(proj.rows, lanes.rate, at_rest)) * lanes.weight
    nuisance = nuisance_of(proj, imitable(proj, lanes, signal))
    return _Known(proj, nuisance, power, start_states(power, ends, lanes, nuisance.state))


def contract(matrix: Any, vectors: Any) -> Any:
    """Σ_k matrix[i, k] vectors[…, k], written out over k; (n, K, M) and (…, K, M) → (…, n, M)."""
    terms = range(matrix.shape[1])
    return dot([matrix[:, k] for k in terms], [vectors[..., k, None, :] for k in terms])


def _derivatives(weights: Weights, slopes: Weights, lanes: Lanes, starts: Any) -> tuple[Any, Any, Any]:
    """Run every chunk from its true state with ∂x = 0.

    Returns:
        The end ∂x, shape (P, n, M); P times ∂y, each of shape (L, M); y itself, shape (L, M).
    """
    n, p = weights.output.shape[-1], slopes.output.shape[-1]
    phi, gamma, c, d = (per_lane(w, lanes.rate) for w in weights)
    # Slopes with the parameter first: (P, n, n), (P, n, q), (P, n), (P, q), each with the lane axis last.
    d_phi, d_gamma, d_c, d_d = (jnp.moveaxis(per_lane(w, lanes.rate), -2, 0) for w in slopes)

    def step(carry: Any, u: Any) -> tuple[Any, Any]:
        x, dx = carry
        y = dot(list(c), list(x)) + dot(list(d), list(u))
        dy = dot(list(c), [dx[:, i] for i in range(n)]) + over(d_c, x) + over(d_d, u)
        following = contract(phi, x) + contract(gamma, u)
        moved = contract(phi, dx) + over(d_phi, x) + over(d_gamma, u)
        return (following, moved), ([dy[a] for a in range(p)], y)

    (_, ends), (dy, y) = lax.scan(step, (starts, jnp.zeros((p, *starts.shape))), lanes.inputs)
    return ends, dy, y


def over(slopes: Any, values: Any) -> Any:
    """Σ_k slopes[…, k] values[k], written out over k; (…, K, M) and (K, M) → (…, M)."""
    return dot([slopes[..., k, :] for k in range(values.shape[0])], list(values))


def _chain(phi: Any, ends: Any, first: Any) -> Any:
    """∂x at the start of every chunk, shape (P, n, M), from the ends of chunks that began at zero."""
    p, n, count = ends.shape
    power = jnp.moveaxis(jnp.broadcast_to(phi, (n, n, count)), -1, 0)

    def step(carry: Any, lane: Any) -> tuple[Any, Any]:
        matrix, end, is_first = lane
        state = jnp.where(is_first, 0.0, carry)
        columns = [state[:, k, None] * matrix[None, :, k] for k in range(n)]
        return functools.reduce(jnp.add, columns) + end, state

    _, states = lax.scan(step, jnp.zeros((p, n)), (power, jnp.moveaxis(ends, -1, 0), first))
    return jnp.moveaxis(states, 0, -1)
