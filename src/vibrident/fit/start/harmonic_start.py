"""Start value of a cubic stiffness, from the third harmonics of the sine records.

At the linear fit the network's derivative by the stiffness is known, sample by sample. Its
component at three times the excitation belongs to the stiffness alone, for any linear parameters:

    k3 = Re Σ J*(3f) r(3f) / Σ |J(3f)|²,   J = ∂y/∂k3, r the residual, summed over the sine records.
"""

from __future__ import annotations

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.problem import Evidence
from vibrident.fit.problem.time_domain import TimeProblem
from vibrident.physics.network.sensitivity import NormalEquations


def with_harmonic_start(
    problem: TimeProblem, normal: NormalEquations, evidence: Evidence, z: FloatArray
) -> FloatArray:
    """Return coordinates with the stiffness that the third harmonics indicate.

    Args:
        problem: the records.
        normal: normal equations at ``z``, where the stiffness is zero.
        evidence: with the tones of the sine records.
        z: shape (p,).

    Returns:
        Shape (p,); ``z`` itself without sine records.
    """
    if evidence.tones is None:
        return z
    index = [spec.kind for spec in problem.layout.model.parameters].index("inverse_square")
    predicted = problem.by_record(normal.response)
    slopes = problem.by_record(normal.columns[index])
    product = 0.0
    power = 0.0
    for number, frequency in zip(evidence.tones.record, evidence.tones.frequency_hz, strict=True):
        record = problem.records[number]
        if 3.0 * frequency > 0.4 * record.sampling_rate_hz:
            continue  # the record hardly shows it
        used = record.mask & np.isfinite(predicted[number])
        turn = np.exp(-6j * np.pi * frequency * record.time_s[used]) * np.hanning(int(used.sum()))
        slope = np.sum(slopes[number][used] * turn)
        product += float(
            np.real(np.conj(slope) * np.sum((record.response - predicted[number])[used] * turn))
        )
        power += float(np.abs(slope) ** 2)
    return z if power == 0.0 else z + np.eye(len(z))[index] * (product / power)
