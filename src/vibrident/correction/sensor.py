"""A result as a sensor to compute with: parameter values, their covariance, and the response with its slopes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vibrident.errors import InputError
from vibrident.models import SensorModel, parse
from vibrident.records import FloatArray
from vibrident.result import Result

#: Step of the central differences, in units of each parameter's own scale: error and rounding are below 1e-9 there.
STEP = 1e-6
#: Scale of a dimensionless parameter that may be zero.
LEAST_SCALE = 1e-3

ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class KnownSensor:
    """A sensor model with values and their covariance.

    Attributes:
        model: the sensor model.
        values: name to value, SI units, frequencies in Hz.
        covariance: of the values in the model's order, shape (parameters, parameters).
        degrees_of_freedom: behind the covariance.
        misfit: relative error of a model that its calibration rejected, as large as at the measured points; else 0.
    """

    model: SensorModel
    values: Mapping[str, float]
    covariance: FloatArray
    degrees_of_freedom: float = np.inf
    misfit: float = 0.0

    @classmethod
    def of(cls, result: Result) -> KnownSensor:
        """The sensor that a result describes; its covariance holds what the result's uncertainties cover.

        Raises:
            InputError: the model is not linear, or a parameter, its uncertainty or its correlation is missing.
        """
        if "cubic" in result.model.split("+"):
            raise InputError(
                "A sensor with a cubic stiffness has no linear inverse.",
                expected="a result of a linear model",
                found=repr(result.model),
                where="result, model",
                remedy="identify with a model without 'cubic', at the level of the motion to be corrected",
            )
        result.require_gain("a correction")
        model = parse(result.model)
        names = model.parameter_names
        deviation = np.zeros(len(names))
        values = {}
        for index, name in enumerate(names):
            parameter = result.parameters.get(name)
            value = None if parameter is None else parameter.value
            u = None if parameter is None else parameter.standard_uncertainty
            if value is None or u is None or not np.isfinite([value, u]).all():
                raise InputError(
                    "The result lacks a parameter of its model.",
                    expected=f"a finite {name} with its standard uncertainty, for the model {model.name!r}",
                    found=f"value {value!r}, standard uncertainty {u!r}",
                    where=f"result, parameters, {name}",
                    remedy="run `vibrident identify` again",
                )
            values[name], deviation[index] = float(value), float(u)
        if set(names) - set(result.correlation.names):
            raise InputError(
                "The result lacks the correlation of its parameters.",
                expected=", ".join(names),
                found=", ".join(result.correlation.names) or "none",
                where="result, correlation",
                remedy="run `vibrident identify` again",
            )
        order = [result.correlation.names.index(name) for name in names]
        correlation = np.array(result.correlation.matrix, dtype=float)[np.ix_(order, order)]
        freedom = result.settings.get("effective_degrees_of_freedom")
        freedom = float(freedom) if freedom is not None else np.inf
        return cls(model, values, correlation * np.outer(deviation, deviation), freedom, _misfit(result))

    def response(self, frequency_hz: FloatArray) -> ComplexArray:
        """Complex sensitivity to acceleration, response unit per m/s²; shape (points,)."""
        return np.asarray(self.model.frequency_response(self.values, frequency_hz), dtype=complex)

    def slopes(self, frequency_hz: FloatArray) -> ComplexArray:
        """Derivative of the sensitivity by each parameter, by central differences; shape (parameters, points)."""
        highest = float(np.max(frequency_hz))
        rows = []
        for spec in self.model.parameters:
            value = self.values[spec.name]
            scales = {"positive": max(abs(value), 1.0), "ratio": max(abs(value), LEAST_SCALE)}
            scale = 1.0 / (2.0 * np.pi * highest) if spec.kind == "time" else scales.get(spec.kind, abs(value))
            step = STEP * scale
            up, down = (
                self.model.frequency_response({**self.values, spec.name: value + sign * step}, frequency_hz)
                for sign in (1.0, -1.0)
            )
            rows.append((up - down) / (2.0 * step))
        return np.array(rows, dtype=complex)

    def zeros_at_rest(self) -> int:
        """How many times the response to acceleration vanishes at frequency zero: 0, 1 or 2."""
        numerator = self.model.rational(self.values).numerator
        count = 0
        while count < len(numerator) and numerator[count] == 0.0:
            count += 1
        return count


def _misfit(result: Result) -> float:
    """Rms relative deviation of a rejected model from the measured points, beyond their uncertainty."""
    measured = result.measured
    if result.fit.adequate or not measured.frequency_hz:
        return 0.0

    def squares(column: Sequence[float | None], scale: FloatArray | float) -> FloatArray:
        return np.array([0.0 if value is None else value for value in column]) ** 2 * np.square(scale)

    degree = np.pi / 180.0
    found = squares(measured.deviation_percent, 0.01) + squares(measured.deviation_phase_deg, degree)
    known = squares(measured.magnitude_uncertainty, 1.0 / np.abs(np.array(measured.magnitude)))
    known += squares(measured.phase_deg_uncertainty, degree)
    return float(np.sqrt(max(np.mean(found - known), 0.0)))
