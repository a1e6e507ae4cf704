"""Normal equations of the unrolled network, for least squares over records of any length.

The derivative of the state obeys the network's own recursion, driven by the derivative of the
weights (forward sensitivity; the same numbers as forward-mode differentiation, tested against it):

    ∂x_{k+1} = Φ ∂x_k + ∂Φ x_k + ∂Γ c_k,    ∂y_k = C ∂x_k + ∂C x_k + ∂D c_k.

Each chunk runs from ∂x = 0; the contributions of the true ∂x at the start, of initial states and of
offsets are added with the free response C Φ^k, chunk by chunk.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from vibrident.base.backend import jax, jnp, lax
from vibrident.physics.discretisation.weights import Weights
from vibrident.physics.network.unroll import (
    Lanes,
    Nuisance,
    chain_states,
    nuisance_products,
    nuisance_response,
    per_lane,
    product,
    respond_freely,
    solve_starts,
)


class NormalEquations(NamedTuple):
    """Least-squares problem of P parameters, initial states and offsets projected out.

    J is ∂(weighted response)/∂parameters, r the weighted residual, measured − network.

    Attributes:
        matrix: JᵀJ, shape (P, P).
        gradient: Jᵀr, shape (P,).
        cost: rᵀr.
        squares: Σ r² of every segment, not weighted by the noise, shape (S,).
        response: the network's, with the best initial states and offsets, shape (L, M).
        columns: P columns of J, initial states and offsets projected out, each of shape (L, M).
    """

    matrix: Any
    gradient: Any
    cost: Any
    squares: Any
    response: Any
    columns: Any


def normal_equations(
    weights: Weights, slopes: Weights, lanes: Lanes, noise: Any, segments: int
) -> NormalEquations:
    """Return the normal equations of the network at its weights.

    Args:
        weights: one set a sampling interval (leading axis R).
        slopes: ∂weights/∂parameters, each with a trailing axis of P.
        lanes: the records.
        noise: standard deviation of the response noise, by lane, shape (M,).
        segments: S.
    """
    p = slopes.output.shape[-1]
    proj, nuisance, starts = solve_starts(weights, lanes, segments)
    ends, in_chunk, response = _derivatives(weights, slopes, lanes, starts)
    response = response + nuisance.offset[lanes.segment]
    scale = lanes.weight / noise
    residual = (lanes.response - response) * scale
    # True derivative of the state at each chunk's start; zero at a segment's start, where it is a
    # fixed nuisance.
    d_starts = jnp.moveaxis(chain_states(proj.power, ends, lanes.first, 0.0), 1, 0)
    columns = [
        (slope + respond_freely(proj.rows, lanes.rate, d)) * scale
        for slope, d in zip(in_chunk, d_starts, strict=True)
    ]
    matrix = jnp.stack(
        [
            jnp.stack([jnp.vdot(columns[max(a, b)], columns[min(a, b)]) for b in range(p)])
            for a in range(p)
        ]
    )
    gradient = jnp.stack([jnp.vdot(column, residual) for column in columns])
    # Projection on initial states and offset: moments of J against them, by segment; (P, S, n + 1).
    totals = jnp.stack([nuisance_products(proj, lanes, column) for column in columns])
    squares = jax.ops.segment_sum(noise**2 * jnp.sum(residual**2, axis=0), lanes.segment, segments)
    matrix = matrix - jnp.einsum("psi,sij,qsj->pq", totals, proj.inverse, totals)
    shares = jnp.einsum("sij,psj->psi", proj.inverse, totals)
    freed = [
        column
        - lanes.weight * nuisance_response(proj, lanes, Nuisance(share[:, :-1], share[:, -1]))
        for column, share in zip(columns, shares, strict=True)
    ]
    return NormalEquations(matrix, gradient, jnp.vdot(residual, residual), squares, response, freed)


def _derivatives(
    weights: Weights, slopes: Weights, lanes: Lanes, starts: Any
) -> tuple[Any, Any, Any]:
    """Run every chunk from its true state with ∂x = 0.

    Returns:
        ∂x at the chunks' ends, shape (n, P, M); P times ∂y, each of shape (L, M); y, shape (L, M).
    """
    phi, gamma, c, d = (per_lane(w, lanes.rate) for w in weights)
    # The axis of P goes before the one that is summed over: (n, P, n), (n, P, q), (P, n), (P, q),
    # each followed by the lanes.
    d_phi, d_gamma, d_c, d_d = (jnp.moveaxis(per_lane(w, lanes.rate), -2, -3) for w in slopes)

    def step(carry: Any, u: Any) -> tuple[Any, Any]:
        x, dx = carry
        y = product(c, x) + product(d, u)
        dy = product(c, dx) + product(d_c, x) + product(d_d, u)
        following = product(phi, x) + product(gamma, u)
        moved = product(phi[:, None], dx) + product(d_phi, x) + product(d_gamma, u)
        return (following, moved), (list(dy), y)

    at_rest = jnp.zeros((starts.shape[0], slopes.output.shape[-1], starts.shape[1]))
    (_, ends), (dy, y) = lax.scan(step, (starts, at_rest), lanes.inputs)
    return ends, dy, y
