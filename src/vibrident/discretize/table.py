"""The identified weights in the form of the paper's Table 1."""

from __future__ import annotations

from typing import Any

import numpy as np

from vibrident.discretize import Weights

MEANING = {
    "W1": ("input → hidden", "Γ (Euler: Ts B)"),
    "W2": ("hidden → output", "C Φ⁻¹ (Euler: C (I + Ts A)⁻¹)"),
    "W3": ("feedback hidden → hidden", "Φ (Euler: I + Ts A)"),
    "W4": ("feedforward input → output", "D − C Φ⁻¹ Γ (Euler: D − C (I + Ts A)⁻¹ Ts B)"),
}


def weight_table(weights: Weights, state_scaling: Any | None = None) -> dict[str, dict[str, Any]]:
    """W1…W4 with layer and meaning, as plain lists.

    ``weights``: one set of weights (no leading axis); ``state_scaling``: factors to the paper's states V, V̇, …, shape
    (n,), from :func:`vibrident.models.state_space.state_scaling`; None leaves the states as they are.
    """
    t = np.ones(np.shape(weights.output)[0]) if state_scaling is None else np.asarray(state_scaling)
    physical = Weights(
        transition=np.asarray(weights.transition) * t[:, None] / t[None, :],
        drive=np.asarray(weights.drive) * t[:, None],
        output=np.asarray(weights.output) / t,
        feedthrough=np.asarray(weights.feedthrough),
    )
    table = physical.table()
    return {
        name: {"layer": layer, "meaning": meaning, "value": np.asarray(table[name]).tolist()}
        for name, (layer, meaning) in MEANING.items()
    }
