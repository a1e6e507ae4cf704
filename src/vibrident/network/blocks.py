"""Lanes of long records taken in blocks, one after another, so that what a block needs is forgotten with it.

The network's inputs are q numbers a sample, and their derivatives many more: for millions of samples that is most of
the memory of an identification. In blocks of a few hundred lanes only sums over the lanes, and what is small, is kept.
The inputs themselves need not be held either: each is a weighted sum of the reference's samples around the step
(:mod:`vibrident.discretize.inputs`), and a product with a matrix makes them when a block is run.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from vibrident.backend import jax, jnp, lax

#: Steps whose inputs one product with a matrix makes; the matrix has that many zeros beside each filter.
STEPS_AT_ONCE = 32


class Windows(NamedTuple):
    """The reference around the steps of every lane, in place of the inputs made from it.

    Attributes:
        samples: from the first that a lane's first step needs to the last that its last step needs, shape
            (L + K − 1, M).
        filters: weights of the K samples in each of the q inputs, shape (F, q, K).
        which: filter of each lane, shape (M,), int.
    """

    samples: Any
    filters: Any
    which: Any


def step_inputs(inputs: Any) -> Any:
    """Inputs of every step, shape (L, q, M), from themselves or from ``Windows``."""
    if not isinstance(inputs, Windows):
        return inputs
    sets, terms, taps = inputs.filters.shape
    length = inputs.samples.shape[0] - taps + 1
    total = 0.0
    for number in range(sets):
        made = [
            _filtered(inputs.filters[number], inputs.samples[k : min(k + STEPS_AT_ONCE, length) + taps - 1])
            for k in range(0, length, STEPS_AT_ONCE)
        ]
        joined = jnp.concatenate(made).reshape(length, terms, -1)
        total = joined if sets == 1 else total + jnp.where(inputs.which == number, joined, 0.0)
    return total


def _filtered(filters: Any, samples: Any) -> Any:
    """Σ_i filters[j, i] samples[k + i] for every step k; (q, K) and (steps + K − 1, M) → (steps · q, M)."""
    terms, taps = filters.shape
    steps = samples.shape[0] - taps + 1
    place = jnp.arange(samples.shape[0]) - jnp.arange(steps)[:, None]  # of a sample in the filter of a step
    inside = (place >= 0) & (place < taps)
    rows = jnp.where(inside, filters[:, jnp.clip(place, 0, taps - 1)], 0.0)  # (q, steps, samples)
    return jnp.moveaxis(rows, 0, 1).reshape(steps * terms, -1) @ samples


def over_blocks(step: Callable[..., tuple[Any, Any]], carry: Any, lanes: Any, others: Any, blocks: int) -> Any:
    """Run ``step`` over blocks of lanes in order; all at once where there is one.

    Args:
        step: (carry, lanes of the block, others of the block) → carry, arrays whose last axis is the block's lanes.
        carry: what is handed from block to block.
        lanes: :class:`vibrident.network.unroll.Lanes`.
        others: arrays whose last axis is that of the lanes, M.
        blocks: a divisor of M.

    Returns:
        The last carry, and the arrays of all blocks, joined along their last axis.
    """
    if blocks == 1:
        return step(carry, lanes, others)
    count = lanes.first.shape[0]
    size = count // blocks
    filters = lanes.inputs.filters if isinstance(lanes.inputs, Windows) else None  # they are those of all lanes
    if filters is not None:
        lanes = lanes._replace(inputs=lanes.inputs._replace(filters=None))

    def cut(values: Any, number: Any) -> Any:
        return lax.dynamic_slice_in_dim(values, number * size, size, axis=values.ndim - 1)

    def block(number: Any) -> Any:
        here = jax.tree.map(lambda values: cut(values, number), lanes)
        if filters is not None:
            here = here._replace(inputs=here.inputs._replace(filters=filters))
        return here, jax.tree.map(lambda values: cut(values, number), others)

    def body(number: Any, state: Any) -> Any:
        carry, joined = state
        carry, found = step(carry, *block(number))
        return carry, jax.tree.map(
            lambda whole, part: lax.dynamic_update_slice_in_dim(whole, part, number * size, axis=whole.ndim - 1),
            joined,
            found,
        )

    shapes = jax.eval_shape(lambda: step(carry, *block(0))[1])
    joined = jax.tree.map(lambda part: jnp.zeros((*part.shape[:-1], count), part.dtype), shapes)
    return lax.fori_loop(0, blocks, body, (carry, joined))
