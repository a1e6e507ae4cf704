"""The fit at its points, linearised at the estimate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vibrident.fit.estimators import Estimate
from vibrident.fit.judge.adequacy import Judgement
from vibrident.fit.problem import Evidence
from vibrident.fit.uncertainty.adequacy import Adequacy, Points
from vibrident.fit.uncertainty.linearised import Linearised


def linearised(evidence: Evidence, estimate: Estimate, judgement: Judgement) -> Linearised:
    """The fit at all excited frequencies, linearised at the estimate."""
    if evidence.calibration.table is not None:
        problem = evidence.first_look
        assert problem is not None
        frequency, _, _, magnitude_u, phase_u = problem.data
        measured = judgement.adequacy.measured
        data = (frequency, np.abs(measured), np.angle(measured), magnitude_u, phase_u)
        return Linearised.of_table(estimate.coordinates, estimate.z, replace(problem, data=data))
    if estimate.findings.decays is not None:
        return Linearised.of_nothing(estimate.coordinates, estimate.z, evidence.quantity)
    return of_points(evidence, estimate, judgement.adequacy)


def of_points(evidence: Evidence, estimate: Estimate, points: Adequacy | Points) -> Linearised:
    """The same of some points."""
    return Linearised.of_points(
        estimate.coordinates,
        estimate.z,
        evidence.quantity,
        points.frequency_hz,
        points.measured,
        points.relative_deviation,
    )
