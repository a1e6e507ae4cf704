"""The residual in frequency: measured complex responses against the model's, weighted by their noise.

Two kinds of data, one form. Records give complex amplitudes X (reference) and Y (response) of each tone with the covariance
of their noise; the errors-in-variables residual is (Pintelon & Schoukens 2012, sec. 9.11)

    e = Y − H X,   var e = C_yy − 2 Re(H* C_yx) + |H|² C_xx,

its sum of squares over its variance the maximum-likelihood cost once the unknown true X is eliminated. A table gives |H|
and its phase with standard uncertainties u; the residual is in those coordinates, (|H| − m)/u_m and (arg H − φ)/u_φ.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vibrident.backend import jnp
from vibrident.measure.response import MeasuredResponse
from vibrident.models import SensorModel
from vibrident.problem.coordinates import Coordinates
from vibrident.records import Quantity, ResponseTable


@dataclass(frozen=True, eq=False)
class FrequencyProblem:
    """Complex responses of one sensor at n points.

    Attributes:
        model: the sensor model.
        quantity: what the reference is.
        polar: True for a table, whose uncertainties belong to magnitude and phase.
        has_phase: False for a table of magnitudes alone.
        data: arrays of the residual: (f, X, Y, C_xx, C_yy, C_yx) or (f, m, φ, u_m, u_φ), each of shape (n,).
    """

    model: SensorModel
    quantity: Quantity
    polar: bool
    has_phase: bool
    data: tuple[Any, ...]

    @classmethod
    def of_measured(cls, measured: MeasuredResponse, model: SensorModel, quantity: Quantity) -> FrequencyProblem:
        """The errors-in-variables problem of what the records say at each excited frequency."""
        m = measured
        data = (m.frequency_hz, m.reference, m.response, m.reference_variance, m.response_variance, m.covariance)
        return cls(model, quantity, False, True, data)

    @classmethod
    def of_table(cls, table: ResponseTable, model: SensorModel, quantity: Quantity) -> FrequencyProblem:
        """The problem of a table; where it states no uncertainty, 1 % and 0.01 rad stand for equal relative weights."""
        magnitude_u = table.magnitude_uncertainty
        if magnitude_u is None:
            magnitude_u = 0.01 * table.magnitude
        has_phase = table.phase_rad is not None
        phase = table.phase_rad if table.phase_rad is not None else np.zeros(table.points)
        phase_u = table.phase_uncertainty_rad
        if phase_u is None:
            phase_u = magnitude_u / table.magnitude
        return cls(model, quantity, True, has_phase, (table.frequency_hz, table.magnitude, phase, magnitude_u, phase_u))

    @property
    def points(self) -> int:
        """Number of frequencies n, repeats counted."""
        return int(self.data[0].shape[0])

    @property
    def equations(self) -> int:
        """Number of real residuals: 2 n, or n without phase."""
        return self.points * (2 if self.has_phase else 1)

    @property
    def band_hz(self) -> tuple[float, float]:
        """Lowest and highest frequency."""
        return float(np.min(self.data[0])), float(np.max(self.data[0]))


def response_residual(z: Any, coordinates: Coordinates, polar: bool, has_phase: bool, quantity: Quantity, data: Any) -> Any:
    """Weighted residual, shape (equations,); see the module's text."""
    parameters = coordinates.physical(z)
    if polar:
        frequency, magnitude, phase, magnitude_u, phase_u = data
        model = coordinates.model.frequency_response(parameters, frequency, quantity)
        radial = (jnp.abs(model) - magnitude) / magnitude_u
        if not has_phase:
            return radial
        turn = jnp.angle(model * jnp.exp(-1j * phase))
        return jnp.concatenate([radial, turn / phase_u])
    frequency, x, y, cxx, cyy, cyx = data
    model = coordinates.model.frequency_response(parameters, frequency, quantity)
    error = y - model * x
    variance = cyy - 2.0 * jnp.real(jnp.conj(model) * cyx) + jnp.abs(model) ** 2 * cxx
    # Variances are those of the real and of the imaginary part; they stay positive, and a floor guards rounding.
    scaled = error / jnp.sqrt(jnp.maximum(variance, 1e-30 * jnp.abs(y) ** 2))
    return jnp.concatenate([jnp.real(scaled), jnp.imag(scaled)])
