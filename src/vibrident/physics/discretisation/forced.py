"""Step of a sensor with a nonlinear spring force: exact exponentials, collocated force.

The core in observer form has its response V among the states, whatever the reference quantity. With
scaled time θ = ωn t and numerator β of the core's transfer function,

    dx₁/dθ = −2 δ V + x₂ + β₁ u,    dx₂/dθ = −V + β₀ u + F(V),    V = x₁ + β₂ u.

Over a step the force F is the polynomial through its values at m Gauss–Legendre nodes; like the
input it is integrated against the exponential exactly (Hochbruck & Ostermann 2005: exponential
collocation, order 2 m). The values at the nodes follow from

    V_i = (response to state and input alone at node i) + Σ_j G_ij F(V_j),

solved by fixed-point iteration, which converges by |G ∂F/∂V|: small, because a force hardly moves
the mass within a step.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import legendre

from vibrident.base.backend import jax, jnp
from vibrident.base.errors import ModelError
from vibrident.physics.discretisation.weights import (
    Method,
    Weights,
    drive_size,
    expm,
    legendre_shift,
)
from vibrident.physics.models.base import Rational

#: Methods whose step is an exact exponential.
EXACT_METHODS = ("zoh", "foh", "bandlimited")
#: Largest |λ| Ts, and the nodes of the force up to it.
NODES_BY_RATE = ((0.15, 3), (0.5, 4), (1.2, 6), (math.inf, 8))
#: Error of the iteration, relative to the response, for a spring that stiffens by a half.
ROUNDS_TOLERANCE = 1e-10
#: Error of the derivative, relative to itself; it serves the steps and the covariance.
SLOPE_TOLERANCE = 1e-4
#: Least rounds of the iteration, for the force and for its derivative.
MIN_ROUNDS = 2
#: Most rounds for the force itself.
MAX_FORCE_ROUNDS = 24


class ForcedWeights(NamedTuple):
    """Weights of a step of the network with a force.

    Attributes:
        linear: Φ, Γ, C and D of the linear part, in observer form.
        force: forces at the nodes → new state, shape (n, m).
        force_output: forces at the nodes → output, shape (m,).
        node_state: state → V at the nodes, shape (m, n).
        node_drive: inputs → V at the nodes, shape (m, q).
        node_force: G, forces at the nodes → V at the nodes, shape (m, m).
    """

    linear: Weights
    force: Any
    force_output: Any
    node_state: Any
    node_drive: Any
    node_force: Any


def accuracy(rate_times_step: float) -> tuple[int, tuple[int, int]]:
    """Return the nodes of the force, and the rounds for it and for its derivative.

    ``rate_times_step``: |λ| Ts of the sensor.
    """
    nodes = next(m for most, m in NODES_BY_RATE if rate_times_step <= most)
    gain = math.log(min(0.5, 0.25 * rate_times_step**2))
    rounds = [
        math.ceil(math.log(tolerance) / gain) for tolerance in (ROUNDS_TOLERANCE, SLOPE_TOLERANCE)
    ]
    return nodes, (
        min(max(rounds[0], MIN_ROUNDS), MAX_FORCE_ROUNDS),
        max(rounds[1], MIN_ROUNDS),
    )


def forced_weights(
    method: Method, blocks: tuple[Rational, ...], ts: Any, fraction: Any, terms: int, nodes: int
) -> ForcedWeights:
    """Return the weights of one step.

    Args:
        method: ``bandlimited``, ``foh`` or ``zoh``.
        blocks: the core, on which the force acts, and the parallel blocks; each of second order,
            its numerator of at most second degree.
        ts: sampling interval, s.
        fraction: where in the step the output is read.
        terms: inputs a step.
        nodes: m.

    Raises:
        ModelError: the method's step is no exact exponential.
    """
    if method.name not in EXACT_METHODS:
        raise ModelError(
            "This discretisation has no step for a nonlinear sensor.",
            expected=" | ".join(EXACT_METHODS),
            found=f"discretisation {method.name!r}",
            where="discretisation",
            remedy="leave the discretisation at its default",
        )
    n = 2 * len(blocks)
    q = terms
    m = nodes
    abscissae, transform = _collocation(m)
    a = jnp.zeros((n, n))
    b = jnp.zeros(n)
    direct = []
    for index, block in enumerate(blocks):
        rows = slice(2 * index, 2 * index + 2)
        part_a, part_b, part_direct = _observer(block, ts)
        a = a.at[rows, rows].set(part_a)
        b = b.at[rows].set(part_b)
        direct.append(part_direct)
    size = drive_size(b, blocks[0].angular_scale * ts)
    generator = _generator(a, b / size, blocks[0].angular_scale * ts, q, m)
    fractions = jnp.concatenate(
        [jnp.asarray(abscissae), jnp.stack([jnp.asarray(fraction, dtype=float), jnp.ones(())])]
    )
    steps = jax.vmap(lambda x: expm(generator * x))(fractions)
    steps = steps.at[:, :n, n : n + q].multiply(size)
    # The input at the nodes, where the output is read, and at the end.
    at_places = jnp.asarray((-1.0) ** np.arange(q)) @ steps[:, n : n + q, n : n + q]
    core_response = steps[:, 0, :].at[:, n : n + q].add(direct[0] * at_places)
    read = jnp.sum(steps[m, 0:n:2, :], axis=0).at[n : n + q].add(sum(direct) * at_places[m])
    full_step = steps[m + 1]
    linear = Weights(full_step[:n, :n], full_step[:n, n : n + q], read[:n], read[n : n + q])
    return ForcedWeights(
        linear,
        full_step[:n, n + q :] @ transform,
        read[n + q :] @ transform,
        core_response[:m, :n],
        core_response[:m, n : n + q],
        core_response[:m, n + q :] @ transform,
    )


def _observer(block: Rational, ts: Any) -> tuple[Any, Any, Any]:
    """Return A Ts, b Ts and the direct part of a block in observer form.

    Its states are in units of its response.
    """
    w = block.angular_scale
    a0 = block.denominator[0] / w**2
    a1 = block.denominator[1] / w
    beta = [block.gain * c * w ** (k - 2) for k, c in enumerate(block.numerator)] + [0.0] * (
        3 - len(block.numerator)
    )
    a = jnp.stack([jnp.stack([-a1, jnp.ones(())]), jnp.stack([-a0, jnp.zeros(())])])
    b = jnp.stack(
        [
            jnp.asarray(beta[1] - a1 * beta[2], dtype=float),
            jnp.asarray(beta[0] - a0 * beta[2], dtype=float),
        ]
    )
    return a * (w * ts), b * (w * ts), beta[2]


def _generator(a: Any, b: Any, force: Any, q: int, m: int) -> Any:
    """Return the generator of state, input and force over one step together.

    It is [[A, b g(0)ᵀ, e₂ g(0)ᵀ], [0, F, 0], [0, 0, F]].
    """
    n = b.shape[0]
    signs = (-1.0) ** np.arange(max(q, m))
    pull = jnp.zeros((n, m)).at[1].set(force * signs[:m])
    top = jnp.concatenate([a, b[:, None] * signs[:q], pull], axis=1)
    below = np.zeros((q + m, n + q + m))
    below[:q, n : n + q] = legendre_shift(q)
    below[q:, n + q :] = legendre_shift(m)
    return jnp.concatenate([top, jnp.asarray(below)])


def _collocation(m: int) -> tuple[np.ndarray, np.ndarray]:
    """Return m Gauss–Legendre nodes in (0, 1), and the matrix from values there to coefficients.

    The coefficients are those of Legendre polynomials, shape (m, m).
    """
    nodes, weights = legendre.leggauss(m)
    transform = (2 * np.arange(m) + 1)[:, None] * (
        0.5 * weights * legendre.legvander(nodes, m - 1).T
    )
    return 0.5 * (nodes + 1.0), transform
