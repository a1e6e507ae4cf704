"""The residual in frequency: measured complex responses less the model's, over their noise.

Two kinds of data have one form. Records give complex amplitudes X (reference) and Y (response) of
each tone; the residual Y − H X over its standard deviation is the errors-in-variables residual
(Pintelon & Schoukens 2012, sec. 9.11): its sum of squares is the maximum-likelihood cost once the
unknown true X is eliminated. The deviation depends on H and is refreshed between fits. A table
gives |H| and its phase with standard uncertainties u; the residual is in those coordinates, (|H| −
m)/u_m and (arg H − φ)/u_φ.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from vibrident.data.records import FloatArray, Quantity, ResponseTable
from vibrident.fit.problem.coordinates import Coordinates
from vibrident.fit.response import MeasuredResponse
from vibrident.fit.response.response import ComplexArray
from vibrident.physics.models import SensorModel
from vibrident.physics.models.base import array_library
from vibrident.physics.models.slopes import response_and_slopes


class Local(NamedTuple):
    """Normal matrix JᵀJ, gradient Jᵀr and cost of a residual r at a point (J = −∂r/∂z)."""

    matrix: Any
    gradient: Any
    cost: Any

    @classmethod
    def of(cls, residual: FloatArray, jacobian: FloatArray) -> Local:
        """Return the equations of a residual r, shape (n,), and ∂r/∂z, shape (n, p)."""
        return cls(jacobian.T @ jacobian, -jacobian.T @ residual, float(residual @ residual))


@dataclass(frozen=True, eq=False)
class FrequencyProblem:
    """Complex responses of one sensor at n points.

    Attributes:
        model: the sensor model.
        quantity: of the reference.
        data: arrays of the residual, each of shape (n,): (f, X, Y, σ) or, of a table, (f, m, φ,
            u_m, u_φ).
        polar: True for a table, whose uncertainties belong to magnitude and phase.
        has_phase: False for a table of magnitudes alone.
        start: start values of the parameters, where they are known.
        longest_delay_s: longest delay between the channels that the data could show.
    """

    model: SensorModel
    quantity: Quantity
    data: tuple[Any, ...]
    polar: bool = False
    has_phase: bool = True
    start: Mapping[str, float] | None = None
    longest_delay_s: float = np.inf

    @classmethod
    def of_measured(
        cls,
        measured: MeasuredResponse,
        deviation: FloatArray,
        model: SensorModel,
        quantity: Quantity,
    ) -> FrequencyProblem:
        """Return the problem of measured records.

        Args:
            measured: their response.
            deviation: of the real part of Y − H X, shape (n,).
            model: the sensor model.
            quantity: of the reference.
        """
        data = (measured.frequency_hz, measured.reference, measured.response, deviation)
        return cls(model, quantity, data)

    @classmethod
    def of_table(
        cls, table: ResponseTable, model: SensorModel, quantity: Quantity
    ) -> FrequencyProblem:
        """Return the problem of a table.

        Without stated uncertainties, 1 % and 0.01 rad give equal relative weights.
        """
        magnitude_u = table.magnitude_uncertainty
        if magnitude_u is None:
            magnitude_u = 0.01 * table.magnitude
        phase = np.zeros(table.points) if table.phase_rad is None else table.phase_rad
        phase_u = table.phase_uncertainty_rad
        if phase_u is None:
            phase_u = magnitude_u / table.magnitude
        data = (table.frequency_hz, table.magnitude, phase, magnitude_u, phase_u)
        return cls(model, quantity, data, polar=True, has_phase=table.phase_rad is not None)

    def with_random_effect(self, error: float) -> FrequencyProblem:
        """Return the problem of records with a relative error of the model added to the noise."""
        frequency, reference, response, deviation = self.data
        return replace(
            self,
            data=(frequency, reference, response, np.hypot(deviation, error * np.abs(response))),
        )

    def residual(self, z: Any, coordinates: Coordinates) -> Any:
        """Return the weighted residual, shape (equations,), as the module defines it.

        ``z`` may be traced.
        """
        return self._residual_of(
            coordinates.model.frequency_response(
                coordinates.physical(z), self.data[0], self.quantity
            )
        )

    def _residual_of(self, model: Any) -> Any:
        """Return the weighted residual of a response, shape (equations,)."""
        xp = array_library(model)
        if not self.polar:
            _, x, y, deviation = self.data
            scaled = (y - model * x) / deviation
            return xp.concatenate([xp.real(scaled), xp.imag(scaled)])
        _, magnitude, phase, magnitude_u, phase_u = self.data
        radial = (xp.abs(model) - magnitude) / magnitude_u
        if not self.has_phase:
            return radial
        return xp.concatenate([radial, xp.angle(model * xp.exp(-1j * phase)) / phase_u])

    def jacobian(self, z: FloatArray, coordinates: Coordinates) -> FloatArray:
        """Return the derivative of :meth:`residual` by z, of NumPy arrays, shape (equations, p)."""
        return self._residual_and_jacobian(z, coordinates)[1]

    def _residual_and_jacobian(
        self, z: FloatArray, coordinates: Coordinates
    ) -> tuple[FloatArray, FloatArray]:
        """Return residual and derivative from one evaluation of the response."""
        model, slopes = response_and_slopes(
            coordinates.model, coordinates.values(z), self.data[0], self.quantity
        )
        residual = self._residual_of(model)
        slopes = slopes.T * coordinates.slopes(z)
        if not self.polar:
            scaled = -slopes * (self.data[1] / self.data[3])[:, None]
            return residual, np.concatenate([scaled.real, scaled.imag])
        relative = slopes / model[:, None]
        radial = relative.real * (np.abs(model) / self.data[3])[:, None]
        if not self.has_phase:
            return residual, radial
        return residual, np.concatenate([radial, relative.imag / self.data[4][:, None]])

    def normal(self, z: FloatArray, coordinates: Coordinates) -> Local:
        """Return cost, gradient and normal matrix of the weighted residual at ``z``, shape (p,)."""
        return Local.of(*self._residual_and_jacobian(z, coordinates))

    @property
    def points(self) -> int:
        """Return the number of frequencies n, repeats counted."""
        return int(self.data[0].shape[0])

    @property
    def equations(self) -> int:
        """Return the number of real residuals: 2 n, or n without phase."""
        return self.points * (2 if self.has_phase else 1)

    @property
    def band_hz(self) -> tuple[float, float]:
        """Return the lowest and highest frequency."""
        return float(np.min(self.data[0])), float(np.max(self.data[0]))

    @property
    def response(self) -> ComplexArray:
        """Return the measured complex sensitivity, shape (n,)."""
        if self.polar:
            return self.data[1] * np.exp(1j * self.data[2])
        return self.data[2] / self.data[1]

    @property
    def relative_deviation(self) -> FloatArray:
        """Return the relative standard deviation of the measured sensitivity, shape (n,)."""
        if self.polar:
            return self.data[3] / self.data[1]
        return self.data[3] / np.maximum(np.abs(self.data[2]), 1e-300)
