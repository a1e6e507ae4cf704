"""The cell of the network: its neurons in one time step (paper, section 3 and Table 1).

    hidden   x_{k+1} = W3 x_k + W1 c_k          (feedback → hidden, input → hidden)
    output   y_k     = W2 x_{k+1} + W4 c_k      (hidden → output, feedforward → output)

No bias. For a second-order sensor and Euler's step: input 1, feedback 2, hidden 2, feedforward 1,
output 1. This module is the definition, sample after sample;
:mod:`vibrident.physics.network.unroll` computes the same in parallel chunks and is tested against
it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from vibrident.base.backend import jnp, lax
from vibrident.physics.discretisation.weights import Weights


class Cell(NamedTuple):
    """Weights of one layer, as in the paper's Table 1.

    Attributes:
        w1: input → hidden, shape (n, q).
        w2: hidden → output, shape (n,).
        w3: feedback → hidden, shape (n, n).
        w4: feedforward input → output, shape (q,).
        activation: of the hidden layer; None is the exact, linear network. ``jnp.tanh`` is the
            paper's option, which breaks the equivalence with the state equation.
    """

    w1: Any
    w2: Any
    w3: Any
    w4: Any
    activation: Any = None

    @classmethod
    def from_weights(cls, weights: Weights) -> Cell:
        """Return the cell of a discretised sensor."""
        table = weights.table()
        return cls(table["W1"], table["W2"], table["W3"], table["W4"])

    def __call__(self, state: Any, inputs: Any) -> tuple[Any, Any]:
        """Take one step: state (n,) and inputs (q,) → new state (n,) and output ().

        There is no batch axis; ``vmap`` adds one.
        """
        hidden = self.w3 @ state + self.w1 @ inputs
        if self.activation is not None:
            hidden = self.activation(hidden)
        return hidden, self.w2 @ hidden + self.w4 @ inputs


def run(cell: Cell, inputs: Any, initial_state: Any | None = None) -> Any:
    """Run the cell over all steps: inputs (steps, q) → outputs (steps,).

    ``initial_state``: shape (n,); zero by default.
    """
    state = jnp.zeros(cell.w2.shape[0]) if initial_state is None else initial_state
    _, outputs = lax.scan(lambda hidden, u: cell(hidden, u), state, inputs)
    return outputs
