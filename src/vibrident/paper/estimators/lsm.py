"""Estimator ``lsm``: the paper's least squares on 1/H, which is linear in the sensor's constants.

    1/H = (ωn² − ω² + 2 j δ ωn ω)/K        (times s for a velocity pickup)

``plain`` weighs all points of 1/H alike, as the paper does: points of small sensitivity then rule.
``weighted`` divides by the uncertainty of 1/H, u(1/H) = u(H)/|H|². A delay makes the problem
nonlinear; the same residual is then minimised from the linear start. The covariance is propagated
from the responses' uncertainty through the estimator, whatever the weights.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, ClassVar, Literal

import numpy as np

from vibrident.base.errors import ModelError
from vibrident.data.records import FloatArray, Quantity
from vibrident.fit.estimators.base import Estimate, Estimator, Setting
from vibrident.fit.estimators.kinds.ml import responses, weighted_problem
from vibrident.fit.estimators.residual_tones import network_problem, residual_tones
from vibrident.fit.information import inverse_normal
from vibrident.fit.optimise import Progress, levenberg_marquardt, silent
from vibrident.fit.problem import Coordinates, Evidence, FrequencyProblem, Local
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.start.start import find_start
from vibrident.physics.models.slopes import response_and_slopes


@dataclass(frozen=True)
class LeastSquares(Estimator):
    """Settings of the estimator ``lsm``.

    Attributes:
        weighting: ``weighted`` by the uncertainty of 1/H, or ``plain`` as in the paper.

    Examples:
        >>> import vibrident
        >>> hz = [100, 300, 650, 1000]
        >>> calibration = vibrident.simulate(frequencies_hz=hz, samples=2000, response_noise=1e-3)
        >>> plain = vibrident.LeastSquares(weighting="plain")
        >>> vibrident.identify(calibration, estimator=plain).estimator
        'lsm'
    """

    name: ClassVar[str] = "lsm"
    title: ClassVar[str] = "least squares on the response"
    rank: ClassVar[int] = 2
    settings: ClassVar[Mapping[str, Setting]] = MappingProxyType({"weighting": Setting()})

    weighting: Literal["plain", "weighted"] = "weighted"

    def fit(self, evidence: Evidence, progress: Progress = silent) -> Estimate:
        """Fit 1/H.

        Raises:
            ModelError: there is no phase, a record is not a sine, or the model is nonlinear.
        """
        first = responses(self.name, evidence)
        if not first.has_phase:
            raise ModelError(
                f"The estimator {self.name!r} needs complex responses.",
                expected="sine records, or a table with phase",
                found="a table of magnitudes",
                where="estimator",
                remedy="use the estimator 'auto'",
            )
        model = evidence.model
        begin = find_start(first, model)
        coordinates = Coordinates.at(model, begin.values, first.band_hz)
        problem = first
        freedom = np.inf
        tones = None
        z = coordinates.first
        network = None if evidence.tones is None else network_problem(evidence, begin.values)
        # The tones are cleaned at the start values, and once more at the fit.
        for number in range(1 if evidence.tones is None else 2):
            if evidence.tones is not None:
                if number and not model.has_network:
                    network = network_problem(evidence, coordinates.values(z))
                tones = residual_tones(evidence, network, coordinates, z)
                problem = weighted_problem(tones, coordinates, z, evidence)
                freedom = float(np.sum(tones.degrees_of_freedom))
            weight = _weight(problem, self.weighting)
            args: tuple[Any, ...] = (
                coordinates,
                evidence.quantity,
                (problem.data[0], problem.response, weight),
            )
            trace = levenberg_marquardt(_objective, z, args, tolerance=1e-12, progress=progress)
            z = trace.last
        _, jacobian = inverse_residual(z, *args)
        # Residuals w δ(1/H) have the deviation w u(H)/|H|² in their real and imaginary parts alike.
        deviation = np.tile(weight * problem.relative_deviation / np.abs(problem.response), 2)
        gain = inverse_normal(jacobian.T @ jacobian) @ jacobian.T
        covariance = (gain * deviation**2) @ gain.T
        settings = {"weighting": self.weighting}
        equations = problem.equations
        return Estimate(
            self.name,
            coordinates,
            z,
            covariance,
            freedom,
            trace,
            settings,
            tones,
            begin=begin,
            equations=equations,
        )


LSM = LeastSquares()


def _weight(problem: FrequencyProblem, weighting: str) -> FloatArray:
    size = np.abs(problem.response)
    if weighting == "plain":
        return np.full(problem.points, float(np.median(size)))
    return size / problem.relative_deviation


def _objective(z: FloatArray, args: Any) -> Local:
    return Local.of(*inverse_residual(z, *args))


def inverse_residual(
    z: FloatArray,
    coordinates: Coordinates,
    quantity: Quantity,
    data: tuple[FloatArray, ComplexArray, FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """Return the paper's residual w (1/H_model − 1/H), shape (2 n,), and its slopes.

    ``data``: (f, H, w). Without a delay it is linear in 1/K, 2 δ ωn/K and ωn²/K, which makes the
    method simple.
    """
    frequency, response, weight = data
    model, slopes = response_and_slopes(
        coordinates.model, coordinates.values(z), frequency, quantity
    )
    residual = weight * (1.0 / model - 1.0 / response)
    jacobian = -(weight / model**2)[:, None] * slopes.T * coordinates.slopes(z)
    return np.concatenate([residual.real, residual.imag]), np.concatenate(
        [jacobian.real, jacobian.imag]
    )
