"""The stated systematic effects in the verdict: the part of a fit's deviations that they explain, and its message."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vibrident.base.amounts import amount, plain
from vibrident.data.records import FloatArray, SystematicEffect
from vibrident.fit.estimators import Estimate
from vibrident.fit.judge.adequacy import Judgement
from vibrident.fit.problem import Evidence
from vibrident.fit.response.verdict import REJECTION, as_chi2, chance_of, probability, shrunk
from vibrident.fit.uncertainty.budget import Explained, Weighted, effects_of, explain, patterns
from vibrident.fit.uncertainty.linearised import Linearised


def all_effects(evidence: Evidence, judgement: Judgement) -> list[SystematicEffect]:
    """Systematic effects as stated, and those that were found in the data."""
    return [*effects_of(evidence.calibration), *evidence.effects, *judgement.found]


def linearised(evidence: Evidence, estimate: Estimate, judgement: Judgement) -> Linearised:
    """The fit at all excited frequencies, linearised at the estimate; without rows for free decays."""
    coordinates = estimate.coordinates
    z = estimate.z
    points = judgement.adequacy
    if evidence.calibration.table is not None and evidence.first_look is not None:
        return Linearised.from_table(coordinates, z, evidence.first_look)
    if estimate.findings.decays is not None:
        return Linearised.without_rows(coordinates, z, evidence.quantity)
    at = points.frequency_hz, points.measured, points.relative_deviation
    return Linearised.from_points(coordinates, z, evidence.quantity, *at)


def allowing_for_effects(evidence: Evidence, estimate: Estimate, judgement: Judgement) -> Judgement:
    """The judgement by noise alone, with the systematic effects in the covariance of the deviations."""
    effects = all_effects(evidence, judgement)
    adequacy = judgement.adequacy
    if not effects or not len(adequacy.frequency_hz) or adequacy.degrees_of_freedom <= 0:
        return judgement
    if not evidence.model.is_linear or (
        adequacy.chi2_reduced is None and judgement.scatter is None
    ):
        return judgement
    linear = linearised(evidence, estimate, judgement)
    shape = patterns(effects, linear, adequacy.frequency_hz)
    weighted = _deviations(evidence, estimate, judgement)
    covariance = estimate.covariance * (judgement.scatter or 1.0) ** 2
    found = explain(weighted, effects, shape, linear, covariance)
    if found is None:
        return judgement
    allowed = replace(judgement, effects=tuple(zip(effects, found.amounts.tolist(), strict=True)))
    if (
        adequacy.chi2_reduced is None
    ):  # no uncertainty was stated: the scatter of the points is all there is
        return allowed
    deviations = weighted(estimate.z, np.zeros(len(shape)))
    degrees = adequacy.degrees_of_freedom
    before = adequacy.chi2_reduced * degrees
    chi2 = max(before - (float(deviations @ deviations) - found.chi2), 0.0)
    text = judgement.lack_of_fit
    adequate = False
    believed = found.probability >= REJECTION
    if adequacy.adequate or adequacy.chance < REJECTION:
        adequate = believed and _chance(judgement, found, chi2) >= REJECTION
        text = _misfit(judgement, chi2 / degrees) if believed else _beyond(effects, found)
    return replace(
        allowed,
        adequacy=replace(adequacy, chi2_reduced=chi2 / degrees, adequate=adequate),
        lack_of_fit=text,
        birge=max(judgement.birge * float(np.sqrt(chi2 / before)), 1.0)
        if before > 0
        else judgement.birge,
    )


def _chance(judgement: Judgement, found: Explained, chi2: float) -> float:
    """Chance of what the effects leave."""
    degrees = judgement.adequacy.degrees_of_freedom
    if not judgement.points:
        return probability(chi2, degrees)
    freedom = _freedom(judgement)
    squares = np.sum(np.square(found.residual.reshape(2, -1)), axis=0) / shrunk(freedom)
    beside = judgement.adequacy.decays + float(found.amounts @ found.amounts)
    return chance_of(as_chi2(squares, freedom), degrees, beside)


def _misfit(judgement: Judgement, chi2_reduced: float) -> str:
    return (
        f"The model does not explain the data: deviations are {plain(chi2_reduced**0.5, 3)} times what noise and the "
        f"stated systematic effects explain together (χ²/dof = {plain(chi2_reduced, 4)}, "
        f"{judgement.adequacy.degrees_of_freedom} degrees of freedom)."
    )


def _beyond(effects: Sequence[SystematicEffect], found: Explained) -> str:
    index = int(np.argmax(np.abs(found.amounts)))
    effect = effects[index]
    size = abs(float(found.amounts[index]))
    seen, stated = (
        amount(times * effect.standard_uncertainty, effect.unit, 3) for times in (size, 1.0)
    )
    return (
        f"The deviations have the shape of {effect.source} ({effect.kind}) of {seen}, {size:.2g} times the stated "
        f"standard uncertainty of {stated}: that is too small, or the model lacks something of the same shape."
    )


def _deviations(evidence: Evidence, estimate: Estimate, judgement: Judgement) -> Weighted:
    """The deviations at all points over their noise, as a function of z and of a change of log H."""
    coordinates = estimate.coordinates
    quantity = evidence.quantity
    adequacy = judgement.adequacy
    problem = evidence.first_look

    def model(z: FloatArray, change: np.ndarray) -> np.ndarray:
        values = coordinates.values(z)
        response = coordinates.model.frequency_response(values, adequacy.frequency_hz, quantity)
        return np.asarray(response) * np.exp(change)

    if evidence.calibration.table is not None and problem is not None:
        scatter = judgement.scatter or 1.0
        _, magnitude, phase, magnitude_u, phase_u = (np.asarray(part) for part in problem.data)

        def of_table(z: FloatArray, change: np.ndarray) -> FloatArray:
            response = model(z, change)
            radial = (np.abs(response) - magnitude) / magnitude_u
            turn = np.angle(response * np.exp(-1j * phase)) / phase_u
            return (np.concatenate([radial, turn]) if problem.has_phase else radial) / scatter

        return of_table
    weight = np.sqrt(shrunk(_freedom(judgement))) / (
        adequacy.relative_deviation * np.abs(adequacy.measured)
    )

    def of_points(z: FloatArray, change: np.ndarray) -> FloatArray:
        error = weight * (adequacy.measured - model(z, change))
        return np.concatenate([error.real, error.imag])

    return of_points


def _freedom(judgement: Judgement) -> FloatArray:
    """Degrees of freedom behind the noise of each point, shape (n,)."""
    return np.concatenate([part.freedom for part in judgement.points])
