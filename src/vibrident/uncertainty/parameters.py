"""Parameters with standard uncertainty and 95 % interval, estimated and derived.

The covariance of the coordinates z is exact to first order (GUM 5.2); intervals are taken in z, where the problem
is most nearly linear, with Student's t, and carried over: a natural frequency's interval is symmetric in its
logarithm, a damping ratio's ends at zero. Derived quantities are propagated by the complex-step derivative.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Set

import numpy as np

from vibrident.models import Derived, SensorModel
from vibrident.models.slopes import STEP
from vibrident.problem import Coordinates
from vibrident.records import Calibration, FloatArray
from vibrident.result import Correlation, Parameter
from vibrident.tails import student_quantile
from vibrident.uncertainty.identifiability import NOTHING, unstated

COVERAGE = 0.95


def coverage_factor(degrees_of_freedom: float) -> float:
    """K of a 95 % interval: Student's t at these degrees of freedom, 1.96 for infinitely many (GUM G.3)."""
    finite = min(degrees_of_freedom, 1e9)
    return student_quantile(finite, 0.5 + COVERAGE / 2)


def with_reference(covariance: FloatArray, z: FloatArray, model: SensorModel, relative: float) -> FloatArray:
    """Covariance of z with the reference's own calibration in it: a common factor on the gain, type B."""
    if relative == 0.0:
        return covariance
    direction = reference_direction(z, model, relative)
    return covariance + np.outer(direction, direction)


def reference_direction(z: FloatArray, model: SensorModel, relative: float) -> FloatArray:
    """What a relative change of the whole response does to z, shape (p,)."""
    index = model.parameter_names.index(model.gain_name)
    direction = np.zeros_like(z)
    direction[index] = z[index] * relative
    return direction


def parameter_table(
    coordinates: Coordinates,
    z: FloatArray,
    covariance: FloatArray,
    degrees_of_freedom: float,
    units: Mapping[str, str],
    doubtful: Mapping[str, str],
) -> dict[str, Parameter]:
    """Every estimated and derived parameter.

    Args:
        coordinates: the map from z to parameters.
        z: the optimum, shape (p,).
        covariance: of z, shape (p, p).
        degrees_of_freedom: of the noise estimate.
        units: fields of the units' templates.
        doubtful: names of parameters that are not identifiable.
    """
    model = coordinates.model
    k = coverage_factor(degrees_of_freedom)
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    change = coordinates.slopes(z)
    unknown = unstated(coordinates, z, covariance)
    table = {}
    for index, spec in enumerate(model.parameters):
        low, high = _interval(coordinates, z, index, k * deviation[index])
        slope = 1.0 if spec.kind == "positive" else abs(change[index])  # at zero too, where it is reflected
        known = spec.name not in unknown
        table[spec.name] = Parameter(
            value=coordinates.values(z)[spec.name],
            unit=_unit(spec.unit, units),
            standard_uncertainty=float(slope * deviation[index]) if known else None,
            interval_95=(float(low), float(high)) if known else (None, None),
            identifiable=known and spec.name not in doubtful,
        )
    table.update(_derived(coordinates, z, covariance, k, units, {**doubtful, **dict.fromkeys(unknown, "")}, unknown))
    return table


def _interval(coordinates: Coordinates, z: FloatArray, index: int, half: float) -> tuple[float, float]:
    name, kind = coordinates.model.parameters[index].name, coordinates.model.parameters[index].kind
    if kind == "positive":
        centre = abs(float(z[index]))
        return max(0.0, centre - half), centre + half
    ends = []
    for sign in (-1.0, 1.0):
        moved = np.array(z)
        moved[index] += sign * half
        with np.errstate(over="ignore"):  # an interval without end stops at the range searched
            ends.append(coordinates.values(moved)[name])
    return min(ends), max(ends)


def _derived(
    coordinates: Coordinates,
    z: FloatArray,
    covariance: FloatArray,
    k: float,
    units: Mapping[str, str],
    doubtful: Mapping[str, str],
    unknown: Set[str],
) -> dict[str, Parameter]:
    table = {}
    quantities = coordinates.model.derived(coordinates.values(z))
    for quantity in quantities:
        value, slope = _value_and_slope(coordinates, z, quantity)
        u = float(np.sqrt(max(slope @ covariance @ slope, 0.0)))
        relative = u / abs(value) if value else 0.0
        if not quantity.positive or relative > 0.5:
            interval = (value - k * u, value + k * u)
        else:  # positive: symmetric in the logarithm, as the natural frequency's
            interval = (value * np.exp(-k * relative), value * np.exp(k * relative))
        needed = set(quantity.needs)
        known = not needed & set(unknown) and relative <= NOTHING
        table[quantity.name] = Parameter(
            value=value,
            unit=_unit(quantity.unit, units),
            standard_uncertainty=u if known else None,
            interval_95=(float(interval[0]), float(interval[1])) if known else (None, None),
            identifiable=not needed & set(doubtful),
            derived=True,
        )
    return table


def _value_and_slope(coordinates: Coordinates, z: FloatArray, quantity: Derived) -> tuple[float, FloatArray]:
    """A derived quantity and its slopes in z, shape (p,)."""
    values = coordinates.values(z)
    slopes = [
        complex(quantity.value({**values, name: complex(value, STEP * (abs(value) or 1.0))})).imag
        / (STEP * (abs(value) or 1.0))
        for name, value in values.items()
    ]
    return float(quantity.value(values)), np.array(slopes) * coordinates.slopes(z)


def correlation(model: SensorModel, covariance: FloatArray) -> Correlation:
    """Correlation matrix of the estimated parameters; one on the diagonal, also where a variance is zero."""
    deviation = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    safe = np.where(deviation > 0, deviation, 1.0)
    matrix = np.clip(covariance / np.outer(safe, safe), -1.0, 1.0)
    np.fill_diagonal(matrix, 1.0)
    return Correlation(model.parameter_names, tuple(tuple(float(v) for v in row) for row in matrix))


def parameter_units(model: SensorModel, calibration: Calibration) -> dict[str, str]:
    """Unit of each estimated parameter."""
    fields = unit_fields(calibration)
    return {spec.name: _unit(spec.unit, fields) for spec in model.parameters}


def _unit(template: str, fields: Mapping[str, str]) -> str:
    """A unit from its template; brackets around a single unit are removed: V/(A) is V/A."""
    return re.sub(r"\(([^()/*· ]+)\)", r"\1", template.format(**fields))


def unit_fields(calibration: Calibration) -> dict[str, str]:
    """What the models' unit templates are filled with."""
    drive = calibration.quantity == "drive"
    return fields_of_units(calibration.response_unit, calibration.reference_unit if drive else "m/s^2", drive=drive)


def fields_of_units(response: str, reference: str, *, drive: bool) -> dict[str, str]:
    """The same from the units: of the response, and of what the sensitivity is per.

    ``response``: unit of the response; ``reference``: of the drive, or of acceleration; ``drive``: whether the
    reference is a drive, whose integral has no separate unit.
    """
    return {
        "response": response,
        "reference": reference,
        "reference_integrated": f"{reference} s" if drive else "m/s",
        "conversion": f"{response}/(({reference}) s^2)" if drive else f"{response}/m",
    }
