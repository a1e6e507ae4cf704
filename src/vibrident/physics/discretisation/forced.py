"""One step of a sensor with a nonlinear spring force: exact exponentials, collocated force.

The core in observer form has its response V among the states, whatever the reference quantity. With scaled time
θ = ωn t and numerator β of the core's transfer function,

    dx₁/dθ = −2 δ V + x₂ + β₁ u,    dx₂/dθ = −V + β₀ u + F(V),    V = x₁ + β₂ u.

Over a step the force F is the polynomial through its values at m Gauss–Legendre nodes; like the input it is integrated
against the exponential exactly (Hochbruck & Ostermann 2005: exponential collocation, order 2 m). The values at the
nodes follow from

    V_i = (response to state and input alone at node i) + Σ_j G_ij F(V_j),

solved by fixed-point iteration, which converges by |G ∂F/∂V|: small, because a force hardly moves the mass within a
step.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import legendre

from vibrident.base.backend import jax, jnp
from vibrident.base.errors import ModelError
from vibrident.physics.discretisation.weights import Method, Weights, drive_size, expm, legendre_shift
from vibrident.physics.models.base import Rational

EXACT = ("zoh", "foh", "bandlimited")  # methods whose step is an exact exponential
NODES = ((0.15, 3), (0.5, 4), (1.2, 6), (math.inf, 8))  # up to |λ| Ts, nodes of the force; beyond, the last
ROUNDS_TOLERANCE = 1e-10  # error of the iteration, relative to the response, for a spring that stiffens by a half
SLOPE_TOLERANCE = 1e-4  # the same for the derivative, relative to itself; it is used for the steps and the covariance
FEWEST_ROUNDS = 2  # fewest rounds of the iteration
MOST_ROUNDS = 24  # most rounds for the force itself


class ForcedWeights(NamedTuple):
    """One step of the network with a force."""

    linear: Weights  # Φ, Γ, C and D of the linear part, in observer form
    force: Any  # forces at the nodes → new state, shape (n, m)
    force_output: Any  # forces at the nodes → output, shape (m,)
    node_state: Any  # state → V at the nodes, shape (m, n)
    node_drive: Any  # inputs → V at the nodes, shape (m, q)
    node_force: Any  # G, forces at the nodes → V at the nodes, shape (m, m)


def accuracy(rate_times_step: float) -> tuple[int, tuple[int, int]]:
    """Nodes, and rounds for the force and for its derivative, for a sensor with |λ| Ts = ``rate_times_step``."""
    nodes = next(m for most, m in NODES if rate_times_step <= most)
    gain = math.log(min(0.5, 0.25 * rate_times_step**2))
    rounds = [math.ceil(math.log(tolerance) / gain) for tolerance in (ROUNDS_TOLERANCE, SLOPE_TOLERANCE)]
    return nodes, (min(max(rounds[0], FEWEST_ROUNDS), MOST_ROUNDS), max(rounds[1], FEWEST_ROUNDS))


def forced_weights(
    method: Method, blocks: tuple[Rational, ...], ts: Any, fraction: Any, terms: int, nodes: int
) -> ForcedWeights:
    """Weights of one step.

    ``method``: ``bandlimited``, ``foh`` or ``zoh``; ``blocks``: the core, on which the force acts, and the parallel
    blocks; each of second order, its numerator of at most second degree; ``ts``: sampling interval, s; ``fraction``:
    where in the step the output is read; ``terms``: inputs a step; ``nodes``: m.
    """
    if method.name not in EXACT:
        raise ModelError(
            "This discretisation has no step for a nonlinear sensor.",
            expected=" | ".join(EXACT),
            found=f"discretisation {method.name!r}",
            where="discretisation",
            remedy="leave the discretisation at its default",
        )
    n, q, m = 2 * len(blocks), terms, nodes
    places, transform = _collocation(m)
    a, b, direct = jnp.zeros((n, n)), jnp.zeros(n), []
    for index, block in enumerate(blocks):
        rows = slice(2 * index, 2 * index + 2)
        part_a, part_b, part_direct = _observer(block, ts)
        a, b = a.at[rows, rows].set(part_a), b.at[rows].set(part_b)
        direct.append(part_direct)
    size = drive_size(b, blocks[0].angular_scale * ts)
    generator = _generator(a, b / size, blocks[0].angular_scale * ts, q, m)
    fractions = jnp.concatenate([jnp.asarray(places), jnp.stack([jnp.asarray(fraction, dtype=float), jnp.ones(())])])
    steps = jax.vmap(lambda x: expm(generator * x))(fractions)
    steps = steps.at[:, :n, n : n + q].multiply(size)
    at_places = jnp.asarray((-1.0) ** np.arange(q)) @ steps[:, n : n + q, n : n + q]  # the input there
    seen = steps[:, 0, :].at[:, n : n + q].add(direct[0] * at_places)  # V of the core
    read = jnp.sum(steps[m, 0:n:2, :], axis=0).at[n : n + q].add(sum(direct) * at_places[m])
    whole = steps[m + 1]
    linear = Weights(whole[:n, :n], whole[:n, n : n + q], read[:n], read[n : n + q])
    return ForcedWeights(
        linear,
        whole[:n, n + q :] @ transform,
        read[n + q :] @ transform,
        seen[:m, :n],
        seen[:m, n : n + q],
        seen[:m, n + q :] @ transform,
    )


def _observer(block: Rational, ts: Any) -> tuple[Any, Any, Any]:
    """A Ts, b Ts and direct part of a block in observer form, its states in units of its response."""
    w = block.angular_scale
    a0, a1 = block.denominator[0] / w**2, block.denominator[1] / w
    beta = [block.gain * c * w ** (k - 2) for k, c in enumerate(block.numerator)] + [0.0] * (3 - len(block.numerator))
    a = jnp.stack([jnp.stack([-a1, jnp.ones(())]), jnp.stack([-a0, jnp.zeros(())])])
    b = jnp.stack([jnp.asarray(beta[1] - a1 * beta[2], dtype=float), jnp.asarray(beta[0] - a0 * beta[2], dtype=float)])
    return a * (w * ts), b * (w * ts), beta[2]


def _generator(a: Any, b: Any, force: Any, q: int, m: int) -> Any:
    """[[A, b g(0)ᵀ, e₂ g(0)ᵀ], [0, F, 0], [0, 0, F]]: state, input and force over one step together."""
    n = b.shape[0]
    signs = (-1.0) ** np.arange(max(q, m))
    pull = jnp.zeros((n, m)).at[1].set(force * signs[:m])
    top = jnp.concatenate([a, b[:, None] * signs[:q], pull], axis=1)
    below = np.zeros((q + m, n + q + m))
    below[:q, n : n + q] = legendre_shift(q)
    below[q:, n + q :] = legendre_shift(m)
    return jnp.concatenate([top, jnp.asarray(below)])


def _collocation(m: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss–Legendre nodes in (0, 1) and the matrix from values there to Legendre coefficients."""
    nodes, weights = legendre.leggauss(m)
    transform = (2 * np.arange(m) + 1)[:, None] * (0.5 * weights * legendre.legvander(nodes, m - 1).T)
    return 0.5 * (nodes + 1.0), transform
