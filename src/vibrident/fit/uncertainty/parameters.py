"""Parameters, estimated and derived, with standard uncertainty and 95 % interval.

And what the data do not determine. The covariance of the coordinates z is exact to first order (GUM
5.2); intervals are taken in z, where the problem is most nearly linear, with Student's t, and
carried over: a natural frequency's interval is symmetric in its logarithm, a damping ratio's ends
at zero. Derived quantities are propagated by the complex-step derivative.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from vibrident.base.tails import student_quantile
from vibrident.data.records import Calibration, FloatArray, is_motion
from vibrident.fit.problem import Coordinates
from vibrident.fit.problem.coordinates import ends_of
from vibrident.physics.models import Derived, SensorModel
from vibrident.physics.models.slopes import STEP, response_and_slopes
from vibrident.physics.naming import in_words
from vibrident.result import Correlation, Parameter, ResultWarning

#: Relative standard uncertainty (delay: rad at the highest frequency) of a weak parameter.
WEAK_UNCERTAINTY = 0.1
#: That of one which trades against another, or whose χ² is skew.
WEAK_TRADED_UNCERTAINTY = 0.01
#: Beyond this relative standard uncertainty (delay: rad) nothing is known.
MAX_RELATIVE_UNCERTAINTY = 1e3
COVERAGE = 0.95


def deviations(covariance: FloatArray) -> FloatArray:
    """Return standard deviations of a covariance, shape (p,); zero for a negative variance."""
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))


def weakly_determined(
    coordinates: Coordinates, z: FloatArray, covariance: FloatArray
) -> tuple[dict[str, str], list[ResultWarning]]:
    """Return the names of weakly determined parameters and the warnings of them.

    Each name comes with that of the parameter it trades against, or "". A parameter at a bound is
    reported as such.
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
        relative_u = deviation[index] / sizes[index]
        other_correlations = np.abs(np.delete(correlations[index], index))
        strongest_correlation = float(np.max(other_correlations, initial=0.0))
        # Fixing that other parameter would shrink it by five.
        trades_off = (
            1.0 / np.sqrt(max(1.0 - strongest_correlation**2, 1e-12)) > 5.0
            and relative_u > WEAK_TRADED_UNCERTAINTY
        )
        if relative_u > MAX_RELATIVE_UNCERTAINTY:
            weak[spec.name] = ""
            text = (
                f"The data do not determine the {in_words(spec.name)}: "
                "no standard uncertainty can be stated."
            )
            warnings.append(ResultWarning("weakly_determined", text))
        elif relative_u > WEAK_UNCERTAINTY or trades_off:
            names = [name for name in model.parameter_names if name != spec.name]
            weak[spec.name] = partner = names[int(np.argmax(other_correlations))] if names else ""
            text = (
                f"{relative_u:.2g} rad at the highest frequency"
                if spec.kind == "time"
                else f"{100 * relative_u:.2g} % of its value"
            )
            if strongest_correlation > 0.9:
                text += f"; it trades against the {in_words(partner)} "
                text += f"(correlation {strongest_correlation:.3f})"
            text = (
                f"The data hardly determine the {in_words(spec.name)}: standard uncertainty {text}."
            )
            warnings.append(ResultWarning("weakly_determined", text))
    warnings += _warn_at_bounds(coordinates, coordinates.values(z), deviation, ended)
    return weak | dict.fromkeys(ended, ""), warnings


def at_end(coordinates: Coordinates, z: FloatArray) -> set[str]:
    """Return the names of parameters at the end of the range searched.

    Their value and u are not determined by the data.
    """
    low, high = coordinates.edges
    inside_range = (z > low + 1e-3) & (z < high - 1e-3)
    return {
        name
        for name, inside in zip(coordinates.model.parameter_names, inside_range, strict=True)
        if not inside
    }


def unstated(coordinates: Coordinates, z: FloatArray, covariance: FloatArray) -> set[str]:
    """Return the names of parameters of which no standard uncertainty can be stated."""
    open_ended = ~(
        deviations(covariance) <= MAX_RELATIVE_UNCERTAINTY * sizes_of(coordinates.model, z)
    )
    return at_end(coordinates, z).union(
        np.array(coordinates.model.parameter_names)[open_ended].tolist()
    )


def sizes_of(
    model: SensorModel, z: FloatArray, lower_limit: float = 1e-300, *, ratios: bool = False
) -> FloatArray:
    """Return the sizes of z by which its deviations are relative, shape (p,).

    They are one where the deviations are relative themselves. ``lower_limit``: of the sizes;
    ``ratios``: whether the deviations of a ratio are divided by it, too.
    """
    size_by_kind = {"gain": np.abs(z), "positive": np.tanh(np.abs(z))} | (
        {"ratio": np.abs(z)} if ratios else {}
    )
    kinds = [spec.kind for spec in model.parameters]
    return np.array(
        [
            max(float(size_by_kind[kind][k]), lower_limit) if kind in size_by_kind else 1.0
            for k, kind in enumerate(kinds)
        ]
    )


def _warn_at_bounds(
    coordinates: Coordinates, values: dict[str, float], deviation: FloatArray, ended: set[str]
) -> list[ResultWarning]:
    """Return the warnings of parameters at the end of the range searched or at zero."""
    warnings = []
    for index, spec in enumerate(coordinates.model.parameters):
        if spec.kind in ("log", "ratio") and spec.name in ended:
            low, high = ends_of(spec, coordinates.band_hz) or (np.nan, np.nan)
            unit = f" {spec.unit}" if spec.unit != "1" else ""
            text = (
                f"The {in_words(spec.name)} lies at the end of the range searched, "
                f"{low:.3g} to {high:.3g}{unit}."
            )
            moved = _moved_parameters(coordinates, values, deviation, index)
            fixed = "frequency" if spec.unit == "Hz" else "value"
            text += f" What is stated of the {moved} holds for this {fixed} only." if moved else ""
            warnings.append(ResultWarning("at_bound", text))
        u = deviation[index]
        if (
            spec.kind == "positive"
            and u < MAX_RELATIVE_UNCERTAINTY
            and values[spec.name] < 1e-6 + 0.01 * u
        ):
            warnings.append(
                ResultWarning("at_bound", f"The {in_words(spec.name)} lies at its bound, zero.")
            )
    return warnings


def _moved_parameters(
    coordinates: Coordinates, values: dict[str, float], deviation: FloatArray, index: int
) -> str:
    """Return, in words, the parameters that would follow a frequency ten times nearer to the band.

    These are the other ones that move by more than their u.
    """
    model = coordinates.model
    low, high = np.asarray(coordinates.band_hz, dtype=float)
    name = model.parameter_names[index]
    points = np.geomspace(low, high, 50)
    nearer = values[name] / 10.0 if values[name] > high else values[name] * 10.0
    response, slopes = response_and_slopes(model, values, points)
    moved, _ = response_and_slopes(model, {**values, name: nearer}, points)
    change = np.log(moved / response)
    log_slopes = (slopes * coordinates.slopes(coordinates.place(values))[:, None] / response).T
    log_slopes = np.concatenate([np.real(log_slopes), np.imag(log_slopes)])
    free = np.flatnonzero(
        (np.linalg.norm(log_slopes, axis=0) > 0.0) & (np.arange(len(deviation)) != index)
    )
    shifts, *_ = np.linalg.lstsq(
        log_slopes[:, free], np.concatenate([np.real(change), np.imag(change)]), rcond=1e-12
    )
    names = [
        in_words(model.parameter_names[k])
        for k, shift in zip(free, shifts, strict=True)
        if abs(shift) > deviation[k]
    ]
    return " and the ".join(names)


def coverage_factor(degrees_of_freedom: float) -> float:
    """Return the coverage factor k of a 95 % interval at these degrees of freedom.

    It is Student's t, 1.96 for infinitely many (GUM G.3).
    """
    return student_quantile(min(degrees_of_freedom, 1e9), 0.5 + COVERAGE / 2)


def with_reference(
    covariance: FloatArray, z: FloatArray, model: SensorModel, relative: float
) -> FloatArray:
    """Return the covariance of z with the uncertainty of the reference's own calibration in it.

    That is a common factor on the gain, type B; ``relative``: its standard uncertainty.
    """
    if relative == 0.0:
        return covariance
    direction = reference_direction(z, model, relative)
    return covariance + np.outer(direction, direction)


def reference_direction(z: FloatArray, model: SensorModel, relative: float) -> FloatArray:
    """Return what a relative change of the whole response does to z, shape (p,)."""
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
    """Return every estimated and derived parameter, by name.

    Args:
        coordinates: the map from z to parameters.
        z: the optimum, shape (p,).
        covariance: of z, shape (p, p).
        degrees_of_freedom: of the noise estimate.
        units: fields of the units' templates.
        doubtful: names of parameters that are not identifiable.
    """
    model = coordinates.model
    values = coordinates.values(z)
    unstated_names = unstated(coordinates, z, covariance)
    deviation = deviations(covariance)
    slopes = np.abs(coordinates.slopes(z))
    k = coverage_factor(degrees_of_freedom)
    table = {}
    for index, spec in enumerate(model.parameters):
        low, high = _interval(coordinates, z, index, k * deviation[index])
        stated = spec.name not in unstated_names
        table[spec.name] = Parameter(
            value=values[spec.name],
            unit=_unit(spec.unit, units),
            standard_uncertainty=float(slopes[index] * deviation[index]) if stated else None,
            interval_95=(float(low), float(high)) if stated else (None, None),
            identifiable=stated and spec.name not in doubtful,
        )
    doubtful_names = {*doubtful, *unstated_names}
    for quantity in model.derived(values):
        value, slope = _value_and_slope(coordinates, z, quantity)
        u = float(np.sqrt(max(slope @ covariance @ slope, 0.0)))
        relative = u / abs(value) if value else 0.0
        if not quantity.positive or relative > 0.5:
            interval = (value - k * u, value + k * u)
        else:  # positive: symmetric in the logarithm, as the natural frequency's
            interval = (value * np.exp(-k * relative), value * np.exp(k * relative))
        names_needed = set(quantity.needs)
        stated = not names_needed & unstated_names and relative <= MAX_RELATIVE_UNCERTAINTY
        table[quantity.name] = Parameter(
            value=value,
            unit=_unit(quantity.unit, units),
            standard_uncertainty=u if stated else None,
            interval_95=(float(interval[0]), float(interval[1])) if stated else (None, None),
            identifiable=not names_needed & doubtful_names,
            derived=True,
        )
    return table


def _interval(
    coordinates: Coordinates, z: FloatArray, index: int, half_width: float
) -> tuple[float, float]:
    """Return the interval of a parameter whose coordinate has this half width."""
    name = coordinates.model.parameters[index].name
    kind = coordinates.model.parameters[index].kind
    if kind == "positive":
        centre = coordinates.values(z)[name]
        half_width = half_width * abs(float(coordinates.slopes(z)[index]))
        return max(0.0, centre - half_width), centre + half_width
    ends = []
    for sign in (-1.0, 1.0):
        z_moved = np.array(z)
        z_moved[index] += sign * half_width
        with np.errstate(over="ignore"):  # an interval without end stops at the range searched
            ends.append(coordinates.values(z_moved)[name])
    return min(ends), max(ends)


def _value_and_slope(
    coordinates: Coordinates, z: FloatArray, quantity: Derived
) -> tuple[float, FloatArray]:
    """Return a derived quantity and its slopes in z, shape (p,)."""
    values = coordinates.values(z)
    slopes = [
        complex(quantity.value({**values, name: complex(value, STEP * (abs(value) or 1.0))})).imag
        / (STEP * (abs(value) or 1.0))
        for name, value in values.items()
    ]
    return float(quantity.value(values)), np.array(slopes) * coordinates.slopes(z)


def correlation(model: SensorModel, covariance: FloatArray) -> Correlation:
    """Return the correlation matrix of the estimated parameters."""
    return Correlation(
        model.parameter_names, tuple(tuple(row) for row in _correlations(covariance).tolist())
    )


def _correlations(covariance: FloatArray) -> FloatArray:
    """Return the correlation matrix, shape (p, p), of a covariance.

    It has one on the diagonal, also where a variance is zero.
    """
    deviation = deviations(covariance)
    divisor = np.where(deviation > 0, deviation, 1.0)
    matrix = np.clip(covariance / np.outer(divisor, divisor), -1.0, 1.0)
    np.fill_diagonal(matrix, 1.0)
    return matrix


def parameter_units(model: SensorModel, calibration: Calibration) -> dict[str, str]:
    """Return the unit of each estimated parameter."""
    fields = unit_fields(calibration)
    return {spec.name: _unit(spec.unit, fields) for spec in model.parameters}


def _unit(template: str, fields: Mapping[str, str]) -> str:
    """Return a unit from its template.

    Brackets around a single unit are removed: V/(A) is V/A.
    """
    return re.sub(r"\(([^()/*· ]+)\)", r"\1", template.format(**fields))


def unit_fields(calibration: Calibration) -> dict[str, str]:
    """Return what the models' unit templates are filled with."""
    is_drive = not is_motion(calibration.quantity)
    return fields_of_units(
        calibration.response_unit,
        calibration.reference_unit if is_drive else "m/s^2",
        drive=is_drive,
    )


def fields_of_units(response: str, reference: str, *, drive: bool) -> dict[str, str]:
    """Return the fields of unit templates from the units of response and reference.

    Args:
        response: unit of the response.
        reference: unit of the drive or force, or of acceleration.
        drive: whether the reference is no motion, so that its integral has no separate unit.
    """
    return {
        "response": response,
        "reference": reference,
        "reference_integrated": f"{reference} s" if drive else "m/s",
        "conversion": f"{response}/(({reference}) s^2)" if drive else f"{response}/m",
    }
