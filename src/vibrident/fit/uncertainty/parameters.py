"""Parameters with standard uncertainty and 95 % interval, and those that the data leave open.

The covariance of the coordinates z is exact to first order (GUM 5.2). Intervals are taken in z,
where the problem is most nearly linear, with Student's t, and converted: that of a natural
frequency is symmetric in its logarithm, that of a damping ratio ends at zero. Uncertainties of
derived quantities follow by the complex-step derivative.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from vibrident.base.tails import student_quantile
from vibrident.data.records import Calibration, FloatArray, is_motion
from vibrident.fit.problem import Coordinates
from vibrident.fit.problem.coordinates import ends_of
from vibrident.fit.uncertainty.linearised import log_slopes
from vibrident.physics.models import Derived, SensorModel
from vibrident.physics.models.slopes import STEP
from vibrident.physics.naming import in_words
from vibrident.result import Correlation, Parameter, ResultWarning

#: Relative standard uncertainty (delay: rad at the highest frequency) of a weak parameter.
WEAK_UNCERTAINTY = 0.1
#: The same for a parameter that trades against another, or whose χ² is skew.
WEAK_TRADED_UNCERTAINTY = 0.01
#: Beyond this relative standard uncertainty (delay: rad) nothing is known.
MAX_RELATIVE_UNCERTAINTY = 1e3
COVERAGE = 0.95


def deviations(covariance: FloatArray) -> FloatArray:
    """Return standard deviations of a covariance, shape (p,); zero for a negative variance."""
    return np.sqrt(np.maximum(np.diag(covariance), 0.0))


def standard_uncertainties(
    coordinates: Coordinates, z: FloatArray, covariance: FloatArray
) -> dict[str, float]:
    """Return the standard uncertainty of each estimated parameter, by name."""
    u = np.abs(coordinates.slopes(z)) * deviations(covariance)
    return dict(zip(coordinates.model.parameter_names, u.tolist(), strict=True))


def weakly_determined(
    coordinates: Coordinates, z: FloatArray, covariance: FloatArray
) -> tuple[dict[str, str], list[ResultWarning]]:
    """Return the weakly determined parameters, and warnings of these and of parameters at a bound.

    The value of each name is the name of the parameter that it trades against, or "".
    """
    model = coordinates.model
    correlations = _correlations(covariance)
    deviation = deviations(covariance)
    sizes = sizes_of(model, z)
    ended = at_end(coordinates, z)
    weak: dict[str, str] = {}
    texts = []
    for index, spec in enumerate(model.parameters):
        # The logarithm's deviation is relative; a delay's is in radians at the highest frequency.
        relative_u = deviation[index] / sizes[index]
        other_correlations = np.abs(np.delete(correlations[index], index))
        strongest_correlation = float(np.max(other_correlations, initial=0.0))
        # If that other parameter were fixed, the uncertainty would be a fifth.
        trades_off = (
            1.0 / np.sqrt(max(1.0 - strongest_correlation**2, 1e-12)) > 5.0
            and relative_u > WEAK_TRADED_UNCERTAINTY
        )
        if relative_u > MAX_RELATIVE_UNCERTAINTY:
            weak[spec.name] = ""
            texts.append(
                f"The data do not determine the {in_words(spec.name)}: "
                "no standard uncertainty can be stated."
            )
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
            texts.append(
                f"The data hardly determine the {in_words(spec.name)}: standard uncertainty {text}."
            )
    warnings = [ResultWarning("weakly_determined", text) for text in texts]
    warnings += _warn_at_bounds(coordinates, z, deviation, ended)
    return weak | dict.fromkeys(ended, ""), warnings


def at_end(coordinates: Coordinates, z: FloatArray) -> set[str]:
    """Return the names of parameters at an end of the range searched.

    The data determine neither their value nor its u.
    """
    low, high = coordinates.edges
    is_inside = (z > low + 1e-3) & (z < high - 1e-3)
    return set(np.array(coordinates.model.parameter_names)[~is_inside].tolist())


def unstated(coordinates: Coordinates, z: FloatArray, covariance: FloatArray) -> set[str]:
    """Return the names of parameters for which no standard uncertainty can be stated."""
    limits = MAX_RELATIVE_UNCERTAINTY * sizes_of(coordinates.model, z)
    is_known = deviations(covariance) <= limits
    names = np.array(coordinates.model.parameter_names)
    return at_end(coordinates, z).union(names[~is_known].tolist())


def sizes_of(
    model: SensorModel, z: FloatArray, lower_limit: float = 1e-300, *, ratios: bool = False
) -> FloatArray:
    """Return the sizes of z that make its deviations relative, shape (p,).

    They are one where the deviations are relative themselves.

    Args:
        model: with the parameters.
        z: coordinates, shape (p,).
        lower_limit: of the sizes.
        ratios: whether the deviation of a ratio is relative to it, too.
    """
    size_by_kind = {"gain": np.abs(z), "positive": np.tanh(np.abs(z))}
    if ratios:
        size_by_kind["ratio"] = np.abs(z)
    return np.array(
        [
            max(float(size_by_kind[spec.kind][k]), lower_limit)
            if spec.kind in size_by_kind
            else 1.0
            for k, spec in enumerate(model.parameters)
        ]
    )


def _warn_at_bounds(
    coordinates: Coordinates, z: FloatArray, deviation: FloatArray, ended: set[str]
) -> list[ResultWarning]:
    """Return the warnings of parameters at an end of the range searched or at zero."""
    values = coordinates.values(z)
    warnings = []
    for index, spec in enumerate(coordinates.model.parameters):
        if spec.kind in ("log", "ratio") and spec.name in ended:
            low, high = ends_of(spec, coordinates.band_hz) or (np.nan, np.nan)
            unit = f" {spec.unit}" if spec.unit != "1" else ""
            text = (
                f"The {in_words(spec.name)} lies at the end of the range searched, "
                f"{low:.3g} to {high:.3g}{unit}."
            )
            moved = _moved_parameters(coordinates, z, deviation, index)
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
    coordinates: Coordinates, z: FloatArray, deviation: FloatArray, index: int
) -> str:
    """Return, in words, the parameters that would follow a frequency ten times nearer to the band.

    To follow is to move by more than the standard uncertainty.
    """
    model = coordinates.model
    low, high = np.asarray(coordinates.band_hz, dtype=float)
    name = model.parameter_names[index]
    values = coordinates.values(z)
    points_hz = np.geomspace(low, high, 50)
    nearer = values[name] / 10.0 if values[name] > high else values[name] * 10.0
    response, slopes = log_slopes(coordinates, z, "acceleration", points_hz)
    change = np.log(model.frequency_response({**values, name: nearer}, points_hz) / response)
    columns = np.concatenate([slopes.real, slopes.imag])
    free = np.flatnonzero(
        (np.linalg.norm(columns, axis=0) > 0.0) & (np.arange(len(deviation)) != index)
    )
    shifts, *_ = np.linalg.lstsq(
        columns[:, free], np.concatenate([change.real, change.imag]), rcond=1e-12
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
    """Return the covariance of z, with the uncertainty of the reference's calibration added.

    The latter is a common factor on the gain, type B; ``relative``: its standard uncertainty.
    """
    if relative == 0.0:
        return covariance
    direction = reference_direction(z, model, relative)
    return covariance + np.outer(direction, direction)


def reference_direction(z: FloatArray, model: SensorModel, relative: float) -> FloatArray:
    """Return the shift of z by a relative change of the whole response, shape (p,)."""
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
    uncertainty = standard_uncertainties(coordinates, z, covariance)
    k = coverage_factor(degrees_of_freedom)
    table = {}
    for index, spec in enumerate(model.parameters):
        low, high = _interval(coordinates, z, index, k * deviation[index])
        stated = spec.name not in unstated_names
        table[spec.name] = Parameter(
            value=values[spec.name],
            unit=_unit(spec.unit, units),
            standard_uncertainty=uncertainty[spec.name] if stated else None,
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
    spec = coordinates.model.parameters[index]
    if spec.kind == "positive":
        centre = coordinates.values(z)[spec.name]
        half_width = half_width * abs(float(coordinates.slopes(z)[index]))
        return max(0.0, centre - half_width), centre + half_width
    ends = []
    for sign in (-1.0, 1.0):
        z_moved = np.array(z)
        z_moved[index] += sign * half_width
        with np.errstate(over="ignore"):  # an interval without end stops at the range searched
            ends.append(coordinates.values(z_moved)[spec.name])
    return min(ends), max(ends)


def _value_and_slope(
    coordinates: Coordinates, z: FloatArray, quantity: Derived
) -> tuple[float, FloatArray]:
    """Return a derived quantity and its slopes in z, shape (p,)."""
    values = coordinates.values(z)
    slopes = []
    for name, value in values.items():
        step = STEP * (abs(value) or 1.0)
        moved = quantity.value({**values, name: complex(value, step)})
        slopes.append(complex(moved).imag / step)
    return float(quantity.value(values)), np.array(slopes) * coordinates.slopes(z)


def correlation(model: SensorModel, covariance: FloatArray) -> Correlation:
    """Return the correlation matrix of the estimated parameters."""
    return Correlation(
        model.parameter_names, tuple(tuple(row) for row in _correlations(covariance).tolist())
    )


def _correlations(covariance: FloatArray) -> FloatArray:
    """Return the correlation matrix of a covariance, shape (p, p).

    Its diagonal is one, also where a variance is zero.
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
    """Return the fields of the models' unit templates."""
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
