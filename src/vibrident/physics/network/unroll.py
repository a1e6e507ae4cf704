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


def start_states(power: Any, ends: Any, lanes: Lanes, initial: Any) -> Any:
    """True state at the start of every lane, shape (n, M).

    ``power``: Φ^L, shape (R, n, n); ``ends``: end states of the lanes from rest, shape (n, M); ``initial``: state at
    the start of every segment, shape (S, n).
    """
    return _starts(per_lane(power, lanes.rate), ends, lanes.first, initial[lanes.segment].T)


class Projection(NamedTuple):
    """Projection of a signal on the response to initial states and offsets."""

    rows: Any  # C Φ^k, shape (L, R, n)
    carry: Any  # Φ^{L c} of each lane's place c in its segment, shape (n, n, M)
    inverse: Any  # inverse of the segments' normal matrices, shape (S, n + 1, n + 1)


def projection(weights: Weights, lanes: Lanes, segments: int) -> Projection:
    """Prepare the projection for ``weights``."""
    length, count = lanes.response.shape
    n = weights.output.shape[-1]
    rows, power = free_response(weights, length)
    chunk_power = per_lane(power, lanes.rate)
    zero = jnp.zeros((n, count))
    carry = jnp.stack([_starts(chunk_power, zero, lanes.first, zero.at[i].set(1.0)) for i in range(n)], axis=1)

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
    return Projection(rows, carry, inverse_of_segments(normal))


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
    return nuisance_of(p, imitable(p, lanes, signal * lanes.weight))


def nuisance_of(p: Projection, moments: Any) -> Nuisance:
    """Initial states and offsets whose products are ``moments``, shape (S, n + 1)."""
    solved = jnp.einsum("sij,sj->si", p.inverse, moments)
    return Nuisance(solved[:, :-1], solved[:, -1])


def nuisance_response(p: Projection, lanes: Lanes, nuisance: Nuisance) -> Any:
    """Response to initial states and offsets, shape (L, M)."""
    starts = jnp.einsum("iam,ma->im", p.carry, nuisance.state[lanes.segment])
    return free_part(p.rows, lanes.rate, starts) + nuisance.offset[lanes.segment]


def from_rest(weights: Weights, lanes: Lanes) -> tuple[Any, Any]:
    """Forced response from a zero state in every lane, shape (L, M), and the end states, shape (n, M)."""
    inputs = lanes.inputs
    _, terms, count = inputs.shape
    n = weights.output.shape[-1]
    phi, gamma = per_lane(weights.transition, lanes.rate), per_lane(weights.drive, lanes.rate)
    c, d = per_lane(weights.output, lanes.rate), per_lane(weights.feedthrough, lanes.rate)

    def step(state: tuple[Any, ...], u: Any) -> tuple[tuple[Any, ...], Any]:
        output = dot([c[i] for i in range(n)], state) + dot([d[j] for j in range(terms)], u)
        following = tuple(
            dot([phi[i, k] for k in range(n)], state) + dot([gamma[i, j] for j in range(terms)], u) for i in range(n)
        )
        return following, output

    ends, outputs = lax.scan(step, (jnp.zeros(count),) * n, inputs)
    return outputs, jnp.stack(ends)


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


def _starts(power: Any, ends: Any, first: Any, initial: Any) -> Any:
    """State at the start of every lane, shape (n, M), from the lanes' end states and the segments' initial states."""
    n, count = ends.shape
    power = jnp.broadcast_to(power, (n, n, count))

    def step(carry: Any, lane: Any) -> tuple[Any, Any]:
        p, end, is_first, start = lane
        state = [jnp.where(is_first, start[i], carry[i]) for i in range(n)]
        following = [dot([p[i, k] for k in range(n)], state) + end[i] for i in range(n)]
        return following, state

    lane = (jnp.moveaxis(power, -1, 0), ends.T, first, initial.T)
    _, states = lax.scan(step, [jnp.zeros(())] * n, lane)
    return jnp.stack(states)


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
