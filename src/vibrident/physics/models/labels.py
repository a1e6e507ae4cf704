"""Assignment of labels to poles, where several sets of parameters give the same response.

The response does not show which of two modes is the first, or which of three real poles belongs to
a high-pass. Every estimate is brought to one form:

- damping ratios are not negative;
- where an add-on states :class:`vibrident.physics.models.base.Labels` (two modes, a high-pass
  behind real poles), the form that they call in order. Of several such add-ons the first decides:
  beside a second mode the poles of a high-pass cannot be exchanged.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.physics.models.base import Labels, Relabelling
from vibrident.physics.models.sensor_model import SensorModel

#: Step of the complex-step derivative: no difference is taken, so nothing is lost.
_IMAGINARY_STEP = 1e-30


def labels_of(model: SensorModel) -> Labels | None:
    """Return the rule that labels the parts of a model, or None where none is needed."""
    if not model.is_linear:
        return None
    return next((addon.labels for addon in model.add_ons if addon.labels is not None), None)


def relabellings(model: SensorModel, values: Mapping[str, float]) -> tuple[Relabelling, ...]:
    """Return all other assignments of a sensor's poles that give the same response."""
    labels = labels_of(model)
    return () if labels is None else labels.alternatives(model.core, values)


def rule(model: SensorModel, values: Mapping[str, float]) -> Relabelling | None:
    """Return the relabelling that brings these values to the one form; None where they have it."""
    labels = labels_of(model)
    alternatives = relabellings(model, values)
    if labels is None or not alternatives:
        return None
    change = alternatives[0]
    return None if labels.in_order(values, change(values)) else change


def canonical(model: SensorModel, values: Mapping[str, float]) -> dict[str, float]:
    """Return the values in the one form."""
    positive = with_positive_damping(model, values)
    change = rule(model, positive)
    if change is None:
        return positive
    return {name: float(value) for name, value in change(positive).items()}


def with_positive_damping(model: SensorModel, values: Mapping[str, float]) -> dict[str, float]:
    """Return the values with damping ratios that are not negative."""
    positive = {spec.name for spec in model.parameters if spec.kind == "positive"}
    return {name: abs(value) if name in positive else value for name, value in values.items()}


def slopes(model: SensorModel, change: Relabelling, values: Mapping[str, float]) -> FloatArray:
    """Return ∂(new values)/∂(values) of a relabelling, exact to rounding, shape (p, p).

    Rows and columns are in the model's order.
    """
    names = model.parameter_names
    matrix = np.empty((len(names), len(names)))
    for column, name in enumerate(names):
        moved = change({**values, name: complex(values[name], _IMAGINARY_STEP)})
        matrix[:, column] = [complex(moved[row]).imag / _IMAGINARY_STEP for row in names]
    return matrix
