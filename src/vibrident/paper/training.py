"""Training in mini-batches by Adam (Kingma & Ba 2015), with a stated early-stopping rule.

After every epoch the loss on held-back windows is evaluated. Training ends when the best of them
has not fallen by ``least_gain`` of itself for ``patience`` epochs, and the weights of the best
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
    """Train the inexact arrays of ``model``, any pytree, on windows.

    ``windows``: a pytree of arrays with a common leading axis; ``loss``: (model, batch) → mean
    squared error, a batch being ``windows`` with the leading axis cut down; ``held_back``: windows
    that are never trained on; ``rng``: of the shuffling; ``few``: the model is one array of few
    numbers, for which forward derivatives are cheaper than reverse ones; ``progress``: called after
    each epoch.
    """
    moving, fixed = eqx.partition(model, eqx.is_inexact_array)
    optimiser = optax.adam(schedule.learning_rate)
    windows, held_back = jax.device_put((windows, held_back))
    count = jax.tree.leaves(windows)[0].shape[0]
    batch = min(schedule.batch, count)

    def cost(moving: Any, batch: Any) -> Any:
        return loss(eqx.combine(moving, fixed), batch)

    value_and_slope = _forwards(cost) if few else jax.value_and_grad(cost)

    @jax.jit
    def epoch(moving: Any, state: Any, windows: Any, order: Any) -> tuple[Any, Any, Any]:
        def step(carry: Any, batch: Any) -> tuple[Any, Any]:
            moving, state = carry
            value, slope = value_and_slope(moving, jax.tree.map(lambda a: a[batch], windows))
            change, state = optimiser.update(slope, state, moving)
            return (optax.apply_updates(moving, change), state), value

        (moving, state), values = lax.scan(step, (moving, state), order)
        return moving, state, jnp.mean(values)

    judge = jax.jit(cost)
    state = optimiser.init(moving)
    best = moving
    least = float(judge(moving, held_back))
    training = []
    waited = 0
    converged = False
    for number in range(1, schedule.most_epochs + 1):
        order = rng.permutation(count)[: count // batch * batch].reshape(-1, batch)
        moving, state, value = epoch(moving, state, windows, order)
        training.append(float(value))
        judged = float(judge(moving, held_back))
        waited = 0 if judged < (1.0 - schedule.least_gain) * least else waited + 1
        if waited == 0:
            best = moving
            least = judged
        progress(number, schedule.most_epochs, judged)
        if waited >= schedule.patience:
            converged = True
            break
    return TrainingOutcome(eqx.combine(best, fixed), tuple(training), converged)


def _forwards(cost: Loss) -> Callable[[Any, Any], tuple[Any, Any]]:
    def value_and_slope(moving: Any, batch: Any) -> tuple[Any, Any]:
        slope, value = jax.jacfwd(lambda z: (cost(z, batch),) * 2, has_aux=True)(moving)
        return value, slope

    return value_and_slope
