"""An estimate in the canonical form of its model's labels, with its covariance.

The labels are those of :mod:`vibrident.physics.models.labels`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.estimators.base import Estimate
from vibrident.fit.estimators.findings import Findings
from vibrident.fit.noise.spectral_noise import doubtful
from vibrident.fit.problem import Coordinates
from vibrident.physics.models.labels import canonical, rule, slopes, with_positive_damping


def canonically_labelled(estimate: Estimate) -> Estimate:
    """Return the estimate with the labels that the rule gives, or itself where it has them.

    Response and predictions stay the same to rounding.
    """
    previous = estimate.coordinates
    model = previous.model
    values = with_positive_damping(model, previous.values(estimate.z))
    change = rule(model, values)
    if change is None:
        return estimate
    coordinates = Coordinates.at(
        model,
        canonical(model, values),
        (float(previous.band_hz[0]), float(previous.band_hz[1])),
        float(previous.response_size),
    )
    z = coordinates.first
    scale = coordinates.slopes(z)[:, None]  # zero at the end of a range, where nothing moves
    conversion = slopes(model, change, values) * previous.slopes(estimate.z)
    conversion = np.divide(conversion, scale, out=np.zeros_like(conversion), where=scale != 0.0)
    covariance = conversion @ estimate.covariance @ conversion.T
    path = np.array(
        [
            coordinates.place(canonical(model, previous.values(values_at)))
            for values_at in estimate.trace.coordinates
        ]
    )
    path[-1] = z
    begin = estimate.begin
    if begin is not None:
        begin = replace(
            begin,
            values=canonical(model, begin.values),
            path=tuple(canonical(model, values_at) for values_at in begin.path),
            other_optima=tuple(
                (canonical(model, values_at), cost) for values_at, cost in begin.other_optima
            ),
        )
    return replace(
        estimate,
        coordinates=coordinates,
        z=z,
        covariance=covariance,
        trace=replace(estimate.trace, coordinates=path),
        begin=begin,
        findings=_convert_findings(estimate.findings, conversion, covariance),
    )


def _convert_findings(
    findings: Findings, conversion: FloatArray, covariance: FloatArray
) -> Findings:
    """Return findings with each statement on a parameter converted to the new parameters.

    ``covariance``: of the new ones.
    """
    noise = findings.noise
    if noise is None or not noise.pulls.size:
        return findings
    pulls = noise.pulls @ conversion.T
    return replace(findings, noise=replace(noise, pulls=pulls, doubt=doubtful(pulls, covariance)))
