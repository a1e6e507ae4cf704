"""Two ways down the same residual: Levenberg–Marquardt (optimistix) and Adam (optax), one step at a time.

An objective is a pure function ``residual(z, args)`` of coordinates z, shape (p,), that returns a vector whose sum of
squares is the cost. The time-domain problem has hundreds of thousands of residuals; ``compressed`` gives a vector of p + 1
numbers with the same cost, gradient and JᵀJ, so the optimiser's steps are those of the full problem.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import equinox as eqx
import numpy as np
import optax
import optimistix as optx

from vibrident.backend import jax, jnp, lax
from vibrident.network.sensitivity import Normal
from vibrident.records import FloatArray

Residual = Callable[[Any, Any], Any]


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


def compressed(normal: Normal, z: Any) -> Any:
    """A residual of p + 1 numbers equivalent to the accumulated one at ``z``: same cost, Jᵀr and JᵀJ.

    With JᵀJ = RᵀR and q = R⁻ᵀ Jᵀr it is (q − R (z − z₀), √(rᵀr − qᵀq)), z₀ being z held constant: its derivative is −R.
    """
    held = lax.stop_gradient(normal)
    scale = jnp.sqrt(jnp.maximum(jnp.diagonal(held.matrix), 1e-300))
    values, vectors = jnp.linalg.eigh(held.matrix / scale[:, None] / scale[None, :])
    kept = values > 1e-14
    root = jnp.sqrt(jnp.where(kept, values, 0.0))
    factor = root[:, None] * vectors.T * scale[None, :]
    q = jnp.where(kept, vectors.T @ (held.gradient / scale) / jnp.where(kept, root, 1.0), 0.0)
    rest = jnp.sqrt(jnp.maximum(held.cost - q @ q, 0.0))
    return jnp.concatenate([q - factor @ (z - lax.stop_gradient(z)), rest[None]])


def levenberg_marquardt(
    residual: Residual,
    start: FloatArray,
    args: Any,
    *,
    tolerance: float = 1e-9,
    most: int = 60,
    progress: Progress = silent,
) -> Trace:
    """Minimise by Levenberg–Marquardt (optimistix; damped Gauss–Newton with a trust region) from ``start``.

    It stops when a full Gauss–Newton step would lower the cost by less than ``tolerance``. With residuals in units of their
    standard deviation that step is √tolerance standard uncertainties long, so nothing that could be known is left.

    Args:
        residual: module-level function, so that its compiled form is reused.
        start: shape (p,).
        args: anything the residual needs.
        tolerance: decrease of the cost that is not worth a step.
        most: most evaluations of the residual and its derivative.
        progress: called after each iteration.
    """
    z = jnp.asarray(start, dtype=float)
    state = _begin(residual, z, args)
    costs: list[float] = []
    path: list[FloatArray] = []
    status, converged = f"stopped after {most} evaluations", False
    for iteration in range(1, most + 1):
        z, state, accepted, cost, decrement, stalled = _advance(residual, z, args, state)
        if not np.isfinite(cost):
            status = "the cost is not finite"
            break
        if accepted:
            costs.append(float(cost))
            path.append(np.asarray(z))
        progress(iteration, most, float(cost))
        if decrement < max(tolerance, 1e-15 * float(cost)) or stalled:
            status, converged = "converged", True
            break
    if not costs:
        costs, path = [float("inf")], [np.asarray(start, dtype=float)]
    return Trace("levenberg-marquardt", converged, status, tuple(costs), np.array(path))


#: Only its stepping is used; when to stop is decided above, so its own tolerances do not matter.
_SOLVER = optx.LevenbergMarquardt(rtol=1e-12, atol=1e-12)
#: So many rejected steps in a row mean that rounding, not the model, is what is left.
_MOST_REJECTED = 12


def _with_aux(residual: Residual) -> Callable[[Any, Any], tuple[Any, None]]:
    return lambda z, args: (residual(z, args), None)


@eqx.filter_jit
def _begin(residual: Residual, z: Any, args: Any) -> Any:
    shape = eqx.filter_eval_shape(residual, z, args)
    return _SOLVER.init(_with_aux(residual), z, args, {}, shape, None, frozenset())


@eqx.filter_jit
def _advance(residual: Residual, z: Any, args: Any, state: Any) -> tuple[Any, ...]:
    """One evaluation, at the trial point; accept or reject it, and propose the next."""
    before = state.num_accepted_steps
    z, state, _ = _SOLVER.step(_with_aux(residual), z, args, {}, state, frozenset())
    value, slope = state.f_info.residual, state.f_info.jac.as_matrix()
    basis, _ = jnp.linalg.qr(slope / jnp.maximum(jnp.linalg.norm(slope, axis=0), 1e-300))
    decrement = jnp.sum((basis.T @ value) ** 2)
    stalled = state.num_steps_since_acceptance > _MOST_REJECTED
    return z, state, state.num_accepted_steps > before, jnp.sum(value**2), decrement, stalled


def adam(
    residual: Residual,
    start: FloatArray,
    args: Any,
    *,
    learning_rate: float = 0.001,
    steps: int = 1500,
    progress: Progress = silent,
) -> Trace:
    """Minimise the mean squared residual by Adam (Kingma & Ba 2015), the paper's optimiser, full batch.

    The cost is divided by its start value, so that a step means the same whatever the noise.
    """
    optimiser = optax.adam(learning_rate)
    z = jnp.asarray(start, dtype=float)
    state = optimiser.init(z)
    costs, path = [], []
    for iteration in range(1, steps + 1):
        costs_now, z_next, state = _adam_step(residual, z, args, state, learning_rate)
        costs.append(float(costs_now))
        path.append(np.asarray(z))
        z = z_next
        progress(iteration, steps, costs[-1])
    return Trace("adam", True, f"{steps} steps", tuple(costs), np.array(path))


@eqx.filter_jit
def _adam_step(residual: Residual, z: Any, args: Any, state: Any, learning_rate: Any) -> tuple[Any, Any, Any]:
    value = residual(z, args)
    _, pull = jax.vjp(lambda y: residual(y, args), z)
    (gradient,) = pull(2.0 * value)
    update, state = optax.adam(learning_rate).update(gradient, state, z)
    return jnp.sum(value**2), optax.apply_updates(z, update), state
