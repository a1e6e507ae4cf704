"""Normal equations of the unrolled network, for least squares over records of any length.

The derivative of the state obeys the network's own recursion, driven by the derivative of the weights
(forward sensitivity; the same numbers as forward-mode differentiation of :func:`respond`, tested against it):

    ∂x_{k+1} = Φ ∂x_k + ∂Φ x_k + ∂Γ c_k,    ∂y_k = C ∂x_k + ∂C x_k + ∂D c_k.

Each chunk runs from ∂x = 0; what its true ∂x at the start adds, and what initial states and offsets could imitate,
is put in with the free response C Φ^k, chunk by chunk.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

from vibrident.backend import jax, jnp, lax
from vibrident.discretize.weights import Weights
from vibrident.network.blocks import over_blocks, step_inputs
from vibrident.network.unroll import (
    Lanes,
    Nuisance,
    Projection,
    chained,
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
    """Accumulated least-squares problem of P parameters, initial states and offsets taken out.

    Attributes:
        matrix: JᵀJ, shape (P, P), J = ∂(weighted response)/∂parameters.
        gradient: Jᵀr, shape (P,), r the weighted residual measured − network.
        cost: rᵀr.
        squares: Σ r² of every segment, not weighted by the noise, shape (S,).
        response: the network's response with the best initial states and offsets, shape (L, M).
        columns: P columns of J, what initial states and offsets could imitate taken out, each of shape (L, M).
            Empty where the lanes were taken in blocks; :func:`jacobian_column` then makes one.
    """

    matrix: Any
    gradient: Any
    cost: Any
    squares: Any
    response: Any
    columns: Any


def normal_equations(
    weights: Weights, slopes: Weights, lanes: Lanes, noise: Any, segments: int, blocks: int = 1
) -> Normal:
    """Normal equations at ``weights``.

    Args:
        weights: one set a sampling interval (leading axis R).
        slopes: ∂weights/∂parameters, each with a trailing axis of P.
        lanes: the data.
        noise: standard deviation of the response noise, by lane, shape (M,).
        segments: number of segments.
        blocks: the lanes are taken in so many blocks, a divisor of M. With more than one, no columns are kept.
    """
    known = _known(weights, lanes, segments, blocks)
    return _normal(weights, slopes, lanes, noise, known, blocks, kept=blocks == 1)


def jacobian_column(weights: Weights, slopes: Weights, lanes: Lanes, noise: Any, segments: int, blocks: int) -> Any:
    """Column of J of one parameter, shape (L, M); arguments as of :func:`normal_equations`, P = 1."""
    known = _known(weights, lanes, segments, blocks)
    return _normal(weights, slopes, lanes, noise, known, blocks, kept=True).columns[0]


class _Known(NamedTuple):
    """What the data say of initial states and offsets, and with it the state at the start of every lane, (n, M)."""

    projection: Projection
    nuisance: Nuisance
    power: Any
    starts: Any


def _known(weights: Weights, lanes: Lanes, segments: int, blocks: int) -> _Known:
    n = weights.output.shape[-1]
    proj = projection(weights, lanes, segments, blocks)
    _, power = free_response(weights, lanes.response.shape[0])
    rest = jnp.zeros((segments, n))

    def step(carry: Any, lanes: Lanes, others: Any) -> tuple[Any, Any]:
        before, moments = carry
        forced, ends = from_rest(weights, lanes)
        at_rest, after = chained(power, ends, lanes, rest, before)
        signal = (lanes.response - forced - free_part(proj.rows, lanes.rate, at_rest)) * lanes.weight
        return (after, moments + imitable(proj._replace(carry=others), lanes, signal)), ends

    start = (jnp.zeros(n), jnp.zeros((segments, n + 1)))
    (_, moments), ends = over_blocks(step, start, lanes, proj.carry, blocks)
    nuisance = nuisance_of(proj, moments)
    return _Known(proj, nuisance, power, start_states(power, ends, lanes, nuisance.state))


def _normal(
    weights: Weights, slopes: Weights, lanes: Lanes, noise: Any, known: _Known, blocks: int, *, kept: bool
) -> Normal:
    """The normal equations from what is known, with or without the columns."""
    n, p = weights.output.shape[-1], slopes.output.shape[-1]
    proj, segments = known.projection, known.projection.inverse.shape[0]

    def step(carry: Any, lanes: Lanes, others: Any) -> tuple[Any, Any]:
        before, sums = carry
        starts, noise, its_carry = others
        ends, in_chunk, response = _derivatives(weights, slopes, lanes, starts)
        response = response + known.nuisance.offset[lanes.segment]
        scale = lanes.weight / noise
        residual = (lanes.response - response) * scale
        # True derivative of the state at each chunk's start; zero at a segment's start, where it is a nuisance held.
        d_starts, after = _chain(per_lane(known.power, lanes.rate), ends, lanes.first, before)  # (P, n, M)
        columns = [
            (slope + free_part(proj.rows, lanes.rate, d)) * scale for slope, d in zip(in_chunk, d_starts, strict=True)
        ]
        matrix = jnp.stack(
            [jnp.stack([jnp.vdot(columns[max(a, b)], columns[min(a, b)]) for b in range(p)]) for a in range(p)]
        )
        found = (
            matrix,
            jnp.stack([jnp.vdot(column, residual) for column in columns]),
            jnp.vdot(residual, residual),
            # What initial states and offset could imitate: moments of J against them, by segment; (P, S, n + 1).
            jnp.stack([imitable(proj._replace(carry=its_carry), lanes, column) for column in columns]),
            jax.ops.segment_sum(noise**2 * jnp.sum(residual**2, axis=0), lanes.segment, segments),
        )
        return (after, jax.tree.map(jnp.add, sums, found)), (response, columns if kept else [])

    nothing = (jnp.zeros((p, p)), jnp.zeros(p), jnp.zeros(()), jnp.zeros((p, segments, n + 1)), jnp.zeros(segments))
    others = (known.starts, noise, proj.carry)
    (_, sums), (response, columns) = over_blocks(step, (jnp.zeros((p, n)), nothing), lanes, others, blocks)
    matrix, gradient, cost, totals, squares = sums
    matrix = matrix - jnp.einsum("psi,sij,qsj->pq", totals, proj.inverse, totals)
    if kept:
        columns = _freed(columns, jnp.einsum("sij,psj->psi", proj.inverse, totals), lanes, proj, blocks)
    return Normal(matrix, gradient, cost, squares, response, columns)


def _freed(columns: Any, shares: Any, lanes: Lanes, proj: Projection, blocks: int) -> Any:
    """The columns without their shares, shape (P, S, n + 1), of what initial states and offset could imitate."""

    def step(nothing: Any, lanes: Lanes, others: Any) -> tuple[Any, Any]:
        columns, carry = others
        here = proj._replace(carry=carry)
        return nothing, [
            column - lanes.weight * nuisance_response(here, lanes, Nuisance(share[:, :-1], share[:, -1]))
            for column, share in zip(columns, shares, strict=True)
        ]

    return over_blocks(step, (), lanes, (columns, proj.carry), blocks)[1]


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

    (_, ends), (dy, y) = lax.scan(step, (starts, jnp.zeros((p, *starts.shape))), step_inputs(lanes.inputs))
    return ends, dy, y


def over(slopes: Any, values: Any) -> Any:
    """Σ_k slopes[…, k] values[k], written out over k; (…, K, M) and (K, M) → (…, M)."""
    return dot([slopes[..., k, :] for k in range(values.shape[0])], list(values))


def _chain(phi: Any, ends: Any, first: Any, before: Any) -> tuple[Any, Any]:
    """∂x at the start of every chunk, shape (P, n, M), from the ends of chunks that began at zero.

    With it the one behind the last chunk; ``before`` is the one behind the chunk before the first, shape (P, n).
    """
    _, n, count = ends.shape
    power = jnp.moveaxis(jnp.broadcast_to(phi, (n, n, count)), -1, 0)

    def step(carry: Any, lane: Any) -> tuple[Any, Any]:
        matrix, end, is_first = lane
        state = jnp.where(is_first, 0.0, carry)
        columns = [state[:, k, None] * matrix[None, :, k] for k in range(n)]
        return functools.reduce(jnp.add, columns) + end, state

    after, states = lax.scan(step, before, (power, jnp.moveaxis(ends, -1, 0), first))
    return jnp.moveaxis(states, 0, -1), after
