"""Steps that follow the curved valleys of a residual.

Where parameters trade against each other, as two modes above the band do, a straight step leaves the valley at once,
and hundreds of short ones are needed. The second derivative of the residual along a step bends it to a parabola
(geodesic acceleration; Transtrum & Sethna, arXiv:1201.5885). The residual of a linear sensor is linear in the sensor's
response, so that a few hundred points of the response say how it bends, and no pass over the records is needed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.optimise import LEAST_SHOWN, Bent
from vibrident.fit.problem import Coordinates, Evidence


def geodesic_steps(evidence: Evidence, coordinates: Coordinates, noise: FloatArray) -> Bent | None:
    """Where a damped step from z leads to along the valley: to the end of the parabola that begins with it.

    None for a nonlinear model, which has no response that would say how.

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
    problem = replace(evidence.first_look, data=(frequency, reference, response, deviation))

    def bent(z: FloatArray, step: FloatArray, damping: float) -> FloatArray:
        probe = 0.1 * step
        with np.errstate(all="ignore"):  # a step may be far too long
            back, here, ahead = (problem.residual(at, coordinates) for at in (z - probe, z, z + probe))
            second = (ahead - 2.0 * here + back) / 0.1**2
            slopes = problem.jacobian(z, coordinates)
            matrix, gradient = slopes.T @ slopes + damping * np.eye(len(z)), slopes.T @ second
        if not np.all(np.isfinite(matrix)) or not np.all(np.isfinite(gradient)):
            return z + step
        size = np.sqrt(np.diag(matrix))
        size = np.where(size > 0.0, size, 1.0)
        bend = -0.5 * np.linalg.pinv(matrix / size[:, None] / size, LEAST_SHOWN, hermitian=True) @ (gradient / size)
        # A step that would bend by more of its length goes straight on, and is shortened if it fails.
        slight = np.linalg.norm(bend) <= 0.4 * np.linalg.norm(step * size)
        return z + step + (bend / size if slight else 0.0)

    return bent
