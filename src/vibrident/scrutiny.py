"""Second thoughts about a fit: the doubts that show only once a model is fitted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TypeVar, get_args

import numpy as np

from vibrident.assemble import Judgement
from vibrident.errors import VibridentError
from vibrident.estimators import Estimate
from vibrident.estimators.start import find_start
from vibrident.measure.regimes import changes, findings, odd_record
from vibrident.measure.response import ComplexArray
from vibrident.models import SensorModel
from vibrident.naming import in_words
from vibrident.problem import Evidence, FrequencyProblem
from vibrident.records import FloatArray, Quantity
from vibrident.result import ResultWarning
from vibrident.uncertainty.adequacy import Adequacy, Points
from vibrident.uncertainty.agreement import estimators_disagree
from vibrident.uncertainty.amplitude import amplitude_dependence
from vibrident.uncertainty.band import band_sensitive
from vibrident.uncertainty.bend import bend
from vibrident.uncertainty.linearised import Linearised
from vibrident.uncertainty.parameters import parameter_units

#: Another reading of the data is proposed where it fits this many times better, and well.
BETTER, WELL = 10.0, 4.0
#: Correction of a bias by noise of the reference that is itself in doubt by more than this many standard
#: uncertainties.
DOUBTED_BIAS = 1.5


def second_thoughts(
    evidence: Evidence, estimate: Estimate, judgement: Judgement, covariance: FloatArray, total: FloatArray
) -> list[ResultWarning]:
    """Warnings ``nonlinear``, ``band_sensitive``, ``estimators_disagree``, ``reference_noise``, ``units_suspect``.

    Args:
        evidence: the data.
        estimate: the fit.
        judgement: what the estimate says of the data.
        covariance: of the coordinates, by the data alone, shape (p, p).
        total: with the stated systematic effects, shape (p, p).
    """
    warnings = list(_nonlinear(evidence, estimate, judgement))
    warnings += _moving(evidence, estimate, judgement, covariance, total)
    warnings += _reference_noise(estimate)
    warnings += _regimes(evidence, estimate, judgement)
    if not judgement.adequacy.adequate and judgement.adequacy.degrees_of_freedom > 0:
        warnings += _misread(evidence)
    return warnings


def _nonlinear(evidence: Evidence, estimate: Estimate, judgement: Judgement) -> Iterator[ResultWarning]:
    if judgement.overtones:
        worst = judgement.overtones[0]
        others = len(judgement.overtones) - 1
        more = f", and in {others} more record{'s' if others > 1 else ''}" if others else ""
        text = (
            f"{worst.record}: the sensor adds {100 * worst.ratio:.2g} % of harmonics to {worst.frequency_hz:.4g} Hz, "
            f"most at {worst.strongest} times that{more}; a linear sensor adds none."
        )
        yield ResultWarning("nonlinear", text)
    if not evidence.model.is_linear:
        return
    yield from _bent(evidence, estimate, judgement)
    tones = judgement.tones
    if tones is None:
        return
    points, estimate = _undisturbed(estimate, judgement, judgement.points[0])
    alone = _of_points(evidence, estimate, points)
    values = estimate.coordinates.values(estimate.z)
    model = np.asarray(evidence.model.frequency_response(values, points.frequency_hz, "acceleration"))
    found = amplitude_dependence(alone, model, tones.response, points.relative_deviation)
    if found is not None:
        text = (
            f"The response depends on the amplitude, as with a spring that is not linear: up to "
            f"{100 * found.largest:.2g} % at the tones ({found.sigma:.1f} standard deviations)."
        )
        yield ResultWarning("nonlinear", text)


def _bent(evidence: Evidence, estimate: Estimate, judgement: Judgement) -> Iterator[ResultWarning]:
    """A spring that is not linear, under motion that is not a sine."""
    core = evidence.model.core
    moved = [i for i, r in enumerate(evidence.records) if r.excitation != "sine" and r.reference is not None]
    if core.name != "accelerometer" or not moved or estimate.settings.get("discretisation") != "bandlimited":
        return
    values = estimate.coordinates.values(estimate.z)
    alone, gain = SensorModel(core.name, core), values[evidence.model.gain_name]

    def over_gain(frequency: FloatArray) -> ComplexArray:
        return np.asarray(alone.frequency_response(values, frequency) / gain, dtype=complex)

    found = bend([evidence.records[i] for i in moved], [judgement.predicted[i] for i in moved], over_gain)
    if found is not None:
        text = (
            f"The spring is not linear: what a cubic stiffness would add is {100 * found.share:.2g} % of the response "
            f"and stands out of the residual by {found.sigma:.1f} standard deviations."
        )
        yield ResultWarning("nonlinear", text)


def linearised(evidence: Evidence, estimate: Estimate, judgement: Judgement) -> Linearised:
    """The fit at all excited frequencies, linearised at the estimate."""
    if evidence.calibration.table is not None:
        problem = evidence.first_look
        assert problem is not None
        frequency, _, _, magnitude_u, phase_u = problem.data
        measured = judgement.adequacy.measured
        data = (frequency, np.abs(measured), np.angle(measured), magnitude_u, phase_u)
        return Linearised.of_table(estimate.coordinates, estimate.z, replace(problem, data=data))
    return _of_points(evidence, estimate, judgement.adequacy)


_Kind = TypeVar("_Kind", Adequacy, Points)


def _undisturbed(estimate: Estimate, judgement: Judgement, points: _Kind) -> tuple[_Kind, Estimate]:
    """Points and estimate as they were without the stated systematic effects: these move parameters too, as stated."""
    if judgement.removed is None or judgement.without is None:
        return points, estimate
    measured = points.measured * judgement.removed[: len(points.measured)]
    return replace(points, measured=measured), replace(estimate, z=judgement.without)


def _of_points(evidence: Evidence, estimate: Estimate, points: Adequacy | Points) -> Linearised:
    return Linearised.of_points(
        estimate.coordinates,
        estimate.z,
        evidence.quantity,
        points.frequency_hz,
        points.measured,
        points.relative_deviation,
    )


def _moving(
    evidence: Evidence,
    estimate: Estimate,
    judgement: Judgement,
    covariance: FloatArray,
    total: FloatArray,
) -> list[ResultWarning]:
    """Parameters that another part of the data, or another estimator, would move."""
    if not evidence.model.is_linear:
        return []  # a transfer function says nothing of what makes it nonlinear
    coordinates = estimate.coordinates
    units = parameter_units(evidence.model, evidence.calibration)
    points, at = _undisturbed(estimate, judgement, judgement.adequacy)
    linear = linearised(evidence, at, replace(judgement, adequacy=points))
    warnings = band_sensitive(linear, coordinates, at.z, covariance, units, (judgement.scatter or 1.0) ** 2)
    if judgement.tones is not None and estimate.estimator != "ml":
        alone = _of_points(evidence, estimate, judgement.points[0])
        largest = max((abs(size) for _, size in judgement.effects), default=1.0)
        spread = covariance + max(largest, 1.0) ** 2 * (total - covariance)  # the two weigh the points differently
        warnings += estimators_disagree(alone, coordinates, estimate.z, spread, units, estimate.estimator)
    return warnings


def _regimes(evidence: Evidence, estimate: Estimate, judgement: Judgement) -> list[ResultWarning]:
    """A sensor that changed within a record, or a record of another sensor."""
    if not evidence.records:
        return []
    frequency: list[float | None] = [None] * len(evidence.records)
    if judgement.tones is not None:
        for index, tone_hz in zip(judgement.tones.record.tolist(), judgement.tones.frequency_hz.tolist(), strict=True):
            frequency[index] = tone_hz
    odd, points = None, judgement.adequacy
    if not points.adequate and points.degrees_of_freedom > 0 and evidence.model.is_linear:
        linear = _of_points(evidence, estimate, points)
        odd = odd_record(linear.matrix, linear.rest, points.record, points.relative_deviation)
    within = changes(evidence.records, judgement.predicted, frequency)
    return [ResultWarning(found.code, found.message) for found in findings(within, odd)]


def _reference_noise(estimate: Estimate) -> list[ResultWarning]:
    doubt = estimate.settings.get("reference_noise_doubt", {})
    suspects = {name: size for name, size in doubt.items() if size > DOUBTED_BIAS}
    if not suspects:
        return []
    name = max(suspects, key=lambda key: suspects[key])
    text = (
        "Noise of the reference that the sensor did not feel cannot be told from noise of the response here; it may "
        f"have moved the {in_words(name)} by up to {suspects[name]:.1f} standard uncertainties."
    )
    return [ResultWarning("reference_noise", text)]


def _misread(evidence: Evidence) -> list[ResultWarning]:
    """A reading of the same data in other units, where it fits far better."""
    problem = evidence.first_look
    if problem is None:
        return []
    declared = _cost(problem, evidence.model)
    for text, other in _readings(problem):
        cost = _cost(other, evidence.model)
        if cost * BETTER < declared and cost < WELL:
            return [ResultWarning("units_suspect", f"{text} (χ²/dof {cost:.3g} in place of {declared:.3g}).")]
    return []


def _cost(problem: FrequencyProblem, model: SensorModel) -> float:
    """Cost of the best start for each degree of freedom, deviations below one per cent not believed."""
    try:
        start = find_start(problem, model)
    except VibridentError:
        return float("inf")
    return start.costs[-1] / max(start.equations - len(start.values), 1)


def _readings(problem: FrequencyProblem) -> Iterator[tuple[str, FrequencyProblem]]:
    """The same data with phase in the other unit, of the other sign, or of another reference quantity."""
    if problem.polar and problem.has_phase:
        frequency, magnitude, phase, magnitude_u, phase_u = problem.data
        for text, factor in (
            ('The phases fit far better as degrees: is phase_unit "rad" right?', np.pi / 180.0),
            ('The phases fit far better as radians: is phase_unit "deg" right?', 180.0 / np.pi),
        ):
            yield text, replace(problem, data=(frequency, magnitude, factor * phase, magnitude_u, factor * phase_u))
        text = "The phases fit far better with the other sign: here a lag is negative"
        yield text, replace(problem, data=(frequency, magnitude, -phase, magnitude_u, phase_u))
    if problem.quantity != "drive":
        for quantity in get_args(Quantity):
            if quantity not in (problem.quantity, "drive"):
                text = f"The data fit far better with a reference in {quantity}: is its quantity right?"
                yield text, replace(problem, quantity=quantity)
