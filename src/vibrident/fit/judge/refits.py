"""Fits without dead records, with drift and hum as nuisance parameters, and with a scatter that was not stated.

Each step takes the attempt so far and returns it, or a better one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vibrident.fit.information import inverse_normal
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.judge.examined import departures_of, told_as_nuisances, with_nuisances
from vibrident.fit.problem import Evidence
from vibrident.fit.response.verdict import REJECTION, probability
from vibrident.fit.uncertainty.adequacy import looks_random

#: What a table's record and the result say of it.
PHASE_BY_SCATTER = "the phase's uncertainty, which the table does not state, by its scatter"


def without_dead_records(first: Fitted) -> Fitted:
    """Return the fit without records that seem dead, where that explains the others or contradicts the first."""
    others = first.evidence.without_dead_records()
    if others is None:
        return first
    better = Fitted.of(others, first.estimator, first.progress)
    chi2 = [attempt.judgement.adequacy.chi2_reduced or np.inf for attempt in (better, first)]
    # A dead record of little noise may draw the whole fit to itself, and leave the others as noise.
    left = [1.0 - attempt.judgement.explained for attempt in (better, first)]
    clearer = chi2[0] < chi2[1] / 4.0 or left[0] < left[1] / 4.0
    return better if clearer or (better.adequate and _contradicted(first, better)) else first


def _contradicted(first: Fitted, better: Fitted) -> bool:
    """Return whether a fit is not where some of its records say (Hausman 1978).

    Were all records right, the fit of all would deviate from that of some by less than the latter from the truth.
    A sharp resonance is where its ringing is read: what hides it in a dead record moves it.
    """
    estimate = better.estimate
    moved = np.array([first.values[name] - value for name, value in better.values.items()])
    moved /= estimate.coordinates.slopes(estimate.z)
    squares = float(moved @ inverse_normal(estimate.covariance) @ moved)
    return probability(squares, len(moved)) < REJECTION


def with_phase_scatter(first: Fitted) -> Fitted:
    """The fit of a table that states the magnitude's uncertainty alone: that of the phase is seen in its deviations.

    It is taken in proportion to the magnitude's. Where the deviations follow a pattern, the model does not explain the
    phase, and their size says nothing of its uncertainty.
    """
    calibration = first.evidence.calibration
    problem = first.evidence.first_look
    now = first
    table = calibration.table
    if table is None or problem is None or not problem.has_phase:
        return first
    if table.magnitude_uncertainty is None or table.phase_uncertainty_rad is not None:
        return first
    free = table.points - 0.5 * len(first.estimate.z)
    order = np.argsort(table.frequency_hz, kind="stable")
    provenance = replace(table.provenance, history=(*table.provenance.history, PHASE_BY_SCATTER))
    known = 1.0
    for _ in range(20 if free > 1.0 else 0):
        turn = np.asarray(problem.residual(now.estimate.z, now.estimate.coordinates))[
            table.points :
        ][order]
        scatter = float(np.sqrt(np.sum(turn**2) / free))
        if abs(scatter - known) < 0.01 * known or scatter == 0.0:
            return now if looks_random(turn) else first
        known = scatter
        stated = scatter * problem.relative_deviation
        told = replace(table, phase_uncertainty_rad=stated, provenance=provenance)
        again = first.anew(Evidence.gather(replace(calibration, table=told), first.evidence.model))
        now = replace(again, phase_by_scatter=True)
    return first


def beside_departures(first: Fitted) -> Fitted:
    """The fit with those departures that can be so as nuisance parameters (drift, hum), from where it stands."""
    now = first
    for _ in range(3):
        now = replace(now, departures=departures_of(now))
        records = with_nuisances(now)
        if all(kept is record for kept, record in zip(records, now.evidence.records, strict=True)):
            break
        other = now.anew(now.evidence.with_records(records))
        # A misfit has tones and drifts, too; and what has more unknowns does not explain less, unless it went astray.
        less = other.judgement.explained < now.judgement.explained
        if not other.adequate and (less or not now.adequate):
            break
        now = replace(other, told=(*now.told, told_as_nuisances(now)))
    return now
