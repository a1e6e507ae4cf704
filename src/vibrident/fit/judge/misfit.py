"""Sentences on a model that does not explain the data, or that cannot be tested."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vibrident.base.amounts import plain
from vibrident.data.records import FloatArray
from vibrident.fit.response.verdict import as_chi2, only_one_is_far
from vibrident.fit.uncertainty.adequacy import Adequacy, Points

if TYPE_CHECKING:
    from vibrident.fit.decay.deviations import DecayDeviation


def describe_misfit(
    adequacy: Adequacy, points: list[Points], response: Any, decays: Sequence[DecayDeviation] = ()
) -> str:
    """Return the sentence on an inadequate model."""
    if not points:
        return (
            "It cannot be tested whether the model explains the data: in no band does the response "
            "exceed the residual. The records are too short for a test, or noise and misfit are "
            "too large."
        )
    if adequacy.degrees_of_freedom <= 0:
        equations = 2 * len(adequacy.frequency_hz)
        return describe_no_freedom(equations, equations - adequacy.degrees_of_freedom, "data")
    chi2 = adequacy.chi2_reduced or 0.0
    squares = np.concatenate([group.squares for group in points])
    index = int(np.argmax(squares))
    squares_as_chi2 = as_chi2(squares, np.concatenate([group.freedom for group in points]))
    if only_one_is_far(squares_as_chi2, adequacy.degrees_of_freedom, adequacy.decays):
        return describe_furthest(adequacy, squares_as_chi2, chi2)
    hz = adequacy.frequency_hz[index : index + 1]
    difference_percent = 100 * abs(response(hz)[0] / adequacy.measured[index] - 1.0)
    worst = (
        f", most at {hz[0]:.4g} Hz, where model and measurement differ by "
        f"{difference_percent:.2g} %"
    )
    worst_decay = max(decays, key=lambda decay: decay.parts.chi2, default=None)
    if worst_decay is not None and worst_decay.parts.chi2 > squares[index]:
        worst = f"; most in a free decay: {worst_decay.words}"
    return (
        "The model does not explain the data: deviations at the excited frequencies are "
        f"{plain(chi2**0.5, 3)} times what the noise explains "
        f"(χ²/dof = {plain(chi2, 4)}, {adequacy.degrees_of_freedom} degrees of freedom){worst}."
    )


def describe_furthest(adequacy: Adequacy, points: FloatArray, chi2_reduced: float) -> str:
    """Return the sentence on a model that is rejected at one frequency alone.

    Args:
        adequacy: of the model.
        points: χ² of two degrees of freedom of each frequency, shape (n,).
        chi2_reduced: χ²/ν of all.
    """
    index = int(np.argmax(points))
    return (
        f"The model does not explain the data at {adequacy.frequency_hz[index]:.4g} Hz: it is "
        f"{plain(float(points[index]) ** 0.5, 3)} standard deviations off there. At all "
        "frequencies together it is no further off than noise makes it "
        f"(χ²/dof = {plain(chi2_reduced, 4)}, {adequacy.degrees_of_freedom} degrees of freedom)."
    )


def describe_no_freedom(equations: int, parameters: int, what: str) -> str:
    """Return the sentence on a model with too many parameters for these equations to be tested."""
    return (
        f"It cannot be tested whether the model explains the {what}: {parameters} parameters meet "
        f"{equations} measured values, and none is left to judge by. Measure at more frequencies, "
        "or take a model with fewer parameters."
    )
