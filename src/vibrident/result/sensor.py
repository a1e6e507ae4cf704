"""Compute with an identified sensor: its response and uncertainty at any frequency.

:meth:`vibrident.Result.to_sensor` and a fit return one. Correction, prediction, planning, report
and export use it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from vibrident.base.binding import bound
from vibrident.base.errors import InputError
from vibrident.base.extras import library
from vibrident.data.records import FloatArray, Quantity
from vibrident.physics.models import SensorModel
from vibrident.physics.models.slopes import ComplexArray, response_and_slopes

if TYPE_CHECKING:
    from control import TransferFunction
    from scipy.signal import ZerosPolesGain


@dataclass(frozen=True, eq=False)
class IdentifiedSensor:
    """Sensor model with values and their covariance.

    Attributes:
        model: the sensor model.
        values: name → value, SI units, frequencies in Hz.
        covariance: of the values in the model's order, shape (parameters, parameters); NaN if not
            stated.
        quantity: what the sensitivity is per: acceleration, or the drive that the sensor was
            identified with.
        band_hz: lowest and highest frequency of the data; None if unknown.
        response_unit: unit of the response.
        input_unit: unit of ``quantity``.
        degrees_of_freedom: of the covariance.
        misfit: rms relative error, at the measured points, of a model that its calibration
            rejected; else 0.

    Examples:
        >>> import numpy as np
        >>> import vibrident
        >>> hz = [100, 300, 650, 1000]
        >>> calibration = vibrident.simulate(frequencies_hz=hz, samples=2000, response_noise=1e-3)
        >>> result = vibrident.identify(calibration)
        >>> sensor = result.to_sensor()
        >>> at_hz = np.array([160.0, 650.0])
        >>> abs(sensor.frequency_response(at_hz)).round(3).tolist()
        [0.11, 0.287]
        >>> relative_u, phase_u_rad = sensor.uncertainty(at_hz)
        >>> bool(np.all(relative_u < 1e-3))
        True
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

    def __repr__(self) -> str:
        """Show model, values with u, band and unit."""
        u_values = np.sqrt(np.diag(self.covariance))
        estimates = [
            f"{name}={self.values[name]:.8g}" + (f" ± {u:.2g}" if np.isfinite(u) else "")
            for name, u in zip(self.model.parameter_names, u_values, strict=True)
        ]
        text = ", ".join(estimates)
        if self.band_hz is not None:
            low_hz, high_hz = self.band_hz
            text += f"; {low_hz:.4g} to {high_hz:.4g} Hz"
        return f"<Sensor {self.model.name}: {text}; {self.response_unit} per {self.input_unit}>"

    def _repr_html_(self) -> str:
        """Show values with uncertainties, and the curve over the data's band, in a notebook."""
        return bound("sensor_html")(self)

    def frequency_response(
        self, frequency_hz: FloatArray, quantity: Quantity | None = None
    ) -> ComplexArray:
        """Return the complex sensitivity for e^{+jωt}, shape (points,).

        Args:
            frequency_hz: shape (points,).
            quantity: what the response is per; None: :attr:`quantity`.
        """
        frequency_hz = np.asarray(frequency_hz, dtype=float)
        response = self.model.frequency_response(
            self.values, frequency_hz, quantity or self.quantity
        )
        return np.asarray(response, dtype=complex)

    def slopes(self, frequency_hz: FloatArray, quantity: Quantity | None = None) -> ComplexArray:
        """Return ∂sensitivity/∂parameter, shape (parameters, points)."""
        return response_and_slopes(
            self.model, self.values, frequency_hz, quantity or self.quantity
        )[1]

    def uncertainty(
        self, frequency_hz: FloatArray, quantity: Quantity | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Return standard uncertainties of magnitude (relative) and phase (rad), (points,)."""
        response, slopes = response_and_slopes(
            self.model, self.values, frequency_hz, quantity or self.quantity
        )
        relative = slopes / response
        variance = [
            np.einsum("ik,ij,jk->k", component, self.covariance, component)
            for component in (relative.real, relative.imag)
        ]
        return np.sqrt(np.maximum(variance[0], 0.0)), np.sqrt(np.maximum(variance[1], 0.0))

    def to_scipy(self) -> ZerosPolesGain:
        """Return a ``scipy.signal.ZerosPolesGain``, rad/s; a delay by poles and zeros.

        Raises:
            InputError: the model is not linear, or poles and zeros cannot hold it over the band of
                its data.
        """
        from scipy.signal import ZerosPolesGain

        system = bound("zeros_and_poles")(self)
        return ZerosPolesGain(system.zeros, system.poles, system.gain)

    def to_control(self) -> TransferFunction:
        """Return a ``control.TransferFunction`` (extra ``control``), like :meth:`to_scipy`.

        Raises:
            InputError: as :meth:`to_scipy`, or python-control is not installed.
        """
        control = library(
            "control", "control", "A sensor of python-control needs that library.", "to_control"
        )
        return control.TransferFunction(*bound("zeros_and_poles")(self).polynomials())

    @property
    def zeros_at_rest(self) -> int:
        """Return the number of zeros at frequency zero of the response to acceleration: 0 to 2."""
        numerator = self.model.rational(self.values).numerator
        return next((power for power, c in enumerate(numerator) if c != 0.0), len(numerator))

    def require_uncertainty(self) -> None:
        """Refuse a sensor whose parameters' covariance is not stated."""
        has_u = np.isfinite(self.covariance)
        names = self.model.parameter_names
        missing = [name for name, row in zip(names, has_u, strict=True) if not row.all()]
        if missing:
            raise InputError(
                "The result does not state the uncertainty of a parameter, "
                "or its correlation with another one.",
                expected="standard uncertainty and correlation of " + ", ".join(names),
                found="none for " + ", ".join(missing),
                where="result, parameters and correlation",
                remedy="run ⟦command = identify⟧ again",
            )
