"""The unrolled network over many records at once, in parallel chunks.

A recursion over millions of samples is sequential, but a linear one splits: cut each record into
chunks of a few hundred steps, run all chunks side by side from a zero state, then pass the state
from chunk to chunk (x' = Φ^L x + end of chunk) and add each chunk's free response C Φ^k x. The
result equals the recursion's to rounding, at the speed of a vector loop. Every operation is
elementwise across chunks; no small matrix products inside the loop.

The unknown initial state of each record and the offset of its response enter linearly, so they are
solved for exactly (variable projection; Golub & Pereyra 1973).
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

from vibrident.base.backend import jax, jnp, lax
from vibrident.physics.discretisation.weights import Weights


class Lanes(NamedTuple):
    """Records cut into M chunks of L steps, the lanes; R sets of weights, S segments.

    A segment is an unbroken run of steps with a state of its own: a whole record, or a part between
    gaps.

    Attributes:
        inputs: shape (L, q, M).
        response: zero where ``weight`` is zero, shape (L, M).
        weight: one where the sample counts, zero where not, shape (L, M).
        first: whether the lane is the first of its segment, shape (M,).
        segment: number of the segment, shape (M,), int.
        rate: number of the sampling interval, shape (M,), int.
    """

    inputs: Any
    response: Any
    weight: Any
    first: Any
    segment: Any
    rate: Any


class Nuisance(NamedTuple):
    """Nuisance parameters of the segments, eliminated from every fit.

    Attributes:
        state: initial state, shape (S, n).
        offset: of the response, shape (S,).
    """

    state: Any
    offset: Any


class Projection(NamedTuple):
    """Projection of a signal on the response to initial states and offsets.

    Attributes:
        rows: C Φ^k, shape (L, R, n).
        power: Φ^L, shape (n, n, M), or (n, n, 1) where all lanes share one set of weights.
        carry: Φ^{L c} of each lane's place c in its segment, shape (n, n, M).
        inverse: of the segments' normal matrices, shape (S, n + 1, n + 1).
    """

    rows: Any
    power: Any
    carry: Any
    inverse: Any


def projection(weights: Weights, lanes: Lanes, segments: int) -> Projection:
    """Prepare the projection for ``weights``, one set a sampling interval (leading axis R)."""
    n = weights.output.shape[-1]
    rows, power = free_response_rows(weights, len(lanes.response))
    power = per_lane(power, lanes.rate)
    carry = carry_from_segments(power, lanes)

    weighted = lanes.weight
    pair = [
        [_sum_over_steps(rows[..., i] * rows[..., j], lanes.rate, weighted) for j in range(n)]
        for i in range(n)
    ]
    single = jnp.stack([_sum_over_steps(rows[..., i], lanes.rate, weighted) for i in range(n)])
    gram = jnp.stack([jnp.stack(row) for row in pair])  # (n, n, M), in the chunk's own start state
    total = jnp.sum(weighted, axis=0)
    gram = jnp.einsum("iam,ijm,jbm->mab", carry, gram, carry)
    cross = jnp.einsum("iam,im->ma", carry, single)
    top = jnp.concatenate([gram, cross[:, :, None]], axis=2)
    bottom = jnp.concatenate([cross, total[:, None]], axis=1)[:, None, :]
    normal = jax.ops.segment_sum(jnp.concatenate([top, bottom], axis=1), lanes.segment, segments)
    return Projection(rows, power, carry, inverse_of_segments(normal))


def inverse_of_segments(normal: Any) -> Any:
    """Return the pseudo-inverse of each segment's normal matrix, shape (S, n + 1, n + 1).

    It is zero in directions without information, as of a mode that decays in one step.
    """
    diagonal = jnp.sqrt(jnp.maximum(jnp.diagonal(normal, axis1=-2, axis2=-1), 1e-300))
    scaled = normal / diagonal[..., :, None] / diagonal[..., None, :]
    values, vectors = jnp.linalg.eigh(scaled)
    reciprocal = jnp.where(values > 1e-12, 1.0 / jnp.maximum(values, 1e-12), 0.0)
    inverse = jnp.einsum("sij,sj,skj->sik", vectors, reciprocal, vectors)
    return inverse / diagonal[..., :, None] / diagonal[..., None, :]


def nuisance_products(p: Projection, lanes: Lanes, signal: Any) -> Any:
    """Return the products of a signal with the responses to states and offset, shape (S, n + 1).

    ``signal``: shape (L, M).
    """
    n = p.rows.shape[-1]
    moments = jnp.stack([_sum_over_steps(p.rows[..., i], lanes.rate, signal) for i in range(n)])
    states = jnp.einsum("iam,im->ma", p.carry, moments)
    sums = jnp.concatenate([states, jnp.sum(signal, axis=0)[:, None]], axis=1)
    return jax.ops.segment_sum(sums, lanes.segment, p.inverse.shape[0])


def fit_nuisance(p: Projection, lanes: Lanes, signal: Any) -> Nuisance:
    """Return the initial states and offsets that explain ``signal``, shape (L, M), best."""
    solved = jnp.einsum("sij,sj->si", p.inverse, nuisance_products(p, lanes, signal * lanes.weight))
    return Nuisance(solved[:, :-1], solved[:, -1])


def nuisance_response(p: Projection, lanes: Lanes, nuisance: Nuisance) -> Any:
    """Return the response to initial states and offsets, shape (L, M)."""
    starts = jnp.einsum("iam,ma->im", p.carry, nuisance.state[lanes.segment])
    return respond_freely(p.rows, lanes.rate, starts) + nuisance.offset[lanes.segment]


def respond_from_rest(weights: Weights, lanes: Lanes) -> tuple[Any, Any]:
    """Run every lane from a zero state.

    Returns:
        The forced response, shape (L, M), and the end states, shape (n, M).
    """
    phi, gamma, c, d = (per_lane(w, lanes.rate) for w in weights)

    def step(x: Any, u: Any) -> tuple[Any, Any]:
        return product(phi, x) + product(gamma, u), product(c, x) + product(d, u)

    ends, outputs = lax.scan(
        step, jnp.zeros((weights.output.shape[-1], lanes.inputs.shape[-1])), lanes.inputs
    )
    return outputs, ends


def solve_starts(weights: Weights, lanes: Lanes, segments: int) -> tuple[Projection, Nuisance, Any]:
    """Solve for the initial states and offsets, by least squares.

    Returns:
        The projection, the initial states and offsets, and with them the state at each lane's
        start, shape (n, M).
    """
    p = projection(weights, lanes, segments)
    forced, ends = respond_from_rest(weights, lanes)
    at_rest = chain_states(p.power, ends, lanes.first, 0.0)
    nuisance = fit_nuisance(
        p, lanes, lanes.response - forced - respond_freely(p.rows, lanes.rate, at_rest)
    )
    return p, nuisance, chain_states(p.power, ends, lanes.first, nuisance.state[lanes.segment].T)


def free_response_rows(weights: Weights, length: int) -> tuple[Any, Any]:
    """Return C Φ^k for k < L, shape (L, R, n), and Φ^L, shape (R, n, n)."""

    def step(row: Any, _: None) -> tuple[Any, Any]:
        return jnp.sum(row[:, :, None] * weights.transition, axis=1), row

    _, rows = lax.scan(step, weights.output, None, length=length)
    power = jax.vmap(functools.partial(_power, exponent=length))(weights.transition)
    return rows, power


def _power(matrix: Any, exponent: int) -> Any:
    """Return a power of a matrix, by repeated squaring."""
    result = None
    square = matrix
    while exponent:
        if exponent & 1:
            result = square if result is None else result @ square
        square = square @ square
        exponent >>= 1
    return result


def chain_states(power: Any, ends: Any, first: Any, initial: Any) -> Any:
    """Pass the state from lane to lane: X' = power X + end of the lane before.

    Args:
        power: Φ^L, shape (n, n, M or 1).
        ends: end states of the lanes from a zero state, shape (n, …, M).
        first: whether a lane is the first of its segment, shape (M,).
        initial: X where a segment begins, broadcast to ``ends``.

    Returns:
        X at the start of every lane, shape (n, …, M).
    """
    n = ends.shape[0]
    count = ends.shape[-1]
    inner_axes = (1,) * (ends.ndim - 2)

    def by_lane(values: Any, shape: tuple[int, ...]) -> Any:
        return jnp.moveaxis(jnp.broadcast_to(values, shape), -1, 0)

    def step(state_before: Any, lane: Any) -> tuple[Any, Any]:
        matrix, end, is_first, start = lane
        state = jnp.where(is_first, start, state_before)
        return dot(
            [matrix[:, k].reshape(n, *inner_axes) for k in range(n)], list(state)
        ) + end, state

    lanes = (
        by_lane(power, (n, n, count)),
        jnp.moveaxis(ends, -1, 0),
        first,
        by_lane(initial, ends.shape),
    )
    _, states = lax.scan(step, jnp.zeros(ends.shape[:-1]), lanes)
    return jnp.moveaxis(states, 0, -1)


def carry_from_segments(power: Any, lanes: Lanes) -> Any:
    """Return the derivative of every lane's start by its segment's, shape (n, n, M).

    ``power``: Φ^L, as of :func:`chain_states`.
    """
    n = len(power)
    count = lanes.first.shape[0]
    return chain_states(power, jnp.zeros((n, n, count)), lanes.first, jnp.eye(n)[..., None])


def respond_freely(rows: Any, rate: Any, starts: Any) -> Any:
    """Return the free response of every lane from its start state, shape (L, M)."""
    if rows.shape[1] == 1:
        return rows[:, 0, :] @ starts
    return jnp.einsum("lmi,im->lm", rows[:, rate, :], starts)


def _sum_over_steps(row: Any, rate: Any, weighted: Any) -> Any:
    """Return Σ_k row[k] · weighted[k] for every lane: row (L, R), weighted (L, M) → (M,)."""
    if row.shape[1] == 1:
        return row[:, 0] @ weighted
    return jnp.einsum("lm,lm->m", row[:, rate], weighted)


def per_lane(weight: Any, rate: Any) -> Any:
    """Return the weights (R, …) → (…, M), or (…, 1) where all lanes share one set."""
    if weight.shape[0] == 1:
        return jnp.moveaxis(weight, 0, -1)
    return jnp.moveaxis(weight[rate], 0, -1)


def dot(weights: Any, values: Any) -> Any:
    """Return Σ_i weights[i] · values[i], written out: elementwise, no small matrix product."""
    return functools.reduce(
        lambda total, pair: total + pair[0] * pair[1], zip(weights, values, strict=True), 0.0
    )


def product(matrix: Any, vector: Any) -> Any:
    """Return Σ_k matrix[…, k, :] vector[k], written out: (…, K, M) and (K, …, M) → (…, M)."""
    return dot([matrix[..., k, :] for k in range(matrix.shape[-2])], list(vector))
