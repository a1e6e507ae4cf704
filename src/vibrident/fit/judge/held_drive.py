"""Fit of a drive that is held between samples; its edges' instants are a nuisance parameter."""

from __future__ import annotations

import math
from dataclasses import replace

from vibrident.base.amounts import amount
from vibrident.base.errors import VibridentError
from vibrident.data.records import SystematicEffect
from vibrident.fit.estimators.kinds.ipnn import Ipnn
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.judge.departure_report import departure_names
from vibrident.fit.uncertainty.parameters import standard_uncertainties
from vibrident.physics.models import ADD_ONS, installed

DELAY = "delay"
ALIASING = "aliasing"  # of motion; a commanded step has any frequency
HELD_REASON = "the drive is held between its samples, as stairs: zero-order hold"


def fit_held_drive(fitted: Fitted) -> Fitted:
    """Return the fit of the same records with their drive held from sample to sample.

    The converters of drive and response have no common instant. Where the data show that the edges
    lie beside the samples, by less than a step, the fit puts them there, and the budget has their
    uncertainty. A model with a delay contains this shift already.
    """
    findings = tuple(finding for finding in fitted.evidence.findings if finding.code != ALIASING)
    evidence = replace(fitted.evidence, findings=findings)
    fitted = replace(fitted, evidence=evidence, reason=HELD_REASON)
    delay_s = _edge_delay(fitted)
    if delay_s is None:
        return fitted
    estimator = fitted.estimator
    assert isinstance(estimator, Ipnn)
    rate_hz = evidence.records[0].sampling_rate_hz
    value, u = delay_s
    pattern = tuple((hz, 0.0, -2.0 * math.pi * hz) for hz in (0.0, 0.5 * rate_hz))
    effect = SystematicEffect("the instants of the drive's edges", "edges", u, pattern=pattern)
    delayed = replace(estimator, late_samples=value * rate_hz)
    shifted = Fitted.from_evidence(replace(evidence, effects=(effect,)), delayed, fitted.progress)
    when = "after" if value > 0.0 else "before"
    edges = f"edges {amount(abs(value), 's', 3)} ± {amount(u, 's', 1)} {when} the samples"
    return replace(shifted, reason=f"{HELD_REASON}, {edges}")


def _edge_delay(fitted: Fitted) -> tuple[float, float] | None:
    """Return the time, and its u, by which the edges come after the samples, s.

    None where the data do not show it.
    """
    evidence = fitted.evidence
    if evidence.model.has_delay or (fitted.adequate and DELAY not in departure_names(fitted)):
        return None
    if len({record.sampling_rate_hz for record in evidence.records}) > 1:
        return None
    model = installed(f"{evidence.model.name}+{ADD_ONS[DELAY].name}")
    if model is None:
        return None
    # A fit that was rejected is no start: its parameters stand in for the delay.
    start = {**fitted.values, DELAY: 0.0} if fitted.adequate else None
    try:
        delayed = fitted.once(replace(evidence, model=model, start=start))
    except VibridentError:
        return None
    estimate = delayed.estimate
    delay_s = delayed.values[DELAY]
    if not delayed.adequate or abs(delay_s) >= evidence.records[0].sampling_interval_s:
        return None
    u = standard_uncertainties(estimate.coordinates, estimate.z, estimate.covariance)
    return delay_s, u[DELAY]
