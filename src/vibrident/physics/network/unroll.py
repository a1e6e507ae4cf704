"""The unrolled network over many records at once, in parallel chunks.

A recursion over millions of samples is sequential, but a linear one splits: cut each record into chunks of a few
hundred steps, run all chunks side by side from a zero state, then pass the state from chunk to chunk (x' = Φ^L x +
end of chunk) and add each chunk's free response C Φ^k x. The result equals the recursion's to rounding, at the speed of
a vector loop. Every operation is elementwise across chunks; no small matrix products inside the loop.

The unknown initial state of each record and the offset of its response enter linearly, so they are solved for exactly
(variable projection; Golub & Pereyra 1973).
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

from vibrident.base.backend import jax, jnp, lax
from vibrident.physics.discretisation.weights import Weights


class Lanes(NamedTuple):
    """Records cut into chunks: L steps a chunk, M chunks ("lanes") in all, R distinct sets of weights, S segments.

    A segment is an unbroken run of steps with a state of its own: a whole record, or a part between gaps.
    """

    inputs: Any  # shape (L, q, M)
    response: Any  # shape (L, M), zero where ``weight`` is zero
    weight: Any  # shape (L, M), one where the sample counts, zero where not
    first: Any  # shape (M,), True at a segment's first chunk
    segment: Any  # shape (M,), int
    rate: Any  # shape (M,), int: which sampling interval


class Nuisance(NamedTuple):
    """Per segment: initial state, shape (S, n), and offset of the response, shape (S,)."""

    state: Any
    offset: Any


class Projection(NamedTuple):
    """Projection of a signal on the response to initial states and offsets."""

    rows: Any  # C Φ^k, shape (L, R, n)
    power: Any  # Φ^L, shape (n, n, M), or (n, n, 1) where all lanes share one set of weights
    carry: Any  # Φ^{L c} of each lane's place c in its segment, shape (n, n, M)
    inverse: Any  # inverse of the segments' normal matrices, shape (S, n + 1, n + 1)


def projection(weights: Weights, lanes: Lanes, segments: int) -> Projection:
    """Prepare the projection for ``weights``."""
    n = weights.output.shape[-1]
    rows, power = free_response(weights, len(lanes.response))
    power = per_lane(power, lanes.rate)
    carry = carried(power, lanes)

    weighted = lanes.weight
    pair = [[_collect(rows[..., i] * rows[..., j], lanes.rate, weighted) for j in range(n)] for i in range(n)]
    single = jnp.stack([_collect(rows[..., i], lanes.rate, weighted) for i in range(n)])
    gram = jnp.stack([jnp.stack(row) for row in pair])  # (n, n, M), in the chunk's own start state
    total = jnp.sum(weighted, axis=0)
    gram = jnp.einsum("iam,ijm,jbm->mab", carry, gram, carry)
    cross = jnp.einsum("iam,im->ma", carry, single)
    top = jnp.concatenate([gram, cross[:, :, None]], axis=2)
    bottom = jnp.concatenate([cross, total[:, None]], axis=1)[:, None, :]
    normal = jax.ops.segment_sum(jnp.concatenate([top, bottom], axis=1), lanes.segment, segments)
    return Projection(rows, power, carry, inverse_of_segments(normal))


def inverse_of_segments(normal: Any) -> Any:
    """Inverse of scaled normal matrices; directions without information (a mode that decays in one step) get zero."""
    diagonal = jnp.sqrt(jnp.maximum(jnp.diagonal(normal, axis1=-2, axis2=-1), 1e-300))
    scaled = normal / diagonal[..., :, None] / diagonal[..., None, :]
    values, vectors = jnp.linalg.eigh(scaled)
    kept = jnp.where(values > 1e-12, 1.0 / jnp.maximum(values, 1e-12), 0.0)
    inverse = jnp.einsum("sij,sj,skj->sik", vectors, kept, vectors)
    return inverse / diagonal[..., :, None] / diagonal[..., None, :]


def imitable(p: Projection, lanes: Lanes, signal: Any) -> Any:
    """Products of ``signal``, shape (L, M), with the responses to states and offset; shape (S, n + 1)."""
    n = p.rows.shape[-1]
    moments = jnp.stack([_collect(p.rows[..., i], lanes.rate, signal) for i in range(n)])
    states = jnp.einsum("iam,im->ma", p.carry, moments)
    sums = jnp.concatenate([states, jnp.sum(signal, axis=0)[:, None]], axis=1)
    return jax.ops.segment_sum(sums, lanes.segment, p.inverse.shape[0])


def fit_nuisance(p: Projection, lanes: Lanes, signal: Any) -> Nuisance:
    """Least-squares initial states and offsets that explain ``signal``, shape (L, M)."""
    solved = jnp.einsum("sij,sj->si", p.inverse, imitable(p, lanes, signal * lanes.weight))
    return Nuisance(solved[:, :-1], solved[:, -1])


def nuisance_response(p: Projection, lanes: Lanes, nuisance: Nuisance) -> Any:
    """Response to initial states and offsets, shape (L, M)."""
    starts = jnp.einsum("iam,ma->im", p.carry, nuisance.state[lanes.segment])
    return free_part(p.rows, lanes.rate, starts) + nuisance.offset[lanes.segment]


def from_rest(weights: Weights, lanes: Lanes) -> tuple[Any, Any]:
    """Forced response from a zero state in every lane, shape (L, M), and the end states, shape (n, M)."""
    phi, gamma, c, d = (per_lane(w, lanes.rate) for w in weights)

    def step(x: Any, u: Any) -> tuple[Any, Any]:
        return product(phi, x) + product(gamma, u), product(c, x) + product(d, u)

    ends, outputs = lax.scan(step, jnp.zeros((weights.output.shape[-1], lanes.inputs.shape[-1])), lanes.inputs)
    return outputs, ends


def best_start(weights: Weights, lanes: Lanes, segments: int) -> tuple[Projection, Nuisance, Any]:
    """Least-squares initial states and offsets, and with them the true state at each lane's start, shape (n, M)."""
    p = projection(weights, lanes, segments)
    forced, ends = from_rest(weights, lanes)
    at_rest = chained(p.power, ends, lanes.first, 0.0)
    nuisance = fit_nuisance(p, lanes, lanes.response - forced - free_part(p.rows, lanes.rate, at_rest))
    return p, nuisance, chained(p.power, ends, lanes.first, nuisance.state[lanes.segment].T)


def free_response(weights: Weights, length: int) -> tuple[Any, Any]:
    """C Φ^k for k < L, shape (L, R, n), and Φ^L, shape (R, n, n)."""

    def step(row: Any, _: None) -> tuple[Any, Any]:
        return jnp.sum(row[:, :, None] * weights.transition, axis=1), row

    _, rows = lax.scan(step, weights.output, None, length=length)
    power = jax.vmap(functools.partial(_power, exponent=length))(weights.transition)
    return rows, power


def _power(matrix: Any, exponent: int) -> Any:
    result, square = None, matrix
    while exponent:
        if exponent & 1:
            result = square if result is None else result @ square
        square = square @ square
        exponent >>= 1
    return result


def chained(power: Any, ends: Any, first: Any, initial: Any) -> Any:
    """X at the start of every lane from X' = power X + end of the lane before; ``initial`` where a segment begins.

    ``power``: shape (n, n, M or 1); ``ends``: shape (n, …, M); ``first``: shape (M,); ``initial``: broadcast to
    ``ends``.
    """
    n, count, others = ends.shape[0], ends.shape[-1], (1,) * (ends.ndim - 2)

    def by_lane(values: Any, shape: tuple[int, ...]) -> Any:
        return jnp.moveaxis(jnp.broadcast_to(values, shape), -1, 0)

    def step(carried: Any, lane: Any) -> tuple[Any, Any]:
        matrix, end, is_first, start = lane
        state = jnp.where(is_first, start, carried)
        return dot([matrix[:, k].reshape(n, *others) for k in range(n)], list(state)) + end, state

    lanes = (by_lane(power, (n, n, count)), jnp.moveaxis(ends, -1, 0), first, by_lane(initial, ends.shape))
    _, states = lax.scan(step, jnp.zeros(ends.shape[:-1]), lanes)
    return jnp.moveaxis(states, 0, -1)


def carried(power: Any, lanes: Lanes) -> Any:
    """Derivative of every lane's start by its segment's, shape (n, n, M); ``power`` as of :func:`chained`."""
    n, count = len(power), lanes.first.shape[0]
    return chained(power, jnp.zeros((n, n, count)), lanes.first, jnp.eye(n)[..., None])


def free_part(rows: Any, rate: Any, starts: Any) -> Any:
    """Free response of every lane from its start state, shape (L, M)."""
    if rows.shape[1] == 1:
        return rows[:, 0, :] @ starts
    return jnp.einsum("lmi,im->lm", rows[:, rate, :], starts)


def _collect(row: Any, rate: Any, weighted: Any) -> Any:
    """Σ_k row[k] · weighted[k] for every lane; row (L, R), weighted (L, M) → (M,)."""
    if row.shape[1] == 1:
        return row[:, 0] @ weighted
    return jnp.einsum("lm,lm->m", row[:, rate], weighted)


def per_lane(weight: Any, rate: Any) -> Any:
    """Weights (R, …) → (…, M), or (…, 1) where all lanes share one set."""
    if weight.shape[0] == 1:
        return jnp.moveaxis(weight, 0, -1)
    return jnp.moveaxis(weight[rate], 0, -1)


def dot(weights: Any, values: Any) -> Any:
    """Σ_i weights[i] · values[i], written out: elementwise, never a small matrix product."""
    return functools.reduce(lambda total, pair: total + pair[0] * pair[1], zip(weights, values, strict=True), 0.0)


def product(matrix: Any, vector: Any) -> Any:
    """Σ_k matrix[…, k, :] vector[k], written out over k: (…, K, M) and (K, …, M) → (…, M)."""
    return dot([matrix[..., k, :] for k in range(matrix.shape[-2])], list(vector))
