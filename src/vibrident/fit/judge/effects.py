"""The stated systematic effects in the verdict: what they explain of a fit's deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vibrident.base.amounts import amount, plain
from vibrident.data.records import FloatArray, SystematicEffect
from vibrident.fit.estimators import Estimate
from vibrident.fit.judge.adequacy import Judgement
from vibrident.fit.judge.misfit import describe_furthest
from vibrident.fit.problem import Evidence
from vibrident.fit.response.verdict import (
    REJECTION,
    as_chi2,
    chance_of,
    only_one_is_far,
    probability,
    shrunk,
)
from vibrident.fit.uncertainty.budget import Explained, Weighted, effects_of, explain, patterns
from vibrident.fit.uncertainty.linearised import Linearised


def all_effects(evidence: Evidence, judgement: Judgement) -> list[SystematicEffect]:
    """Return the systematic effects as stated, and those detected in the data."""
    return [*effects_of(evidence.calibration), *evidence.effects, *judgement.detected_effects]


def linearised(evidence: Evidence, estimate: Estimate, judgement: Judgement) -> Linearised:
    """Return the fit at all excited frequencies, linearised at the estimate.

    It has no rows for free decays.
    """
    coordinates = estimate.coordinates
    z = estimate.z
    points = judgement.adequacy
    if evidence.table_points is not None:
        return Linearised.from_table(coordinates, z, evidence.table_points)
    at = points.frequency_hz, points.measured, points.relative_deviation
    return Linearised.from_points(coordinates, z, evidence.quantity, *at)


def allowing_for_effects(evidence: Evidence, estimate: Estimate, judgement: Judgement) -> Judgement:
    """Return the judgement with systematic effects in the covariance of the deviations.

    ``judgement``: by noise alone.
    """
    effects = all_effects(evidence, judgement)
    adequacy = judgement.adequacy
    covariance = estimate.covariance * (judgement.scatter or 1.0) ** 2
    explained = explained_by_effects(evidence, estimate, judgement, covariance)
    if explained is None:
        return judgement
    allowed = replace(
        judgement, effects=tuple(zip(effects, explained.amounts.tolist(), strict=True))
    )
    if adequacy.chi2_reduced is None:
        # No uncertainty was stated: the scatter of the points is all there is.
        return allowed
    deviations = _deviations(evidence, estimate, judgement)(
        estimate.z, np.zeros(len(adequacy.frequency_hz))
    )
    degrees = adequacy.degrees_of_freedom
    chi2_before = adequacy.chi2_reduced * degrees
    chi2 = max(chi2_before - (float(deviations @ deviations) - explained.chi2), 0.0)
    text = judgement.lack_of_fit
    adequate = False
    believed = explained.probability >= REJECTION
    if adequacy.adequate or adequacy.chance < REJECTION:
        adequate = believed and _probability_of_remainder(judgement, explained, chi2) >= REJECTION
        text = (
            _describe_misfit(judgement, explained, chi2 / degrees)
            if believed
            else _describe_large_effect(effects, explained)
        )
    return replace(
        allowed,
        adequacy=replace(adequacy, chi2_reduced=chi2 / degrees, adequate=adequate),
        lack_of_fit=text,
        birge=max(judgement.birge * float(np.sqrt(chi2 / chi2_before)), 1.0)
        if chi2_before > 0
        else judgement.birge,
    )


def explained_by_effects(
    evidence: Evidence, estimate: Estimate, judgement: Judgement, covariance: FloatArray | None
) -> Explained | None:
    """Return what the effects explain of the deviations.

    None where there are no effects, where nothing tells how far the points scatter, or where the
    effects lead to another optimum.

    Args:
        evidence: the data.
        estimate: the fit.
        judgement: by noise alone.
        covariance: of the estimate, shape (p, p); None: any optimum will do.
    """
    effects = all_effects(evidence, judgement)
    adequacy = judgement.adequacy
    if not effects or not len(adequacy.frequency_hz) or adequacy.degrees_of_freedom <= 0:
        return None
    if not evidence.model.is_linear or (
        adequacy.chi2_reduced is None and judgement.scatter is None
    ):
        return None
    linear = linearised(evidence, estimate, judgement)
    effect_patterns = patterns(effects, linear, adequacy.frequency_hz)
    weighted = _deviations(evidence, estimate, judgement)
    corrected = np.zeros(len(effects))
    corrected[: len(evidence.corrections)] = [
        correction.amount for correction in evidence.corrections
    ]
    return explain(weighted, effects, effect_patterns, linear, covariance, corrected)


def _probability_of_remainder(judgement: Judgement, explained: Explained, chi2: float) -> float:
    """Return the probability of what the effects leave."""
    degrees = judgement.adequacy.degrees_of_freedom
    if not judgement.points:
        return probability(chi2, degrees)
    return chance_of(_remainder(judgement, explained), degrees, _other_chi2(judgement, explained))


def _remainder(judgement: Judgement, explained: Explained) -> FloatArray:
    """Return χ² of two degrees of freedom of what the effects leave of each point, shape (n,)."""
    freedom = _freedom(judgement)
    squares = np.sum(np.square(explained.residual.reshape(2, -1)), axis=0) / shrunk(freedom)
    return as_chi2(squares, freedom)


def _other_chi2(judgement: Judgement, explained: Explained) -> float:
    """Return χ² of the free decays and of the effects' amounts."""
    return judgement.adequacy.decays + float(explained.amounts @ explained.amounts)


def _describe_misfit(judgement: Judgement, explained: Explained, chi2_reduced: float) -> str:
    """Return the sentence on deviations that effects do not explain."""
    degrees = judgement.adequacy.degrees_of_freedom
    if judgement.points:
        points = _remainder(judgement, explained)
        if only_one_is_far(points, degrees, _other_chi2(judgement, explained)):
            return describe_furthest(judgement.adequacy, points, chi2_reduced)
    return (
        f"The model does not explain the data: deviations are {plain(chi2_reduced**0.5, 3)} times "
        "what noise and the stated systematic effects explain together "
        f"(χ²/dof = {plain(chi2_reduced, 4)}, {degrees} degrees of freedom)."
    )


def _describe_large_effect(effects: Sequence[SystematicEffect], explained: Explained) -> str:
    """Return the sentence on an effect larger than its stated uncertainty."""
    index = int(np.argmax(np.abs(explained.amounts)))
    effect = effects[index]
    size = abs(float(explained.amounts[index]))
    shown, stated = (
        amount(times * effect.standard_uncertainty, effect.unit, 3) for times in (size, 1.0)
    )
    return (
        f"The deviations have the shape of {effect.source} ({effect.kind}) of {shown}, "
        f"{size:.2g} times the stated standard uncertainty of {stated}: "
        "that is too small, or the model lacks something of the same shape."
    )


def _deviations(evidence: Evidence, estimate: Estimate, judgement: Judgement) -> Weighted:
    """Return the weighted deviations at all points, as a function of z and a change of log H."""
    coordinates = estimate.coordinates
    quantity = evidence.quantity
    adequacy = judgement.adequacy
    problem = evidence.table_points

    def model(z: FloatArray, change: np.ndarray) -> np.ndarray:
        values = coordinates.values(z)
        response = coordinates.model.frequency_response(values, adequacy.frequency_hz, quantity)
        return np.asarray(response) * np.exp(change)

    if problem is not None:
        scatter = judgement.scatter or 1.0
        _, magnitude, phase, magnitude_u, phase_u = (np.asarray(array) for array in problem.data)

        def deviations_of_table(z: FloatArray, change: np.ndarray) -> FloatArray:
            response = model(z, change)
            radial = (np.abs(response) - magnitude) / magnitude_u
            turn = np.angle(response * np.exp(-1j * phase)) / phase_u
            return (np.concatenate([radial, turn]) if problem.has_phase else radial) / scatter

        return deviations_of_table
    weight = np.sqrt(shrunk(_freedom(judgement))) / (
        adequacy.relative_deviation * np.abs(adequacy.measured)
    )

    def deviations_of_points(z: FloatArray, change: np.ndarray) -> FloatArray:
        error = weight * (adequacy.measured - model(z, change))
        return np.concatenate([error.real, error.imag])

    return deviations_of_points


def _freedom(judgement: Judgement) -> FloatArray:
    """Return the degrees of freedom behind the noise of each point, shape (n,)."""
    return np.concatenate([points.freedom for points in judgement.points])
