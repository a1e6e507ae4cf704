"""Unroll the network of a sensor with a force in chunks, joined by Newton's method.

A nonlinear recursion does not split into a response from rest and a free response. Multiple
shooting (Bock & Plitt 1984) runs every chunk from a guess of its start state, with the derivative
of its end and outputs by that state. A Newton step then moves all guesses so that each chunk begins
at the end of its predecessor, and sets the initial state and offset of each segment to their
least-squares values. From the linear network's states, three or four steps converge to rounding.

Derivatives by the parameters come from forward-mode differentiation within each chunk and are
carried from chunk to chunk. Initial states and offsets are then projected out as for the linear
network.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from vibrident.base.backend import jax, jnp, lax
from vibrident.physics.discretisation.forced import ForcedWeights
from vibrident.physics.network.sensitivity import NormalEquations
from vibrident.physics.network.unroll import (
    Lanes,
    carry_from_segments,
    chain_states,
    dot,
    inverse_of_segments,
    per_lane,
    product,
    solve_starts,
)

#: Most steps of Newton's method.
MAX_NEWTON_STEPS = 20
#: Relative change of the states that ends the steps.
STATE_TOLERANCE = 1e-12
#: Largest relative change of the states in the last step; with more, the cost is NaN.
MAX_CHANGE = 1e-6

Force = Callable[[Any], Any]


def forced_response(
    weights: ForcedWeights, force: Force, lanes: Lanes, starts: Any, rounds: tuple[int, int]
) -> tuple[Any, Any]:
    """Run every lane from its start state.

    Args:
        weights: one set a sampling interval (leading axis R).
        force: F of the response V at the nodes, elementwise.
        lanes: the records.
        starts: start states, shape (n, M).
        rounds: repetitions for the force at the nodes, without and with derivative: each of the
            latter adds one order of the derivative's series.

    Returns:
        Outputs, shape (L, M), and end states, shape (n, M).
    """
    value_rounds, slope_rounds = rounds
    phi, gamma, c, d = (per_lane(w, lanes.rate) for w in weights.linear)
    force_state, force_output, node_state, node_drive, node_force = (
        per_lane(w, lanes.rate) for w in weights[1:]
    )

    def step(x: Any, u: Any) -> tuple[Any, Any]:
        linear = product(node_state, x) + product(node_drive, u)  # V at the nodes without force
        fixed_linear, fixed_matrix = lax.stop_gradient((linear, node_force))

        def iterate(_: Any, f: Any) -> Any:
            return force(fixed_linear + product(fixed_matrix, f))

        f = lax.fori_loop(0, value_rounds, iterate, force(fixed_linear))
        f = lax.stop_gradient(f)
        for _ in range(slope_rounds):
            f = force(linear + product(node_force, f))
        y = product(c, x) + product(d, u) + product(force_output, f)
        return product(phi, x) + product(gamma, u) + product(force_state, f), y

    ends, outputs = lax.scan(step, starts, lanes.inputs)
    return outputs, ends


class _Shooting(NamedTuple):
    """Iterate of the multiple shooting.

    Attributes:
        starts: guessed start states, shape (n, M).
        offset: of the segments' responses, shape (S,).
        change: last relative change of the states.
        steps: number of steps taken.
    """

    starts: Any
    offset: Any
    change: Any
    steps: Any


def forced_normal_equations(
    simulate: Callable[[Any, Any], tuple[Any, Any]],
    z: Any,
    linear: Any,
    lanes: Lanes,
    noise: Any,
    segments: int,
) -> NormalEquations:
    """Return the normal equations of a nonlinear network.

    Those of a linear one: :func:`vibrident.physics.network.sensitivity.normal_equations`.

    Args:
        simulate: (parameters (P,), start states (n, M)) → outputs (L, M), end states (n, M).
        z: parameters, shape (P,).
        linear: weights of the linear part, for the first guess (leading axis R).
        lanes: the records.
        noise: standard deviation of the response noise, by lane, shape (M,).
        segments: S.
    """
    n = linear.output.shape[-1]
    p = z.shape[0]
    _, _, linear_starts = solve_starts(linear, lanes, segments)
    shots = _join_chunks(simulate, z, linear_starts, lanes, segments)

    def shifted(parameters: Any, shift: Any) -> tuple[Any, Any]:
        outputs, ends = simulate(parameters, shots.starts + shift[:, None])
        return (outputs, ends), outputs

    slopes, outputs = jax.jacfwd(shifted, argnums=(0, 1), has_aux=True)(z, jnp.zeros(n))
    (by_z, by_start), (ends_z, ends_start) = slopes
    by_start, ends_z, ends_start = (jnp.moveaxis(x, -1, 1) for x in (by_start, ends_z, ends_start))
    states_z = chain_states(ends_start, ends_z, lanes.first, 0.0)  # (n, P, M)
    scale = lanes.weight / noise
    response = outputs + shots.offset[lanes.segment]
    residual = (lanes.response - response) * scale
    columns = [(by_z[..., a] + product(by_start, states_z[:, a])) * scale for a in range(p)]
    rows = _nuisance_rows(by_start, carry_from_segments(ends_start, lanes), lanes)
    inverse = inverse_of_segments(_gram(rows, lanes, segments))
    projected = []
    for column in columns:
        share = jnp.einsum("sij,sj->si", inverse, _moments(rows, column, lanes, segments))
        by_lane = [share[lanes.segment, i] for i in range(n + 1)]
        projected.append(column - lanes.weight * dot(rows, by_lane))
    matrix = jnp.stack([jnp.stack([jnp.vdot(a, b) for b in projected]) for a in projected])
    gradient = jnp.stack([jnp.vdot(column, residual) for column in projected])
    squares = jax.ops.segment_sum(noise**2 * jnp.sum(residual**2, axis=0), lanes.segment, segments)
    cost = jnp.where(shots.change < MAX_CHANGE, jnp.vdot(residual, residual), jnp.nan)
    return NormalEquations(matrix, gradient, cost, squares, response, projected)


def _join_chunks(simulate: Any, z: Any, starts: Any, lanes: Lanes, segments: int) -> _Shooting:
    """Solve for the chunks' start states and the segments' offsets, by Newton's method."""
    n = starts.shape[0]

    def step(shots: _Shooting) -> _Shooting:
        def shifted(shift: Any) -> tuple[Any, Any]:
            simulated = simulate(z, shots.starts + shift[:, None])
            return simulated, simulated

        (by_start, ends_start), (outputs, ends) = jax.jacfwd(shifted, has_aux=True)(jnp.zeros(n))
        by_start = jnp.moveaxis(by_start, -1, 1)
        ends_start = jnp.moveaxis(ends_start, -1, 1)
        carry = carry_from_segments(ends_start, lanes)
        # To the next chunk's start; never used at a segment's end.
        gaps = ends - jnp.roll(shots.starts, -1, axis=1)
        shift = chain_states(ends_start, gaps, lanes.first, 0.0)
        rows = _nuisance_rows(by_start, carry, lanes)
        joined = outputs + product(by_start, shift)
        residual = (lanes.response - joined) * lanes.weight
        inverse = inverse_of_segments(_gram(rows, lanes, segments))
        solved = jnp.einsum("sij,sj->si", inverse, _moments(rows, residual, lanes, segments))
        shift = shift + jnp.einsum("iam,ma->im", carry, solved[:, :n][lanes.segment])
        size = jnp.max(jnp.abs(shots.starts)) + jnp.max(jnp.abs(outputs))
        change = jnp.max(jnp.abs(shift)) / size
        return _Shooting(shots.starts + shift, solved[:, n], change, shots.steps + 1)

    def is_unfinished(shots: _Shooting) -> Any:
        # NaN ends the loop and shows in the cost.
        return (shots.steps < MAX_NEWTON_STEPS) & (shots.change > STATE_TOLERANCE)

    first = _Shooting(starts, jnp.zeros(segments), jnp.asarray(jnp.inf), 0)
    return lax.while_loop(is_unfinished, step, first)


def _nuisance_rows(by_start: Any, carry: Any, lanes: Lanes) -> list[Any]:
    """Return ∂response/∂(initial state, offset) of the segments: n + 1 of shape (L, M)."""
    return [
        *(product(by_start, carry[:, a]) for a in range(carry.shape[1])),
        jnp.ones_like(lanes.response),
    ]


def _moments(rows: list[Any], signal: Any, lanes: Lanes, segments: int) -> Any:
    """Return the products of the rows with ``signal``, by segment, shape (S, n + 1)."""
    sums = jnp.stack([jnp.sum(row * signal * lanes.weight, axis=0) for row in rows], axis=-1)
    return jax.ops.segment_sum(sums, lanes.segment, segments)


def _gram(rows: list[Any], lanes: Lanes, segments: int) -> Any:
    """Return the products of the rows with each other, by segment, shape (S, n + 1, n + 1)."""
    return jnp.stack([_moments(rows, row, lanes, segments) for row in rows], axis=1)
