"""Huber's estimator on the responses in frequency.

Points beyond two standard deviations count by their distance.

P. J. Huber, Robust estimation of a location parameter, Ann. Math. Stat. 35 (1964) 73-101.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vibrident.base.errors import ModelError
from vibrident.fit.estimators import Estimate, Estimator
from vibrident.fit.estimators.base import Setting
from vibrident.fit.information import inverse_normal
from vibrident.fit.optimise import levenberg_marquardt, silent
from vibrident.fit.problem import Coordinates, Local
from vibrident.fit.start.start import find_start

ROUNDS = 10


@dataclass(frozen=True)
class Huber(Estimator):
    """Settings: ``limit``, the standard deviations beyond which a point counts for less."""

    name: ClassVar[str] = "huber"
    title: ClassVar[str] = "robust least squares"
    settings: ClassVar = {"limit": Setting(default="2")}

    limit: float = 2.0

    def fit(self, evidence, progress=silent):
        """Fit the responses in frequency, reweighted by the residual until the fit stays."""
        first = evidence.first_look
        if first is None:
            raise ModelError(
                "Huber's estimator needs sine records, or a table.",
                remedy="use the estimator 'auto'",
            )
        begin = find_start(first, evidence.model)
        coordinates = Coordinates.at(evidence.model, begin.values, first.band_hz)
        z, weight = coordinates.first, np.ones(first.equations)

        def objective(z, weight):
            residual, slopes = first.residual(z, coordinates), first.jacobian(z, coordinates)
            return Local.of(weight * residual, weight[:, None] * slopes)

        for _ in range(ROUNDS):
            trace = levenberg_marquardt(objective, z, weight, progress=progress)
            z = trace.last
            weight = np.sqrt(
                np.minimum(
                    1.0, self.limit / np.maximum(np.abs(first.residual(z, coordinates)), 1e-12)
                )
            )
        covariance = inverse_normal(objective(z, weight).matrix)
        return Estimate(
            self.name,
            coordinates,
            z,
            covariance,
            np.inf,
            trace,
            {"limit": self.limit},
            evidence.tones,
            begin=begin,
            equations=first.equations,
        )


HUBER = Huber()
