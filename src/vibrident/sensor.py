"""An identified sensor to compute with: its model with values, their covariance, and the response with its uncertainty.

It is made from a :class:`Result` (or from a fit, :func:`vibrident.uncertainty.linearised.fitted_sensor`) and serves
correction, prediction, planning, report and export.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from vibrident.brief import brief
from vibrident.errors import InputError
from vibrident.extras import library
from vibrident.models import SensorModel, parse
from vibrident.models.slopes import ComplexArray, response_and_slopes
from vibrident.records import FloatArray, Quantity
from vibrident.result import Result

if TYPE_CHECKING:
    from control import TransferFunction
    from scipy.signal import ZerosPolesGain


@dataclass(frozen=True, eq=False)
class IdentifiedSensor:
    """A sensor model with values and their covariance.

    Attributes:
        model: the sensor model.
        values: name → value, SI units, frequencies in Hz.
        covariance: of the values in the model's order, shape (parameters, parameters); NaN if not stated.
        quantity: what the sensitivity is per: acceleration, or the drive that the sensor was identified with.
        band_hz: lowest and highest frequency of the data; None where nothing tells.
        response_unit: unit of the response.
        input_unit: unit of ``quantity``.
        degrees_of_freedom: behind the covariance.
        misfit: relative error of a model that its calibration rejected, as large as at the measured points; else 0.
    """

    model: SensorModel
    values: Mapping[str, float]
    covariance: FloatArray
    quantity: Quantity = "acceleration"
    band_hz: tuple[float, float] | None = None
    response_unit: str = "V"
    input_unit: str = "m/s^2"
    degrees_of_freedom: float = np.inf
    misfit: float = 0.0

    __repr__ = brief

    @classmethod
    def of(cls, result: Result, use: str = "a computation") -> IdentifiedSensor:
        """The sensor that a result describes; its covariance holds what the result's uncertainties cover.

        Args:
            result: of an identification.
            use: purpose, in words.

        Raises:
            InputError: the result has no gain, or lacks a parameter of its model.
        """
        result.require_gain(use)
        model = parse(result.model)
        drive = result.reference.get("quantity") == "drive"
        freedom = result.settings.get("effective_degrees_of_freedom")
        return cls(
            model,
            _values(result, model),
            _covariance(result, model),
            "drive" if drive else "acceleration",
            _band(result),
            result.response_unit,
            (result.reference.get("unit") or "drive unit") if drive else "m/s^2",
            float(freedom) if freedom is not None else np.inf,
            _misfit(result),
        )

    @classmethod
    def linear(cls, result: Result, use: str) -> IdentifiedSensor:
        """The same of a model that has a linear inverse.

        Raises:
            InputError: the model has no linear inverse; or as :meth:`of`.
        """
        if not parse(result.model).is_linear:
            raise InputError(
                "A sensor with a cubic stiffness has no linear inverse.",
                expected="a result of a linear model",
                found=repr(result.model),
                where="result, model",
                remedy="identify with a model without 'cubic', at the level of the motion to be corrected",
            )
        return cls.of(result, use)

    def frequency_response(self, frequency_hz: FloatArray, quantity: Quantity | None = None) -> ComplexArray:
        """Complex sensitivity for e^{+jωt}, shape (points,).

        Args:
            frequency_hz: shape (points,).
            quantity: reference quantity; None: the sensor's own.
        """
        at = np.asarray(frequency_hz, dtype=float)
        return np.asarray(self.model.frequency_response(self.values, at, quantity or self.quantity), dtype=complex)

    def slopes(self, frequency_hz: FloatArray, quantity: Quantity | None = None) -> ComplexArray:
        """Derivative of the sensitivity by each parameter, shape (parameters, points)."""
        return response_and_slopes(self.model, self.values, frequency_hz, quantity or self.quantity)[1]

    def uncertainty(self, frequency_hz: FloatArray, quantity: Quantity | None = None) -> tuple[FloatArray, FloatArray]:
        """Standard uncertainties of magnitude, relative, and of phase, rad; each of shape (points,)."""
        response, slopes = response_and_slopes(self.model, self.values, frequency_hz, quantity or self.quantity)
        relative = slopes / response
        variance = [np.einsum("ik,ij,jk->k", part, self.covariance, part) for part in (relative.real, relative.imag)]
        return np.sqrt(np.maximum(variance[0], 0.0)), np.sqrt(np.maximum(variance[1], 0.0))

    def to_scipy(self) -> ZerosPolesGain:
        """As a ``scipy.signal.ZerosPolesGain``, rad/s; a delay or an average over a window by poles and zeros.

        Raises:
            InputError: the model is not linear, or poles and zeros cannot hold it over the band of its data.
        """
        from scipy.signal import ZerosPolesGain

        from vibrident.export.python_source import system

        found = system(self)
        return ZerosPolesGain(found.zeros, found.poles, found.gain)

    def to_control(self) -> TransferFunction:
        """As a ``control.TransferFunction`` of python-control (extra ``control``), like :meth:`to_scipy`.

        Raises:
            InputError: as :meth:`to_scipy`, or python-control is not installed.
        """
        control = library("control", "control", "A sensor of python-control needs that library.", "to_control")

        from vibrident.export.python_source import system

        return control.TransferFunction(*system(self).polynomials())

    @property
    def zeros_at_rest(self) -> int:
        """How many times the response to acceleration vanishes at frequency zero: 0, 1 or 2."""
        numerator = self.model.rational(self.values).numerator
        return next((power for power, c in enumerate(numerator) if c != 0.0), len(numerator))

    def require_uncertainty(self) -> None:
        """Refuse a sensor whose parameters' covariance is not stated."""
        known = np.isfinite(self.covariance)
        if not known.all():
            names = [name for name, row in zip(self.model.parameter_names, known, strict=True) if not row.all()]
            raise InputError(
                "The result does not state the uncertainty of a parameter, or its correlation with another one.",
                expected=f"standard uncertainty and correlation of {', '.join(self.model.parameter_names)}",
                found="none for " + ", ".join(names),
                where="result, parameters and correlation",
                remedy="run `vibrident identify` again",
            )


def _values(result: Result, model: SensorModel) -> dict[str, float]:
    found = {name: result.parameters[name].value for name in model.parameter_names if name in result.parameters}
    missing = [n for n in model.parameter_names if found.get(n) is None or not np.isfinite(found[n])]
    if missing:
        raise InputError(
            "The result lacks parameters of its model.",
            expected=f"numbers for {', '.join(model.parameter_names)}",
            found="none for " + ", ".join(missing),
            where="result.json, parameters",
            remedy="run `vibrident identify` again",
        )
    return {name: float(found[name]) for name in model.parameter_names}


def _covariance(result: Result, model: SensorModel) -> FloatArray:
    names = model.parameter_names
    stated = [result.parameters[name].standard_uncertainty for name in names]
    deviation = np.array([np.nan if u is None else u for u in stated], dtype=float)
    correlation = np.full((len(names), len(names)), np.nan)
    place = {name: index for index, name in enumerate(result.correlation.names)}
    for row, name in enumerate(names):
        for column, other in enumerate(names):
            if name in place and other in place:
                correlation[row, column] = result.correlation.matrix[place[name]][place[other]]
    return correlation * np.outer(deviation, deviation)


def _band(result: Result) -> tuple[float, float] | None:
    """Range of the data; the curve's range if the result holds no measured points."""
    for curve in (result.measured, result.response):
        known = curve.frequency_hz[np.isfinite(curve.frequency_hz) & (curve.frequency_hz > 0)]
        if known.size:
            return float(known.min()), float(known.max())
    return None


def _misfit(result: Result) -> float:
    """Rms relative deviation of a rejected model from the measured points, beyond their uncertainty."""
    measured = result.measured
    if result.fit.adequate or not measured.frequency_hz.size:
        return 0.0

    def squares(column: FloatArray, scale: FloatArray | float) -> FloatArray:
        return (np.nan_to_num(column) * scale) ** 2 if column.size else np.zeros(measured.frequency_hz.size)

    degree = np.pi / 180.0
    found = squares(measured.deviation_percent, 0.01) + squares(measured.deviation_phase_deg, degree)
    known = squares(measured.magnitude_uncertainty, 1.0 / np.abs(measured.magnitude))
    known += squares(measured.phase_deg_uncertainty, degree)
    return float(np.sqrt(max(np.mean(found - known), 0.0)))
