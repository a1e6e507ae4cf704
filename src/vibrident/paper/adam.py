"""The paper's way down a residual: Adam (optax), full batch, one step at a time."""

from __future__ import annotations

from typing import Any

import numpy as np

from vibrident.base.backend import jax, jnp, optax
from vibrident.base.participants import takes_part
from vibrident.data.records import FloatArray
from vibrident.fit.optimise import Objective, Progress, Trace, silent


def adam(
    objective: Objective,
    start: FloatArray,
    args: Any,
    *,
    learning_rate: float = 0.001,
    steps: int = 1500,
    progress: Progress = silent,
) -> Trace:
    """Minimise the squared residual by Adam (Kingma & Ba 2015).

    Adam's steps do not depend on the scale of the cost, so the mean and the sum of squares train
    alike.
    """
    takes_part("optax")
    z = jnp.asarray(start, dtype=float)
    state = optax.adam(learning_rate).init(z)
    costs = []
    path = []
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
