"""Fits without dead records, with nuisance parameters, and with a scatter that was not stated.

Each step takes a fit and returns it, or a better one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vibrident.fit.descent.train import MIN_EXPLAINED_SHARE
from vibrident.fit.information import inverse_normal
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.judge.departure_report import departures_of, report_nuisances, with_nuisances
from vibrident.fit.problem import Evidence
from vibrident.fit.response.verdict import REJECTION, probability
from vibrident.fit.uncertainty.adequacy import looks_random

#: The sentence of a table's history and of the result on a phase's uncertainty by its scatter.
PHASE_BY_SCATTER = "the phase's uncertainty, which the table does not state, by its scatter"


def without_dead_records(first: Fitted) -> Fitted:
    """Return the fit without records that seem dead, where it is better than the one with them.

    It is better where it explains the other records far better, or contradicts the first fit.
    """
    moves = first.judgement.least_explained > MIN_EXPLAINED_SHARE
    evidence = first.evidence.without_dead_records(sines_alone=moves)
    if evidence is None:
        return first
    better = Fitted.from_evidence(evidence, first.estimator, first.progress)
    chi2, chi2_of_all = (
        attempt.judgement.adequacy.chi2_reduced or np.inf for attempt in (better, first)
    )
    # A dead record of little noise may draw the whole fit to itself, and leave the others as noise.
    max_unexplained = first.judgement.unexplained / 4.0
    clearer = chi2 < chi2_of_all / 4.0 or better.judgement.unexplained < max_unexplained
    return better if clearer or (better.adequate and _contradicted(first, better)) else first


def _contradicted(first: Fitted, better: Fitted) -> bool:
    """Return whether the fit of some records contradicts that of all (Hausman 1978).

    Were all records right, the two fits would differ by less than that of some records differs from
    the truth. A sharp resonance is read from its ringing, so a dead record moves it.
    """
    estimate = better.estimate
    shift = np.array([first.values[name] - value for name, value in better.values.items()])
    shift /= estimate.coordinates.slopes(estimate.z)
    squares = float(shift @ inverse_normal(estimate.covariance) @ shift)
    return probability(squares, len(shift)) < REJECTION


def with_phase_scatter(first: Fitted) -> Fitted:
    """Return the fit of a table whose phase gets its uncertainty from its deviations.

    The table states the uncertainty of its magnitudes alone; that of the phase is taken in
    proportion to it. Deviations that follow a pattern are misfit, so their size says nothing of the
    phase's uncertainty: the first fit is returned.
    """
    calibration = first.evidence.calibration
    problem = first.evidence.table_points
    current = first
    table = calibration.table
    if table is None or problem is None or not problem.has_phase:
        return first
    if table.magnitude_uncertainty is None or table.phase_uncertainty_rad is not None:
        return first
    freedom = table.points - 0.5 * len(first.estimate.z)
    order = np.argsort(table.frequency_hz, kind="stable")
    provenance = replace(table.provenance, history=(*table.provenance.history, PHASE_BY_SCATTER))
    scatter_before = 1.0
    for _ in range(20 if freedom > 1.0 else 0):
        phase_residual = problem.residual(current.estimate.z, current.estimate.coordinates)[
            table.points :
        ][order]
        scatter = float(np.sqrt(np.sum(phase_residual**2) / freedom))
        if abs(scatter - scatter_before) < 0.01 * scatter_before or scatter == 0.0:
            return current if looks_random(phase_residual) else first
        scatter_before = scatter
        stated = scatter * problem.relative_deviation
        table_with_phase = replace(table, phase_uncertainty_rad=stated, provenance=provenance)
        refit = first.anew(
            Evidence.gather(replace(calibration, table=table_with_phase), first.evidence.model)
        )
        current = replace(refit, phase_by_scatter=True)
    return first


def refit_with_departures(first: Fitted) -> Fitted:
    """Return the fit with drift and hum as nuisance parameters, where the data show them."""
    current = first
    for _ in range(3):
        current = replace(current, departures=departures_of(current))
        records = with_nuisances(current)
        if records == current.evidence.records:  # the records themselves
            break
        refit = current.anew(current.evidence.with_records(records))
        # A misfit has tones and drifts, too; and a fit with more unknowns explains less only where
        # it went astray.
        explains_less = refit.judgement.explained < current.judgement.explained
        if not refit.adequate and (explains_less or not current.adequate):
            break
        current = replace(refit, reports=(*current.reports, report_nuisances(current)))
    return current
