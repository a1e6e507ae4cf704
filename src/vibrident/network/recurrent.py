"""GRU and LSTM: the networks without physics that the paper compares with (its Table 3: hidden 16, tanh, no bias).

    GRU   Cho et al. 2014, doi:10.3115/v1/D14-1179
    LSTM  Hochreiter & Schmidhuber 1997, doi:10.1162/neco.1997.9.8.1735

The cells are equinox's; a linear layer without bias reads the output from the hidden state. They compute in float32, as
is usual for such networks; their errors are far larger.
"""

from __future__ import annotations

from typing import Any, Literal

import equinox as eqx

from vibrident.backend import jax, jnp, lax

Kind = Literal["gru", "lstm"]
#: Unrolled steps in a body of the scan: more takes longer to compile and runs no faster.
_UNROLL = {"gru": 4, "lstm": 1}


class Recurrent(eqx.Module):
    """One recurrent layer and a linear read-out, neither with a bias.

    Attributes:
        cell: equinox's cell for one step.
        readout: hidden state → output, shape (hidden,).
        kind: ``gru`` or ``lstm``.
    """

    cell: Any
    readout: Any
    kind: Kind = eqx.field(static=True)

    def __init__(self, kind: Kind, *, hidden: int = 16, seed: int = 0) -> None:
        for_cell, for_readout = jax.random.split(jax.random.key(seed))
        make = {"gru": eqx.nn.GRUCell, "lstm": eqx.nn.LSTMCell}[kind]
        self.cell = make(1, hidden, use_bias=False, dtype=jnp.float32, key=for_cell)
        bound = hidden**-0.5
        self.readout = jax.random.uniform(for_readout, (hidden,), jnp.float32, -bound, bound)
        self.kind = kind

    @property
    def weights(self) -> int:
        """Number of weights that training moves."""
        return sum(leaf.size for leaf in jax.tree.leaves(eqx.filter(self, eqx.is_inexact_array)))

    def __call__(self, inputs: Any) -> Any:
        """Outputs, shape (steps, batch), for inputs of the same shape; the hidden state is zero at the first step."""
        rest = jnp.zeros((inputs.shape[1], self.readout.shape[0]), jnp.float32)
        start = (rest, rest) if self.kind == "lstm" else rest

        def step(state: Any, value: Any) -> tuple[Any, Any]:
            state = jax.vmap(self.cell)(value[:, None], state)
            return state, (state[0] if self.kind == "lstm" else state) @ self.readout

        _, outputs = lax.scan(step, start, inputs.astype(jnp.float32), unroll=_UNROLL[self.kind])
        return outputs
