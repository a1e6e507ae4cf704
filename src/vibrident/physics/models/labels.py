"""Assignment of labels to poles: parameters that give exactly the same response, and the rule that selects one.

The response does not show which of two modes is the first, or which of three real poles belongs to a high-pass. Every
estimate is brought to one form:

- damping ratios are not negative;
- where an add-on states :class:`vibrident.physics.models.base.Labels` (two modes, a high-pass behind real poles), the
  form that they call in order. Of several such add-ons the first decides: beside a second mode the poles of a high-pass
  cannot be exchanged.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.physics.models.base import Labels, Relabelling
from vibrident.physics.models.sensor_model import SensorModel

_STEP = 1e-30  # step of the complex-step derivative: no difference is taken, so nothing is lost


def labels_of(model: SensorModel) -> Labels | None:
    """What decides the labels of a model; None where nothing does."""
    if not model.is_linear:
        return None
    return next((addon.labels for addon in model.add_ons if addon.labels is not None), None)


def relabellings(model: SensorModel, values: Mapping[str, float]) -> tuple[Relabelling, ...]:
    """All other assignments of a sensor's poles that give the same response."""
    labels = labels_of(model)
    return () if labels is None else labels.others(model.core, values)


def rule(model: SensorModel, values: Mapping[str, float]) -> Relabelling | None:
    """The relabelling that brings these values to the one form; None where they have it."""
    labels, others = labels_of(model), relabellings(model, values)
    if labels is None or not others:
        return None
    return None if labels.in_order(values, others[0](values)) else others[0]


def canonical(model: SensorModel, values: Mapping[str, float]) -> dict[str, float]:
    """The values in the one form."""
    found = upright(model, values)
    change = rule(model, found)
    return found if change is None else {name: float(value) for name, value in change(found).items()}


def upright(model: SensorModel, values: Mapping[str, float]) -> dict[str, float]:
    """The values with damping ratios that are not negative."""
    positive = {spec.name for spec in model.parameters if spec.kind == "positive"}
    return {name: abs(value) if name in positive else value for name, value in values.items()}


def slopes(model: SensorModel, change: Relabelling, values: Mapping[str, float]) -> FloatArray:
    """∂(new values)/∂(values) of a relabelling, exact to rounding, shape (p, p), in the model's order."""
    names = model.parameter_names
    found = np.empty((len(names), len(names)))
    for column, name in enumerate(names):
        moved = change({**values, name: complex(values[name], _STEP)})
        found[:, column] = [complex(moved[row]).imag / _STEP for row in names]
    return found
