"""Parameters with standard uncertainty and 95 % interval, estimated and derived, and what the data do not determine.

The covariance of the coordinates z is exact to first order (GUM 5.2); intervals are taken in z, where the problem
is most nearly linear, with Student's t, and carried over: a natural frequency's interval is symmetric in its
logarithm, a damping ratio's ends at zero. Derived quantities are propagated by the complex-step derivative.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from vibrident.base.tails import student_quantile
from vibrident.data.records import Calibration, FloatArray
from vibrident.fit.problem import Coordinates
from vibrident.fit.problem.coordinates import ends_of
from vibrident.physics.models import Derived, SensorModel
from vibrident.physics.models.slopes import STEP, response_and_slopes
from vibrident.physics.naming import in_words
from vibrident.result import Correlation, Parameter, ResultWarning

WEAK = (
    0.1  # relative standard uncertainty (delay: rad at the highest frequency) of a weak parameter
)
NOTHING = 1e3  # beyond this relative standard uncertainty (delay: rad) nothing is known
COVERAGE = 0.95


def deviations(covariance: FloatArray) -> FloatArray:
    """Standard deviations of a covariance, shape (p,), none of them the root of a negative number."""
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))


def weakly_determined(
    coordinates: Coordinates, z: FloatArray, covariance: FloatArray
) -> tuple[dict[str, str], list[ResultWarning]]:
    """Names of parameters that are weakly determined (with the one each trades against), and the warnings.

    A parameter at a bound is reported as such.
    """
    model = coordinates.model
    correlations = _correlations(covariance)
    deviation = deviations(covariance)
    sizes = sizes_of(model, z)
    ended = at_end(coordinates, z)
    weak: dict[str, str] = {}
    warnings = []
    for index, spec in enumerate(model.parameters):
        # The logarithm's deviation is relative; a delay's is in radians at the highest frequency.
        size = deviation[index] / sizes[index]
        others = np.abs(np.delete(correlations[index], index))
        strongest = float(np.max(others, initial=0.0))
        # Fixing that other parameter would shrink it by five.
        trades = 1.0 / np.sqrt(max(1.0 - strongest**2, 1e-12)) > 5.0 and size > 0.1 * WEAK
        if size > NOTHING:
            weak[spec.name] = ""
            text = f"The data do not determine the {in_words(spec.name)}: no standard uncertainty can be stated."
            warnings.append(ResultWarning("weakly_determined", text))
        elif size > WEAK or trades:
            names = [name for name in model.parameter_names if name != spec.name]
            weak[spec.name] = partner = names[int(np.argmax(others))] if names else ""
            text = (
                f"{size:.2g} rad at the highest frequency"
                if spec.kind == "time"
                else f"{100 * size:.2g} % of its value"
            )
            if strongest > 0.9:
                text += f"; it trades against the {in_words(partner)} (correlation {strongest:.3f})"
            text = (
                f"The data hardly determine the {in_words(spec.name)}: standard uncertainty {text}."
            )
            warnings.append(ResultWarning("weakly_determined", text))
    warnings += _at_bounds(coordinates, coordinates.values(z), deviation, ended)
    return weak | dict.fromkeys(ended, ""), warnings


def at_end(coordinates: Coordinates, z: FloatArray) -> set[str]:
    """Names of parameters at the end of the range searched: its value and u are then not determined by the data."""
    low, high = coordinates.edges
    within = (z > low + 1e-3) & (z < high - 1e-3)
    return {
        name
        for name, inside in zip(coordinates.model.parameter_names, within, strict=True)
        if not inside
    }


def unstated(coordinates: Coordinates, z: FloatArray, covariance: FloatArray) -> set[str]:
    """Names of parameters of which no standard uncertainty can be stated."""
    open_ended = ~(deviations(covariance) <= NOTHING * sizes_of(coordinates.model, z))
    return at_end(coordinates, z).union(
        np.array(coordinates.model.parameter_names)[open_ended].tolist()
    )


def sizes_of(
    model: SensorModel, z: FloatArray, least: float = 1e-300, *, ratios: bool = False
) -> FloatArray:
    """By which deviations of the coordinates are relative ones, shape (p,); one where they are so themselves.

    ``least``: lower limit; ``ratios``: whether those of a ratio count as relative.
    """
    own = {"gain": np.abs(z), "positive": np.tanh(np.abs(z))} | (
        {"ratio": np.abs(z)} if ratios else {}
    )
    kinds = [spec.kind for spec in model.parameters]
    return np.array(
        [max(float(own[kind][k]), least) if kind in own else 1.0 for k, kind in enumerate(kinds)]
    )


def _at_bounds(
    coordinates: Coordinates, values: dict[str, float], deviation: FloatArray, ended: set[str]
) -> list[ResultWarning]:
    warnings = []
    for index, spec in enumerate(coordinates.model.parameters):
        if spec.kind in ("log", "ratio") and spec.name in ended:
            low, high = ends_of(spec, coordinates.band_hz) or (np.nan, np.nan)
            unit = f" {spec.unit}" if spec.unit != "1" else ""
            text = f"The {in_words(spec.name)} lies at the end of the range searched, {low:.3g} to {high:.3g}{unit}."
            traded = _traded(coordinates, values, deviation, index)
            held = "frequency" if spec.unit == "Hz" else "value"
            text += f" What is stated of the {traded} holds for this {held} only." if traded else ""
            warnings.append(ResultWarning("at_bound", text))
        u = deviation[index]
        if spec.kind == "positive" and u < NOTHING and values[spec.name] < 1e-6 + 0.01 * u:
            warnings.append(
                ResultWarning("at_bound", f"The {in_words(spec.name)} lies at its bound, zero.")
            )
    return warnings


def _traded(
    coordinates: Coordinates, values: dict[str, float], deviation: FloatArray, index: int
) -> str:
    """The other parameters, in words, that a frequency ten times nearer to the band would move by more than their u."""
    model, (low, high) = coordinates.model, np.asarray(coordinates.band_hz, dtype=float)
    name = model.parameter_names[index]
    points = np.geomspace(low, high, 50)
    nearer = values[name] / 10.0 if values[name] > high else values[name] * 10.0
    response, slopes = response_and_slopes(model, values, points)
    moved, _ = response_and_slopes(model, {**values, name: nearer}, points)
    change = np.log(moved / response)
    relative = (slopes * coordinates.slopes(coordinates.place(values))[:, None] / response).T
    relative = np.concatenate([np.real(relative), np.imag(relative)])
    others = np.flatnonzero(
        (np.linalg.norm(relative, axis=0) > 0.0) & (np.arange(len(deviation)) != index)
    )
    amounts, *_ = np.linalg.lstsq(
        relative[:, others], np.concatenate([np.real(change), np.imag(change)]), rcond=1e-12
    )
    names = [
        in_words(model.parameter_names[k])
        for k, by in zip(others, amounts, strict=True)
        if abs(by) > deviation[k]
    ]
    return " and the ".join(names)


def coverage_factor(degrees_of_freedom: float) -> float:
    """K of a 95 % interval: Student's t at these degrees of freedom, 1.96 for infinitely many (GUM G.3)."""
    return student_quantile(min(degrees_of_freedom, 1e9), 0.5 + COVERAGE / 2)


def with_reference(
    covariance: FloatArray, z: FloatArray, model: SensorModel, relative: float
) -> FloatArray:
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

    ``z``: the optimum, shape (p,); ``covariance``: of z, shape (p, p); ``degrees_of_freedom``: of the noise estimate;
    ``units``: fields of the units' templates; ``doubtful``: names of parameters that are not identifiable.
    """
    model = coordinates.model
    values = coordinates.values(z)
    unknown = unstated(coordinates, z, covariance)
    deviation = deviations(covariance)
    slopes = np.abs(coordinates.slopes(z))
    k = coverage_factor(degrees_of_freedom)
    table = {}
    for index, spec in enumerate(model.parameters):
        low, high = _interval(coordinates, z, index, k * deviation[index])
        known = spec.name not in unknown
        table[spec.name] = Parameter(
            value=values[spec.name],
            unit=_unit(spec.unit, units),
            standard_uncertainty=float(slopes[index] * deviation[index]) if known else None,
            interval_95=(float(low), float(high)) if known else (None, None),
            identifiable=known and spec.name not in doubtful,
        )
    doubted = {*doubtful, *unknown}
    for quantity in model.derived(values):
        value, slope = _value_and_slope(coordinates, z, quantity)
        u = float(np.sqrt(max(slope @ covariance @ slope, 0.0)))
        relative = u / abs(value) if value else 0.0
        if not quantity.positive or relative > 0.5:
            interval = (value - k * u, value + k * u)
        else:  # positive: symmetric in the logarithm, as the natural frequency's
            interval = (value * np.exp(-k * relative), value * np.exp(k * relative))
        needed = set(quantity.needs)
        known = not needed & unknown and relative <= NOTHING
        table[quantity.name] = Parameter(
            value=value,
            unit=_unit(quantity.unit, units),
            standard_uncertainty=u if known else None,
            interval_95=(float(interval[0]), float(interval[1])) if known else (None, None),
            identifiable=not needed & doubted,
            derived=True,
        )
    return table


def _interval(
    coordinates: Coordinates, z: FloatArray, index: int, half: float
) -> tuple[float, float]:
    name = coordinates.model.parameters[index].name
    kind = coordinates.model.parameters[index].kind
    if kind == "positive":
        centre = coordinates.values(z)[name]
        half = half * abs(float(coordinates.slopes(z)[index]))
        return max(0.0, centre - half), centre + half
    ends = []
    for sign in (-1.0, 1.0):
        moved = np.array(z)
        moved[index] += sign * half
        with np.errstate(over="ignore"):  # an interval without end stops at the range searched
            ends.append(coordinates.values(moved)[name])
    return min(ends), max(ends)


def _value_and_slope(
    coordinates: Coordinates, z: FloatArray, quantity: Derived
) -> tuple[float, FloatArray]:
    """A derived quantity and its slopes in z, shape (p,)."""
    values = coordinates.values(z)
    slopes = [
        complex(quantity.value({**values, name: complex(value, STEP * (abs(value) or 1.0))})).imag
        / (STEP * (abs(value) or 1.0))
        for name, value in values.items()
    ]
    return float(quantity.value(values)), np.array(slopes) * coordinates.slopes(z)


def correlation(model: SensorModel, covariance: FloatArray) -> Correlation:
    """Correlation matrix of the estimated parameters."""
    return Correlation(
        model.parameter_names, tuple(tuple(row) for row in _correlations(covariance).tolist())
    )


def _correlations(covariance: FloatArray) -> FloatArray:
    """Correlation matrix, shape (p, p); one on the diagonal, also where a variance is zero."""
    deviation = deviations(covariance)
    safe = np.where(deviation > 0, deviation, 1.0)
    matrix = np.clip(covariance / np.outer(safe, safe), -1.0, 1.0)
    np.fill_diagonal(matrix, 1.0)
    return matrix


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
    return fields_of_units(
        calibration.response_unit, calibration.reference_unit if drive else "m/s^2", drive=drive
    )


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
