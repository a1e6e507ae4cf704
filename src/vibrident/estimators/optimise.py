"""Two ways down the same residual: Levenberg–Marquardt (optimistix) and Adam (optax), one step at a time.

An objective ``quadratic(z, args)`` gives cost, gradient and JᵀJ of the weighted residual at coordinates z, shape
(p,), however many residuals there are. ``compressed`` turns them into p + 1 numbers with the same cost, gradient and
JᵀJ, so the optimiser's steps are those of the full problem, and its own code is compiled once for all data.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import equinox as eqx
import numpy as np
import optax
import optimistix as optx

from vibrident.backend import jax, jnp
from vibrident.errors import NotConverged
from vibrident.records import FloatArray


class Quadratic(Protocol):
    """What an objective returns: rᵀr, Jᵀr with J = −∂r/∂z, and JᵀJ."""

    @property
    def cost(self) -> Any:
        """Sum of squares."""

    @property
    def gradient(self) -> Any:
        """Shape (p,)."""

    @property
    def matrix(self) -> Any:
        """Shape (p, p)."""


Objective = Callable[[Any, Any], Quadratic]


class Progress(Protocol):
    """Called after each iteration with the iteration, the most there can be, and the cost."""

    def __call__(self, iteration: int, most: int, cost: float) -> None:
        """Show progress."""


def silent(iteration: int, most: int, cost: float) -> None:
    """Progress that shows nothing."""


@dataclass(frozen=True)
class Trace:
    """Where an optimiser went: cost and coordinates at each accepted iterate, and how it ended."""

    optimiser: str
    converged: bool
    status: str
    costs: tuple[float, ...]
    coordinates: FloatArray  # (iterates, p)

    @property
    def last(self) -> FloatArray:
        """Final coordinates, shape (p,)."""
        return self.coordinates[-1]


def compressed(z: Any, args: Any) -> Any:
    """A residual of p + 1 numbers equivalent to the full one near ``at``: same cost, Jᵀr and JᵀJ.

    With JᵀJ = RᵀR and q = R⁻ᵀ Jᵀr it is (q − R (z − at), √(rᵀr − qᵀq)).

    Args:
        z: coordinates, shape (p,).
        args: at, shape (p,); JᵀJ, shape (p, p); Jᵀr, shape (p,); rᵀr.
    """
    at, matrix, gradient, cost = args
    scale = jnp.sqrt(jnp.maximum(jnp.diagonal(matrix), 1e-300))
    values, vectors = jnp.linalg.eigh(matrix / scale[:, None] / scale[None, :])
    kept = values > 1e-14
    root = jnp.sqrt(jnp.where(kept, values, 0.0))
    factor = root[:, None] * vectors.T * scale[None, :]
    q = jnp.where(kept, vectors.T @ (gradient / scale) / jnp.where(kept, root, 1.0), 0.0)
    rest = jnp.sqrt(jnp.maximum(cost - q @ q, 0.0))
    return jnp.concatenate([q - factor @ (z - at), rest[None]])


def levenberg_marquardt(
    objective: Objective,
    start: FloatArray,
    args: Any,
    *,
    tolerance: float = 1e-9,
    most: int = 60,
    progress: Progress = silent,
) -> Trace:
    """Minimise by Levenberg–Marquardt (optimistix; damped Gauss–Newton with a trust region) from ``start``.

    It stops when a full Gauss–Newton step would lower the cost by less than ``tolerance``. With residuals in units
    of their standard deviation that step is √tolerance standard uncertainties long, so nothing that could be known
    is left.

    Args:
        objective: compiled function.
        start: shape (p,).
        args: anything the objective needs.
        tolerance: decrease of the cost that is not worth a step.
        most: most evaluations of the objective.
        progress: called after each iteration.
    """
    z = jnp.asarray(start, dtype=float)
    nothing = (z, jnp.eye(z.shape[0]), jnp.zeros_like(z), jnp.zeros(()))
    state = _begin(z, nothing)
    costs: list[float] = []
    path: list[FloatArray] = []
    status, converged = f"stopped after {most} evaluations", False
    for iteration in range(1, most + 1):
        trial = state.y_eval
        local = objective(trial, args)
        if not np.isfinite(local.cost):
            if not costs:
                raise NotConverged(
                    "The cost is not finite at the start values: the discretisation is unstable for this sensor at "
                    "this sampling rate (Euler needs Ts < 2 δ/ωn), or the records hold values that cannot be squared."
                )
            status = "the cost is not finite"
            break
        z, state, accepted, decrement, stalled = _advance(z, (trial, local.matrix, local.gradient, local.cost), state)
        if accepted:
            costs.append(float(local.cost))
            path.append(np.asarray(z))
        progress(iteration, most, costs[-1])
        if decrement < max(tolerance, 1e-15 * costs[-1]) or stalled:
            status, converged = "converged", True
            break
    return Trace("levenberg-marquardt", converged, status, tuple(costs), np.array(path))


#: Only its stepping is used; when to stop is decided above, so its own tolerances do not matter.
_SOLVER = optx.LevenbergMarquardt(rtol=1e-12, atol=1e-12)
#: So many rejected steps in a row mean that rounding, not the model, is what is left.
_MOST_REJECTED = 12


def _residual(z: Any, args: Any) -> tuple[Any, None]:
    return compressed(z, args), None


@eqx.filter_jit
def _begin(z: Any, args: Any) -> Any:
    shape = jax.ShapeDtypeStruct((z.shape[0] + 1,), z.dtype)
    return _SOLVER.init(_residual, z, args, {}, shape, None, frozenset())


@eqx.filter_jit
def _advance(z: Any, args: Any, state: Any) -> tuple[Any, ...]:
    """Take the evaluation at the trial point: accept or reject it, and propose the next."""
    before = state.num_accepted_steps
    z, state, _ = _SOLVER.step(_residual, z, args, {}, state, frozenset())
    value = state.f_info.residual  # at the accepted point: (q, rest), and qᵀq is what a full step would gain
    stalled = state.num_steps_since_acceptance > _MOST_REJECTED
    return z, state, state.num_accepted_steps > before, jnp.sum(value[:-1] ** 2), stalled


def adam(
    objective: Objective,
    start: FloatArray,
    args: Any,
    *,
    learning_rate: float = 0.001,
    steps: int = 1500,
    progress: Progress = silent,
) -> Trace:
    """Minimise the squared residual by Adam (Kingma & Ba 2015), the paper's optimiser, full batch.

    Adam's steps do not depend on the scale of the cost, so the mean and the sum of squares train alike.
    """
    z = jnp.asarray(start, dtype=float)
    state = optax.adam(learning_rate).init(z)
    costs, path = [], []
    for iteration in range(1, steps + 1):
        local = objective(z, args)
        costs.append(float(local.cost))
        path.append(np.asarray(z))
        z, state = _adam_step(z, -2.0 * local.gradient, state, learning_rate)
        progress(iteration, steps, costs[-1])
    return Trace("adam", True, f"{steps} steps", tuple(costs), np.array(path))


@jax.jit
def _adam_step(z: Any, gradient: Any, state: Any, learning_rate: Any) -> tuple[Any, Any]:
    update, state = optax.adam(learning_rate).update(gradient, state, z)
    return optax.apply_updates(z, update), state
