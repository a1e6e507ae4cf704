"""Normal equations of the unrolled network, accumulated on the way: no Jacobian is ever stored.

The derivative of the state obeys the network's own recursion, driven by the derivative of the weights
(forward sensitivity; the same numbers as forward-mode differentiation of :func:`respond`, tested against it):

    ∂x_{k+1} = Φ ∂x_k + ∂Φ x_k + ∂Γ c_k,    ∂y_k = C ∂x_k + ∂C x_k + ∂D c_k.

Each chunk runs from ∂x = 0 and sums the products of ∂y, the residual r, the free response C Φ^k and 1 that the normal
equations need; what the chunk's true ∂x at its start adds is put in afterwards, chunk by chunk.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

from vibrident.backend import jax, jnp, lax
from vibrident.discretize.weights import Weights
from vibrident.network.unroll import (
    Lanes,
    dot,
    fit_nuisance,
    free_part,
    free_response,
    from_rest,
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
    """

    matrix: Any
    gradient: Any
    cost: Any


def normal_equations(weights: Weights, slopes: Weights, lanes: Lanes, noise: Any, segments: int) -> Normal:
    """Normal equations at ``weights``.

    Args:
        weights: one set a sampling interval (leading axis R).
        slopes: ∂weights/∂parameters, each with a trailing axis of P.
        lanes: the data.
        noise: standard deviation of the response noise, by lane, shape (M,).
        segments: number of segments.
    """
    length, _, count = lanes.inputs.shape
    n, p = weights.output.shape[-1], slopes.output.shape[-1]
    proj = projection(weights, lanes, segments)
    _, power = free_response(weights, length)
    forced, forced_ends = from_rest(weights, lanes)
    at_rest = start_states(power, forced_ends, lanes, jnp.zeros((segments, n)))
    nuisance = fit_nuisance(proj, lanes, lanes.response - forced - free_part(proj.rows, lanes.rate, at_rest))
    starts = start_states(power, forced_ends, lanes, nuisance.state)
    ends, sums = _accumulate(weights, slopes, lanes, starts, nuisance.offset[lanes.segment], proj.rows)

    # True derivative of the state at each chunk's start; zero at a segment's start, where it is a nuisance held fixed.
    phi = per_lane(power, lanes.rate)
    d_starts = _chain(phi, ends, lanes.first)  # (P, n, M)

    # J = ∂y⁰ + F ∂s in every chunk; products of F with ∂y⁰, r and 1 are among the sums.
    rows = [[sums.row_row[i][j] for j in range(n)] for i in range(n)]
    jj = [[None] * p for _ in range(p)]
    jr, jf, j1 = [], [], []
    for a in range(p):
        jr.append(sums.slope_residual[a] + dot(d_starts[a], sums.row_residual))
        j1.append(sums.slope_one[a] + dot(d_starts[a], sums.row_one))
        jf.append([sums.slope_row[a][i] + dot(d_starts[a], [rows[k][i] for k in range(n)]) for i in range(n)])
        for b in range(a + 1):
            value = sums.slope_slope[a][b]
            value = value + dot(d_starts[a], sums.slope_row[b]) + dot(d_starts[b], sums.slope_row[a])
            value = value + dot(d_starts[a], [dot(d_starts[b], rows[i]) for i in range(n)])
            jj[a][b] = value
    precision = 1.0 / noise**2
    matrix = jnp.stack([jnp.stack([jnp.sum(precision * jj[max(a, b)][min(a, b)]) for b in range(p)]) for a in range(p)])
    gradient = jnp.stack([jnp.sum(precision * value) for value in jr])
    cost = jnp.sum(precision * sums.residual_residual)

    # What initial states and offset could imitate: moments of J against them, by segment.
    in_chunk = jnp.stack([jnp.stack(row) for row in jf])  # (P, n, M)
    states = jnp.einsum("iam,pim->pma", proj.carry, in_chunk)
    moments = jnp.concatenate([states, jnp.stack(j1)[:, :, None]], axis=2)  # (P, M, n + 1)
    totals = jax.vmap(lambda m: jax.ops.segment_sum(m, lanes.segment, segments))(moments)
    by_segment = jax.ops.segment_max(precision, lanes.segment, segments)
    matrix = matrix - jnp.einsum("psi,sij,qsj,s->pq", totals, proj.inverse, totals, by_segment)
    return Normal(matrix, gradient, cost)


class _Sums(NamedTuple):
    """Per chunk, each of shape (M,): sums over its steps of products of two signals."""

    residual_residual: Any
    slope_residual: list[Any]
    slope_one: list[Any]
    slope_slope: list[list[Any]]
    slope_row: list[list[Any]]
    row_residual: list[Any]
    row_one: list[Any]
    row_row: list[list[Any]]


def _accumulate(
    weights: Weights, slopes: Weights, lanes: Lanes, starts: Any, offset: Any, rows: Any
) -> tuple[list[list[Any]], _Sums]:
    """Run every chunk from its true state with ∂x = 0; return the end ∂x, [P][n] of (M,), and the sums."""
    _, q, count = lanes.inputs.shape
    n, p = weights.output.shape[-1], slopes.output.shape[-1]
    phi, gamma, c, d = (per_lane(w, lanes.rate) for w in weights)
    d_phi, d_gamma, d_c, d_d = (per_lane(w, lanes.rate) for w in slopes)
    shared = rows.shape[1] == 1

    def step(carry: Any, data: Any) -> tuple[Any, None]:
        x, dx, sums = carry
        u, y, w, row = data
        f = [row[0, i] if shared else row[lanes.rate, i] for i in range(n)]
        r = w * (y - offset - dot([c[i] for i in range(n)], x) - dot([d[j] for j in range(q)], u))
        following = [dot([phi[i, k] for k in range(n)], x) + dot([gamma[i, j] for j in range(q)], u) for i in range(n)]
        d_following, dy = [], []
        for a in range(p):
            slope = dot([c[i] for i in range(n)], dx[a]) + dot([d_c[i, a] for i in range(n)], x)
            dy.append(w * (slope + dot([d_d[j, a] for j in range(q)], u)))
            d_following.append(
                [
                    dot([phi[i, k] for k in range(n)], dx[a])
                    + dot([d_phi[i, k, a] for k in range(n)], x)
                    + dot([d_gamma[i, j, a] for j in range(q)], u)
                    for i in range(n)
                ]
            )
        sums = _Sums(
            sums.residual_residual + r * r,
            [s + v * r for s, v in zip(sums.slope_residual, dy, strict=True)],
            [s + v for s, v in zip(sums.slope_one, dy, strict=True)],
            [[s + dy[a] * dy[b] for b, s in enumerate(line)] for a, line in enumerate(sums.slope_slope)],
            [[s + dy[a] * f[i] for i, s in enumerate(line)] for a, line in enumerate(sums.slope_row)],
            [s + f[i] * r for i, s in enumerate(sums.row_residual)],
            [s + f[i] * w for i, s in enumerate(sums.row_one)],
            [[s + w * f[i] * f[j] for j, s in enumerate(line)] for i, line in enumerate(sums.row_row)],
        )
        return (following, d_following, sums), None

    zero = jnp.zeros(count)
    empty = _Sums(
        zero,
        [zero] * p,
        [zero] * p,
        [[zero] * (a + 1) for a in range(p)],
        [[zero] * n for _ in range(p)],
        [zero] * n,
        [zero] * n,
        [[zero] * n for _ in range(n)],
    )
    begin = ([starts[i] for i in range(n)], [[zero] * n for _ in range(p)], empty)
    (_, ends, sums), _ = lax.scan(step, begin, (lanes.inputs, lanes.response, lanes.weight, rows))
    return ends, sums


def _chain(phi: Any, ends: list[list[Any]], first: Any) -> Any:
    """∂x at the start of every chunk, shape (P, n, M)."""
    stacked = jnp.stack([jnp.stack(row) for row in ends])  # (P, n, M)
    p, n, count = stacked.shape
    power = jnp.moveaxis(jnp.broadcast_to(phi, (n, n, count)), -1, 0)

    def step(carry: Any, lane: Any) -> tuple[Any, Any]:
        matrix, end, is_first = lane
        state = jnp.where(is_first, 0.0, carry)
        columns = [state[:, k, None] * matrix[None, :, k] for k in range(n)]
        return functools.reduce(jnp.add, columns) + end, state

    _, states = lax.scan(step, jnp.zeros((p, n)), (power, jnp.moveaxis(stacked, -1, 0), first))
    return jnp.moveaxis(states, 0, -1)
