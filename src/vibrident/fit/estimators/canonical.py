"""An estimate in the one form of its model (:mod:`vibrident.physics.models.labels`), with the covariance along."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.estimators.base import Estimate
from vibrident.fit.estimators.findings import Findings
from vibrident.fit.noise.spectral_noise import doubtful
from vibrident.fit.problem import Coordinates
from vibrident.physics.models.labels import canonical, rule, slopes, upright


def canonically_labelled(estimate: Estimate) -> Estimate:
    """The estimate with the labels that the rule gives; itself where it has them.

    The response is the same to rounding, and so is all that was predicted from it.
    """
    old, model = estimate.coordinates, estimate.coordinates.model
    values = upright(model, old.values(estimate.z))
    change = rule(model, values)
    if change is None:
        return estimate
    new = Coordinates.at(
        model,
        {name: float(value) for name, value in change(values).items()},
        (float(old.band_hz[0]), float(old.band_hz[1])),
        float(old.response_size),
    )
    z = new.first
    scale = new.slopes(z)[:, None]  # zero at the end of a range, where nothing moves
    turn = slopes(model, change, values) * old.slopes(estimate.z)
    turn = np.divide(turn, scale, out=np.zeros_like(turn), where=scale != 0.0)
    covariance = turn @ estimate.covariance @ turn.T
    path = np.array(
        [new.place(canonical(model, old.values(at))) for at in estimate.trace.coordinates]
    )
    path[-1] = z
    begin = estimate.begin
    if begin is not None:
        begin = replace(
            begin,
            values=canonical(model, begin.values),
            path=tuple(canonical(model, at) for at in begin.path),
            others=tuple((canonical(model, at), cost) for at, cost in begin.others),
        )
    return replace(
        estimate,
        coordinates=new,
        z=z,
        covariance=covariance,
        trace=replace(estimate.trace, coordinates=path),
        begin=begin,
        findings=_turned(estimate.findings, turn, covariance),
    )


def _turned(findings: Findings, turn: FloatArray, covariance: FloatArray) -> Findings:
    """Findings whose statements on each parameter are converted to the new parameters, with their new covariance."""
    noise = findings.noise
    if noise is None or not noise.pulls.size:
        return findings
    pulls = noise.pulls @ turn.T
    return replace(findings, noise=replace(noise, pulls=pulls, doubt=doubtful(pulls, covariance)))
