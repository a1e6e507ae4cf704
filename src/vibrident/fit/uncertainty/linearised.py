"""The fit at the excited frequencies, linearised around an estimate.

It shows how the estimate would move without another fit. With H the model and M the measured
response, log(M/H) ≈ J dz + noise, J = ∂ log H/∂z.
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
    """Weighted rows ``matrix @ dz ≈ residual`` of the log response at an estimate.

    There are two rows a point (magnitude, phase), or one where there is no phase.
    """

    coordinates: Coordinates  # the map from z to parameters
    z: FloatArray  # the estimate, shape (p,)
    quantity: Quantity  # of the reference
    frequency_hz: FloatArray  # of each row, shape (m,)
    matrix: FloatArray  # shape (m, p), in standard deviations
    residual: FloatArray  # measurement less model, in standard deviations, shape (m,)
    is_phase: BoolArray  # whether a row is of the phase, shape (m,)
    weight: FloatArray  # one over the standard deviation of log H, shape (m,)

    @classmethod
    def from_points(
        cls,
        coordinates: Coordinates,
        z: FloatArray,
        quantity: Quantity,
        frequency_hz: FloatArray,
        measured: ComplexArray,
        relative_deviation: FloatArray,
    ) -> Linearised:
        """Build two rows a point from complex responses.

        All arrays have shape (n,); ``relative_deviation``: standard deviation of the real part of
        the response over its size.
        """
        response, slopes = log_slopes(coordinates, z, quantity, frequency_hz)
        ratio = measured / response - 1.0
        scaled = slopes / relative_deviation[:, None]
        residual = ratio / relative_deviation
        return cls(
            coordinates,
            z,
            quantity,
            np.concatenate([frequency_hz, frequency_hz]),
            np.concatenate([scaled.real, scaled.imag]),
            np.concatenate([residual.real, residual.imag]),
            np.repeat([False, True], len(frequency_hz)),
            np.tile(1.0 / relative_deviation, 2),
        )

    @classmethod
    def from_table(
        cls, coordinates: Coordinates, z: FloatArray, problem: FrequencyProblem
    ) -> Linearised:
        """Build rows of a table's magnitudes, and of its phases where it has them."""
        frequency, magnitude, phase, magnitude_u, phase_u = (
            np.asarray(array) for array in problem.data
        )
        response, slopes = log_slopes(coordinates, z, problem.quantity, frequency)
        size = np.abs(response)
        phase_error = np.angle(np.exp(1j * phase) / (response / size))
        relative_precision = size / magnitude_u
        rows = slice(None if problem.has_phase else len(frequency))
        return cls(
            coordinates,
            z,
            problem.quantity,
            np.tile(frequency, 2)[rows],
            np.concatenate(
                [slopes.real * relative_precision[:, None], slopes.imag / phase_u[:, None]]
            )[rows],
            np.concatenate([(magnitude - size) / magnitude_u, phase_error / phase_u])[rows],
            np.repeat([False, True], len(frequency))[rows],
            np.concatenate([relative_precision, 1.0 / phase_u])[rows],
        )

    def rows_of(self, change: ComplexArray) -> FloatArray:
        """Return changes of log H as weighted rows, shape (m, K), from their values, (m, K)."""
        parts = np.where(self.is_phase[:, None], np.imag(change), np.real(change))
        return parts * self.weight[:, None]

    def shift(self, residual: FloatArray) -> FloatArray:
        """Return the least-squares shift dz, shape (p,), of rows with this residual, shape (m,)."""
        return inverse_normal(self.matrix.T @ self.matrix) @ (self.matrix.T @ residual)


def log_slopes(
    coordinates: Coordinates, z: FloatArray, quantity: Quantity, frequency_hz: FloatArray
) -> tuple[ComplexArray, ComplexArray]:
    """Return the model's response, shape (n,), and ∂ log H/∂z, shape (n, p)."""
    response, slopes = response_and_slopes(
        coordinates.model, coordinates.values(z), frequency_hz, quantity
    )
    return response, slopes.T * coordinates.slopes(z) / response[:, None]


def fitted_sensor(
    coordinates: Coordinates, z: FloatArray, covariance: FloatArray, quantity: Quantity
) -> IdentifiedSensor:
    """Return the sensor at z, with the covariance of z carried over to its parameters."""
    slopes = coordinates.slopes(z)
    values = coordinates.values(z)
    return IdentifiedSensor(
        coordinates.model, values, covariance * np.outer(slopes, slopes), quantity
    )
