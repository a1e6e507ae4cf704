"""The estimates of a result (``vibrident.Result``) as a sensor to compute with."""

from __future__ import annotations

from typing import Any

import numpy as np

from vibrident.base.errors import InputError, ModelError
from vibrident.data.records import REFERENCE_UNITS, FloatArray, is_motion
from vibrident.physics.models import SensorModel, parse
from vibrident.physics.models.source import source_of
from vibrident.physics.registry import MODELS
from vibrident.result.sensor import IdentifiedSensor


def sensor_of(result: Any) -> IdentifiedSensor:
    """Return the sensor of a result with a gain; errors as of ``Result.to_sensor``."""
    model = model_of_result(result)
    reference = result.reference.get("quantity") or "acceleration"
    quantity = "acceleration" if is_motion(reference) else reference
    freedom = result.settings.get("effective_degrees_of_freedom")
    return IdentifiedSensor(
        model,
        _values(result, model),
        _covariance(result, model),
        quantity,
        _band(result),
        result.response_unit,
        REFERENCE_UNITS[quantity]
        if quantity == "acceleration"
        else result.reference.get("unit") or REFERENCE_UNITS[quantity],
        float(freedom) if freedom is not None else np.inf,
        _misfit(result),
    )


def model_of_result(result: Any) -> SensorModel:
    """Return the model of a result.

    Raises:
        ModelError: it is not known; or it was made in Python, and is not known or another one here.
    """
    source = result.provenance.get("model")
    core = result.model.partition("+")[0]
    if not source:
        return parse(result.model)
    if core not in MODELS:
        raise ModelError(
            f"The model {core!r} was made in Python and is not known here.",
            expected="the model that the result is of, to compute with",
            found="values and curve alone",
            where="result.json, provenance, model",
            remedy="make it again from its formula, and give it: Result.load(path, model=model)",
        )
    model = parse(result.model)
    if source_of(model.core)["sha256"] != source.get("sha256"):
        raise ModelError(
            f"The model {core!r} is another one here than that of the result.",
            expected=str(source.get("formula") or "the formula of the result"),
            found=source_of(model.core)["formula"] or "another one",
            where="result.json, provenance, model",
            remedy="give the model of the result: Result.load(path, model=model)",
        )
    return model


def _values(result: Any, model: SensorModel) -> dict[str, float]:
    """Return the values of the model's parameters; InputError where one is missing."""
    values = {
        name: float(result.parameters[name].value)
        for name in model.parameter_names
        if name in result.parameters
    }
    missing = [name for name in model.parameter_names if not np.isfinite(values.get(name, np.nan))]
    if missing:
        raise InputError(
            "The result lacks parameters of its model.",
            expected=f"numbers for {', '.join(model.parameter_names)}",
            found="none for " + ", ".join(missing),
            where="result.json, parameters",
            remedy="run ⟦command = identify⟧ again",
        )
    return values


def _covariance(result: Any, model: SensorModel) -> FloatArray:
    """Return the covariance of the values, NaN where it is not stated."""
    names = model.parameter_names
    u_values = [result.parameters[name].standard_uncertainty for name in names]
    deviation = np.array([np.nan if u is None else u for u in u_values], dtype=float)
    stated = [name for name in names if name in result.correlation.names]
    rows = [result.correlation.names.index(name) for name in stated]
    place = [names.index(name) for name in stated]
    correlation = np.full((len(names), len(names)), np.nan)
    if stated:
        matrix = np.array(result.correlation.matrix, dtype=float)
        correlation[np.ix_(place, place)] = matrix[np.ix_(rows, rows)]
    return correlation * np.outer(deviation, deviation)


def _band(result: Any) -> tuple[float, float] | None:
    """Return the range of the data; the curve's range if the result holds no measured points."""
    for curve in (result.measured, result.response):
        usable = curve.frequency_hz[np.isfinite(curve.frequency_hz) & (curve.frequency_hz > 0)]
        if usable.size:
            return float(usable.min()), float(usable.max())
    return None


def _misfit(result: Any) -> float:
    """Return the rms relative deviation of a rejected model from the points, beyond their u."""
    measured = result.measured
    if result.fit.adequate or not measured.frequency_hz.size:
        return 0.0

    def squares(column: FloatArray, scale: FloatArray | float) -> FloatArray | float:
        return (np.nan_to_num(column) * scale) ** 2 if column.size else 0.0

    degree = np.pi / 180.0
    excess = (
        squares(measured.deviation_percent, 0.01)
        + squares(measured.deviation_phase_deg, degree)
        - (
            squares(measured.magnitude_uncertainty, 1.0 / np.abs(measured.magnitude))
            + squares(measured.phase_deg_uncertainty, degree)
        )
    )
    return float(np.sqrt(max(np.mean(excess), 0.0)))
