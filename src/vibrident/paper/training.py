"""Train networks in mini-batches by Adam (Kingma & Ba 2015), with a stated early-stopping rule.

After every epoch the loss on held-back windows is evaluated. Training ends when the least of these
losses has not fallen by ``least_gain`` of itself for ``patience`` epochs; the weights of the best
epoch are kept.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibrident.base.backend import equinox as eqx
from vibrident.base.backend import jax, jnp, lax, optax
from vibrident.fit.optimise import Progress, silent

Loss = Callable[[Any, Any], Any]


@dataclass(frozen=True)
class Schedule:
    """Duration and rates of training.

    Attributes:
        learning_rate: of Adam.
        batch: windows a step; the last, smaller batch of an epoch is left to the next shuffle.
        patience: epochs without a gain after which training ends.
        least_gain: relative fall of the held-back loss that counts as a gain.
        most_epochs: limit.
    """

    learning_rate: float = 0.001
    batch: int = 36
    patience: int = 30
    least_gain: float = 0.01
    most_epochs: int = 400

    @property
    def rule(self) -> str:
        """Return the early-stopping rule in words."""
        return (
            "until the loss on the held-back windows has not fallen by "
            f"{100 * self.least_gain:g} % for {self.patience} epochs, "
            f"at most {self.most_epochs} epochs; the best epoch's weights are kept"
        )


@dataclass(frozen=True, eq=False)
class TrainingOutcome:
    """Outcome of training.

    Attributes:
        model: with the best epoch's weights.
        training: mean loss of each epoch.
        converged: False if the limit of epochs ended it.
    """

    model: Any
    training: tuple[float, ...]
    converged: bool


@dataclass(frozen=True, eq=False)
class TrainedSensor:
    """Trained parameters of a sensor, and the training.

    Attributes:
        weights: all trained numbers, including the sensor's parameters.
    """

    parameters: dict[str, float]
    weights: int
    trained: TrainingOutcome


def train(
    model: Any,
    loss: Loss,
    windows: Any,
    held_back: Any,
    schedule: Schedule,
    *,
    rng: np.random.Generator,
    few: bool = False,
    progress: Progress = silent,
) -> TrainingOutcome:
    """Train the inexact arrays of a model on windows.

    Args:
        model: any pytree.
        loss: (model, batch) → mean squared error; a batch is ``windows`` with a shorter leading
            axis.
        windows: a pytree of arrays with a common leading axis.
        held_back: windows that are never trained on.
        schedule: duration and rates.
        rng: of the shuffling.
        few: whether the model is one array of few numbers, for which forward derivatives are
            cheaper than reverse ones.
        progress: called after each epoch.
    """
    weights, fixed = eqx.partition(model, eqx.is_inexact_array)
    optimiser = optax.adam(schedule.learning_rate)
    windows, held_back = jax.device_put((windows, held_back))
    count = jax.tree.leaves(windows)[0].shape[0]
    batch = min(schedule.batch, count)

    def cost(weights: Any, batch: Any) -> Any:
        return loss(eqx.combine(weights, fixed), batch)

    value_and_gradient = _forward_gradient(cost) if few else jax.value_and_grad(cost)

    @jax.jit
    def run_epoch(weights: Any, state: Any, windows: Any, order: Any) -> tuple[Any, Any, Any]:
        def step(carry: Any, indices: Any) -> tuple[Any, Any]:
            weights, state = carry
            batch = jax.tree.map(lambda array: array[indices], windows)
            value, gradient = value_and_gradient(weights, batch)
            update, state = optimiser.update(gradient, state, weights)
            return (optax.apply_updates(weights, update), state), value

        (weights, state), values = lax.scan(step, (weights, state), order)
        return weights, state, jnp.mean(values)

    held_back_cost = jax.jit(cost)
    state = optimiser.init(weights)
    best = weights
    least = float(held_back_cost(weights, held_back))
    training = []
    epochs_without_gain = 0
    converged = False
    for epoch in range(1, schedule.most_epochs + 1):
        order = rng.permutation(count)[: count // batch * batch].reshape(-1, batch)
        weights, state, value = run_epoch(weights, state, windows, order)
        training.append(float(value))
        current = float(held_back_cost(weights, held_back))
        epochs_without_gain += 1
        if current < (1.0 - schedule.least_gain) * least:
            best = weights
            least = current
            epochs_without_gain = 0
        progress(epoch, schedule.most_epochs, current)
        if epochs_without_gain >= schedule.patience:
            converged = True
            break
    return TrainingOutcome(eqx.combine(best, fixed), tuple(training), converged)


def _forward_gradient(cost: Loss) -> Callable[[Any, Any], tuple[Any, Any]]:
    """Return a function to the value and the gradient of a cost, by forward derivatives."""

    def value_and_gradient(weights: Any, batch: Any) -> tuple[Any, Any]:
        gradient, value = jax.jacfwd(lambda z: (cost(z, batch),) * 2, has_aux=True)(weights)
        return value, gradient

    return value_and_gradient
