"""The fit at the excited frequencies, linearised around an estimate: where it would move without fitting again.

With H the model and M the measured response, log(M/H) ≈ J dz + noise, J = ∂ log H/∂z.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibrident.data.records import BoolArray, FloatArray, Quantity
from vibrident.fit.information import inverse_normal
from vibrident.fit.problem import Coordinates
from vibrident.fit.problem.frequency_domain import FrequencyProblem
from vibrident.fit.response.response import ComplexArray
from vibrident.physics.models.slopes import response_and_slopes
from vibrident.result.sensor import IdentifiedSensor


@dataclass(frozen=True, eq=False)
class Linearised:
    """Weighted rows ``matrix @ dz ≈ rest``, two a point (magnitude, phase), or one where there is no phase."""

    coordinates: Coordinates  # the map from z to parameters
    z: FloatArray  # the estimate, shape (p,)
    quantity: Quantity  # of the reference
    frequency_hz: FloatArray  # of each row, shape (m,)
    matrix: FloatArray  # shape (m, p), in standard deviations
    rest: (
        FloatArray  # what the measurement has beyond the model, in standard deviations, shape (m,)
    )
    is_phase: BoolArray  # whether a row is of the phase, shape (m,)
    weight: FloatArray  # one over the standard deviation of log H, shape (m,)

    @classmethod
    def of_points(
        cls,
        coordinates: Coordinates,
        z: FloatArray,
        quantity: Quantity,
        frequency_hz: FloatArray,
        measured: ComplexArray,
        relative_deviation: FloatArray,
    ) -> Linearised:
        """Rows of complex points with the relative standard deviation of their real part, each of shape (n,)."""
        response, slopes = log_slopes(coordinates, z, quantity, frequency_hz)
        ratio = measured / response - 1.0
        scaled = slopes / relative_deviation[:, None]
        rest = ratio / relative_deviation
        return cls(
            coordinates,
            z,
            quantity,
            np.concatenate([frequency_hz, frequency_hz]),
            np.concatenate([scaled.real, scaled.imag]),
            np.concatenate([rest.real, rest.imag]),
            np.repeat([False, True], len(frequency_hz)),
            np.tile(1.0 / relative_deviation, 2),
        )

    @classmethod
    def of_nothing(cls, coordinates: Coordinates, z: FloatArray, quantity: Quantity) -> Linearised:
        """No rows: free decays have no response in frequency."""
        none = np.zeros(0)
        return cls(
            coordinates, z, quantity, none, np.zeros((0, len(z))), none, none.astype(bool), none
        )

    @classmethod
    def of_table(
        cls, coordinates: Coordinates, z: FloatArray, problem: FrequencyProblem
    ) -> Linearised:
        """Rows of a table's magnitudes, and of its phases where it has them."""
        frequency, magnitude, phase, magnitude_u, phase_u = (
            np.asarray(part) for part in problem.data
        )
        response, slopes = log_slopes(coordinates, z, problem.quantity, frequency)
        size = np.abs(response)
        turn = np.angle(np.exp(1j * phase) / (response / size))
        radial = size / magnitude_u
        rows = slice(None if problem.has_phase else len(frequency))
        return cls(
            coordinates,
            z,
            problem.quantity,
            np.tile(frequency, 2)[rows],
            np.concatenate([slopes.real * radial[:, None], slopes.imag / phase_u[:, None]])[rows],
            np.concatenate([(magnitude - size) / magnitude_u, turn / phase_u])[rows],
            np.repeat([False, True], len(frequency))[rows],
            np.concatenate([radial, 1.0 / phase_u])[rows],
        )

    def shift(self, rest: FloatArray) -> FloatArray:
        """Least-squares shift dz, shape (p,), of rows that have this beyond the model, shape (m,)."""
        return inverse_normal(self.matrix.T @ self.matrix) @ (self.matrix.T @ rest)


def log_slopes(
    coordinates: Coordinates, z: FloatArray, quantity: Quantity, frequency_hz: FloatArray
) -> tuple[ComplexArray, ComplexArray]:
    """Model response, shape (n,), and ∂ log H/∂z, shape (n, p)."""
    response, slopes = response_and_slopes(
        coordinates.model, coordinates.values(z), frequency_hz, quantity
    )
    return response, slopes.T * coordinates.slopes(z) / response[:, None]


def fitted_sensor(
    coordinates: Coordinates, z: FloatArray, covariance: FloatArray, quantity: Quantity
) -> IdentifiedSensor:
    """The sensor that a fit found, with the covariance of z carried over to its parameters."""
    slopes = coordinates.slopes(z)
    values = coordinates.values(z)
    return IdentifiedSensor(
        coordinates.model, values, covariance * np.outer(slopes, slopes), quantity
    )
