"""The network unrolled over many steps, of NumPy arrays: x_{k+1} = Φ x_k + Γ c_k, y_k = C x_k + D c_k.

A linear recursion splits: chunks of steps run side by side from a zero state, then the state is passed on from chunk
to chunk. The outcome is the recursion's own to rounding. :mod:`vibrident.network.unroll` does the same where a compiler
and derivatives are wanted.
"""

from __future__ import annotations

import math

import numpy as np

from vibrident.discretize.weights import Weights
from vibrident.records import FloatArray


def respond(weights: Weights, inputs: FloatArray, state: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Response to inputs of shape (steps, q) from a state of shape (n,): shape (steps,), and the state behind it."""
    steps, order = len(inputs), len(weights.output)
    length = max(math.isqrt(steps), 1)
    count = -(-steps // length)
    drive = np.zeros((count * length, order))
    drive[:steps] = inputs @ weights.drive.T
    chunks = drive.reshape(count, length, order)
    moving, output = np.zeros((count, order)), np.empty((count, length))
    for k in range(length):
        output[:, k] = moving @ weights.output
        moving = moving @ weights.transition.T + chunks[:, k]
    rows, power = free_rows(weights, length)
    starts, own = np.empty((count, order)), state
    for chunk, end in enumerate(moving):
        starts[chunk] = own
        own = power @ own + end
    output += starts @ rows.T
    # Behind the last step there may be padding, through which the state would go on.
    rest = steps - (count - 1) * length
    behind = starts[-1]
    for k in range(rest):
        behind = weights.transition @ behind + chunks[-1, k]
    return output.reshape(-1)[:steps] + inputs @ weights.feedthrough, behind


def free_rows(weights: Weights, steps: int) -> tuple[FloatArray, FloatArray]:
    """C Φ^k for k < steps, shape (steps, n), and Φ^steps, shape (n, n)."""
    rows, power = np.asarray(weights.output)[None, :], np.asarray(weights.transition)
    while len(rows) < steps:
        rows, power = np.concatenate([rows, rows @ power]), power @ power
    return rows[:steps], np.linalg.matrix_power(weights.transition, steps)
