"""Inputs of a plan, checked: sensor, reference, frequencies and number of points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vibrident.base.errors import InputError, unknown
from vibrident.base.fields import NamedNumbers
from vibrident.data.records import QUANTITIES, FloatArray, Quantity
from vibrident.physics.models import parse
from vibrident.physics.models.sensor_model import SensorModel
from vibrident.result import Result
from vibrident.use.planning.points import PlannedPoints


def model_and_values(
    sensor: str | Result, parameters: NamedNumbers | None
) -> tuple[SensorModel, NamedNumbers]:
    """Return the model of a plan, and its parameter values.

    Raises:
        InputError: the values are not those of the model, or the model is not linear.
    """
    if isinstance(sensor, Result) and parameters is None:
        sensor.require_linear()
        identified = sensor.to_sensor("a plan")
        return identified.model, dict(identified.values)
    name = sensor.model if isinstance(sensor, Result) else sensor
    model = parse(name)
    numbers = dict(parameters or {})
    names = model.parameter_names
    linear = model.is_linear
    usable = set(numbers) == set(names) and all(np.isfinite(value) for value in numbers.values())
    positive = usable and all(
        numbers[s.name] > 0 for s in model.parameters if s.kind in ("log", "duration")
    )
    if not (linear and positive and numbers[model.gain_name] != 0):
        raise InputError(
            "The sensor cannot be planned for."
            if linear
            else "A nonlinear sensor has no transfer function to plan with.",
            expected=(
                f"for {model.name!r}: finite {', '.join(names)}; frequencies above 0, a gain that "
                "is not 0"
            ),
            found=", ".join(f"{key} = {value:g}" for key, value in numbers.items())
            or "no parameters",
            where="⟦plan.parameters⟧",
            remedy="give every parameter of the model, and no other"
            if linear
            else "plan without 'cubic'",
        )
    return model, {name: float(numbers[name]) for name in names}


def reference_quantity(quantity: Quantity | None, source: Result | None) -> Quantity:
    """Return the quantity of the reference: as stated, or as of the result."""
    name: Any = (
        quantity
        or (source.reference.get("quantity") if source is not None else None)
        or "acceleration"
    )
    if name not in QUANTITIES:
        raise unknown("The reference quantity is not known.", name, QUANTITIES, "⟦plan.quantity⟧")
    return name


def planned_frequencies(
    given_hz: Sequence[float] | FloatArray | None, source: Result | None
) -> FloatArray:
    """Return the planned frequencies in ascending order, Hz, shape (n,)."""
    if given_hz is None and source is not None:
        given_hz = np.unique(source.measured.frequency_hz)
    frequency = np.atleast_1d(np.asarray([] if given_hz is None else given_hz, dtype=float))
    if not (
        frequency.ndim == 1
        and frequency.size
        and np.isfinite(frequency).all()
        and (frequency > 0).all()
    ):
        raise InputError(
            "There are no frequencies to plan with.",
            expected="at least one finite frequency above 0 Hz",
            found=f"{frequency.tolist()}"[:80],
            where="⟦plan.frequencies_hz⟧",
            remedy="give frequencies, or a result that has measured points",
        )
    return np.sort(frequency)


def one_a_frequency(
    label: str, value: float | Sequence[float], frequency: FloatArray
) -> FloatArray:
    """Return a setting with one value for each frequency, shape (n,)."""
    values = np.asarray(value, dtype=float)
    if values.ndim > 1 or (values.ndim == 1 and values.size != frequency.size):
        raise InputError(
            f"The {label} does not fit the frequencies.",
            expected=f"one number, or {frequency.size}, in ascending order of frequency",
            found=f"shape {values.shape}",
            where=f"plan, {label}",
            remedy="give one number, or one a frequency",
        )
    return np.broadcast_to(values, frequency.shape).astype(float)


def require_points(points: PlannedPoints, count: int, *, repeats: bool, is_best: bool) -> None:
    """Refuse a number of points that cannot determine the parameters."""
    needed = len(points.coordinates.model.parameters)
    most = points.subject.frequency_hz.size
    if count >= 1 and (repeats or count <= most) and count * points.equations >= needed:
        return
    raise InputError(
        "So many points cannot determine the parameters."
        if count <= most or repeats
        else "There are too few candidates.",
        expected=(
            f"at least {-(-needed // points.equations)} points for {needed} parameters, of {most} "
            "candidates"
        ),
        found=f"{count} points",
        where="⟦plan.best⟧" if is_best else "⟦plan.frequencies_hz⟧",
        remedy="choose another number, or give more frequencies",
    )
