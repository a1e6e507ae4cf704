"""Steps that follow the curved valleys of a residual.

Where parameters trade against each other, as two modes above the band do, a straight step leaves the valley at once,
and hundreds of short ones are needed. The second derivative of the residual along a step bends it to a parabola
(geodesic acceleration; Transtrum & Sethna, arXiv:1201.5885). The residual of a linear sensor is linear in the sensor's
response, so that a few hundred points of the response say how it bends, and no pass over the records is needed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.descent.optimise import LEAST_SHOWN
from vibrident.fit.problem import Coordinates, Evidence, FrequencyProblem

#: Part of a step over which its curvature is measured.
PROBE = 0.1
#: A step that would bend by more than this part of its length goes straight on, and is shortened if it fails.
MOST_BENT = 0.4


@dataclass(frozen=True, eq=False)
class GeodesicSteps:
    """Where a step leads to along the valley.

    Attributes:
        problem: points of the response, weighted as the residual is.
        coordinates: the map from z to parameters.
    """

    problem: FrequencyProblem
    coordinates: Coordinates

    @classmethod
    def of_records(cls, evidence: Evidence, coordinates: Coordinates, noise: FloatArray) -> GeodesicSteps | None:
        """For the residual of a network; None for a nonlinear model, which has no response that would say how.

        Args:
            evidence: records, at least one of them with a reference.
            coordinates: the map from z to parameters.
            noise: standard deviation of each record's residual, shape (records,).
        """
        if not evidence.model.is_linear or evidence.first_look is None:
            return None
        frequency, reference, response, _ = evidence.first_look.data
        owner = np.concatenate([part.record for part in (evidence.tones, evidence.bands) if part is not None])
        samples = np.array([float(record.mask.sum()) for record in evidence.records])
        deviation = (noise * np.sqrt(2.0 / np.maximum(samples, 1.0)))[owner]
        return cls(replace(evidence.first_look, data=(frequency, reference, response, deviation)), coordinates)

    def __call__(self, z: FloatArray, step: FloatArray, damping: float) -> FloatArray:
        """Coordinates at the end of the parabola that begins with a step of this damping, shape (p,)."""
        with np.errstate(all="ignore"):  # a step may be far too long
            back, here, ahead = (
                self.problem.residual(z + part * step, self.coordinates) for part in (-PROBE, 0.0, PROBE)
            )
            second = (ahead - 2.0 * here + back) / PROBE**2
            slopes = self.problem.jacobian(z, self.coordinates)
            matrix, gradient = slopes.T @ slopes + damping * np.eye(len(z)), slopes.T @ second
        if not np.all(np.isfinite(matrix)) or not np.all(np.isfinite(gradient)):
            return z + step
        size = np.sqrt(np.diag(matrix))
        size = np.where(size > 0.0, size, 1.0)
        bend = -0.5 * np.linalg.pinv(matrix / size[:, None] / size, LEAST_SHOWN, hermitian=True) @ (gradient / size)
        slight = np.linalg.norm(bend) <= MOST_BENT * np.linalg.norm(step * size)
        return z + step + (bend / size if slight else 0.0)
