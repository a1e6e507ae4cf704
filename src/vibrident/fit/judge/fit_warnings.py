"""Warnings that need a fitted model: noise of the reference, other solutions, units."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from vibrident.base.errors import VibridentError
from vibrident.base.nominal import SAME, nominal_value
from vibrident.base.tails import f_tail
from vibrident.data.records import MOTIONS, FloatArray, ResponseTable, is_motion
from vibrident.data.records.basis import distinct
from vibrident.fit.estimators import Estimate
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.problem import FrequencyProblem
from vibrident.fit.start.search import TargetFRF
from vibrident.fit.start.start import Start, find_start, sought_response
from vibrident.fit.uncertainty.alternatives import Solution, other_solutions
from vibrident.fit.uncertainty.parameters import parameter_units, standard_uncertainties
from vibrident.physics.models import ADD_ONS, CORES, SensorModel, parse
from vibrident.physics.naming import in_words
from vibrident.result import ResultWarning

#: Another reading of the data is proposed where its χ²/ν is smaller by at least this factor …
MIN_IMPROVEMENT = 10.0
#: … and below this …
MAX_CHI2_REDUCED = 4.0
#: … and if chance would make a wrong reading fit as well with a probability below this.
MAX_CHANCE = 1e-4
ANGULAR = (
    "The frequencies are 2π times those of the one-third-octave series: are they in rad/s? "
    "The column wants Hz, and the natural frequency is in the unit of the column."
)


def warnings_of_fit(fitted: Fitted, covariance: FloatArray) -> list[ResultWarning]:
    """Return warnings of noise of the reference, other solutions, and suspected units.

    Their codes are ``reference_noise``, ``weakly_determined`` and ``units_suspect``.
    ``covariance``: of the coordinates, by the data alone, shape (p, p).
    """
    warnings = [*_warn_of_reference_noise(fitted.estimate), *_warn_of_one_frequency(fitted)]
    warnings += _warn_of_solutions(fitted, covariance)
    if _in_angular_frequencies(fitted.evidence.calibration.table):
        return [*warnings, ResultWarning("units_suspect", ANGULAR)]
    # Without stated uncertainties a table that is misread is one that scatters.
    doubted = not fitted.adequate or fitted.judgement.scatter is not None
    if doubted and fitted.judgement.adequacy.degrees_of_freedom > 0:
        warnings += _warn_of_misreading(fitted)
    return warnings


def _warn_of_one_frequency(fitted: Fitted) -> list[ResultWarning]:
    """Return the proposal of the gain alone for the data of a single frequency, if any."""
    model = fitted.evidence.model
    points = fitted.judgement.adequacy
    hz = points.frequency_hz
    if model.is_gain_alone or not hz.size or np.max(hz) > np.min(hz) * (1.0 + SAME):
        return []
    gain_alone = next(name for name in CORES if parse(name).is_gain_alone)
    delay = next(name for name, addon in ADD_ONS.items() if addon.is_delay)
    text = (
        f"All data are at {hz[0]:.6g} Hz, so they tell the sensitivity there and nothing else: "
        f"the measured value. The model {gain_alone}+{delay} states it, or {gain_alone} where no "
        "phase is measured."
    )
    return [ResultWarning("weakly_determined", text)]


def _warn_of_solutions(fitted: Fitted, covariance: FloatArray) -> list[ResultWarning]:
    """Return warnings of other solutions that fit as well."""
    evidence = fitted.evidence
    estimate = fitted.estimate
    judgement = fitted.judgement
    coordinates = estimate.coordinates
    points = judgement.adequacy
    if not coordinates.model.is_linear or not points.adequate or not len(points.frequency_hz):
        return []
    problem = evidence.table_points
    if problem is not None:
        sought = sought_response(problem).scaled(judgement.scatter or 1.0)
    else:
        deviation = points.relative_deviation
        sought = TargetFRF(
            points.frequency_hz, points.measured, deviation, deviation, has_phase=True, polar=False
        )
    solution = Solution(fitted.values, standard_uncertainties(coordinates, estimate.z, covariance))
    units = parameter_units(evidence.model, evidence.calibration)
    return list(
        other_solutions(
            coordinates.model,
            evidence.quantity,
            sought,
            solution,
            estimate.begin,
            units,
            estimate.rival_optima,
        )
    )


def _warn_of_reference_noise(estimate: Estimate) -> list[ResultWarning]:
    """Return the warning that noise of the reference makes up much of an uncertainty, if any."""
    noise = estimate.findings.noise
    if noise is None or not np.any(noise.doubt > 0.8):
        return []
    worst = int(np.argmax(noise.doubt))
    name = estimate.coordinates.model.parameter_names[worst]
    text = (
        "Noise of the reference channel itself cannot be separated from noise of the response "
        f"here; it makes up {100 * noise.doubt[worst]:.0f} % of the standard uncertainty of the "
        f"{in_words(name)}."
    )
    return [ResultWarning("reference_noise", text)]


def _warn_of_misreading(fitted: Fitted) -> list[ResultWarning]:
    """Return the warning of a reading of the same data in other units, if any.

    That reading fits far better than by chance, and no worse than another model that explains the
    data.
    """
    evidence = fitted.evidence
    remedy_chi2 = fitted.judgement.remedy_chi2
    problem = evidence.first_look
    if problem is None:
        return []
    freedom = max(problem.equations - len(evidence.model.parameter_names), 1)
    for text, reading, shrinkage in _readings(problem, evidence.calibration.table):
        cost = _cost(reading, evidence.model, max_cost=MAX_CHI2_REDUCED * freedom)
        if not cost < MAX_CHI2_REDUCED:
            continue
        declared = _cost(problem, evidence.model, fitted.estimate.begin)
        ratio = declared / max(cost, np.finfo(float).tiny) * shrinkage
        worse = (
            remedy_chi2 is not None
            and f_tail(1, freedom, (cost - remedy_chi2) * freedom / max(remedy_chi2, 1.0))
            < MAX_CHANCE
        )
        if ratio > MIN_IMPROVEMENT and f_tail(freedom, freedom, ratio) < MAX_CHANCE and not worse:
            text = f"{text} (χ²/dof {cost:.3g} in place of {declared:.3g})."
            return [ResultWarning("units_suspect", text)]
    return []


def _cost(
    problem: FrequencyProblem,
    model: SensorModel,
    known_start: Start | None = None,
    max_cost: float = np.inf,
) -> float:
    """Return the cost of the best start over its degrees of freedom.

    It is infinite where no cost is below ``max_cost``; ``known_start``: a start found before.
    """
    try:
        start = known_start or find_start(problem, model, max_cost)
    except VibridentError:
        return float("inf")
    return start.chi2_reduced


def _in_angular_frequencies(table: ResponseTable | None) -> bool:
    """Return whether all frequencies are 2π times those of the one-third-octave series.

    Fewer than five may be so by chance: then it is False.
    """
    frequencies = np.zeros(0) if table is None else distinct(table.frequency_hz)
    return (
        len(frequencies) >= 5
        and not _all_nominal(frequencies)
        and _all_nominal(frequencies / (2.0 * np.pi))
    )


def _all_nominal(frequency_hz: FloatArray) -> bool:
    """Return whether all frequencies are of the one-third-octave series, exact or as printed.

    Source: ISO 266.
    """
    steps = np.round(10.0 * np.log10(frequency_hz)).astype(int)
    exact = 10.0 ** (steps / 10.0)
    printed = np.array([nominal_value(int(step)) for step in steps])
    deviation = np.minimum(np.abs(exact / frequency_hz - 1.0), np.abs(printed / frequency_hz - 1.0))
    return bool(np.all(deviation < 2e-3))


class _OtherReading(NamedTuple):
    """Another reading of the same data.

    Attributes:
        question: to the user, as the reading fits far better.
        problem: the data in this reading.
        shrinkage: factor by which the reading makes scatter smaller; it is no better by that.
    """

    question: str
    problem: FrequencyProblem
    shrinkage: float = 1.0


def _readings(problem: FrequencyProblem, table: ResponseTable | None) -> Iterator[_OtherReading]:
    """Yield other readings of the same data.

    These are phase in the other unit or of the other sign, power, decibels, exchanged channels, and
    other quantities of the reference.
    """
    if table is not None:
        yield from _readings_of_table(problem, table)
    elif np.all(problem.data[2] != 0.0):
        frequency, reference, response, deviation = problem.data
        text = (
            "The data fit far better with reference and response exchanged: "
            "are their columns the right way round?"
        )
        data = (frequency, response, reference, deviation * np.abs(reference / response))
        yield _OtherReading(text, replace(problem, data=data))
    if is_motion(problem.quantity):
        for quantity in MOTIONS:
            if quantity != problem.quantity:
                text = (
                    f"The data fit far better with a reference in {quantity}: "
                    "is its quantity right?"
                )
                yield _OtherReading(text, replace(problem, quantity=quantity))


def _readings_of_table(problem: FrequencyProblem, table: ResponseTable) -> Iterator[_OtherReading]:
    """Yield other readings of a table."""
    names = ("frequency", "magnitude", "phase", "magnitude_u", "phase_u")
    declared = dict(zip(names, problem.data, strict=True))
    _, magnitude, phase, magnitude_u, phase_u = problem.data

    def reading(question: str, shrinkage: float = 1.0, **columns: FloatArray) -> _OtherReading:
        data = tuple((declared | columns).values())
        return _OtherReading(question, replace(problem, data=data), shrinkage)

    if problem.has_phase:
        for text, factor in (
            ('The phases fit far better as degrees: is phase_unit "rad" right?', np.pi / 180.0),
            ('The phases fit far better as radians: is phase_unit "deg" right?', 180.0 / np.pi),
        ):
            # Values without a stated uncertainty keep their weight; they are half of the data.
            is_stated = table.phase_uncertainty_rad is not None
            other_u = factor * phase_u if is_stated else phase_u
            if np.median(other_u) < 0.5:  # any phase fits within an uncertainty of a turn
                shrinkage = 1.0 if is_stated else min(factor, 1.0)
                yield reading(text, shrinkage, phase=factor * phase, phase_u=other_u)
        text = "The phases fit far better with the other sign: here a lag is negative"
        yield reading(text, phase=-phase)
    root = np.sqrt(magnitude)
    relative_u = magnitude_u / magnitude
    text = "The magnitudes fit far better as their square root: are they of power?"
    yield reading(text, magnitude=root, magnitude_u=0.5 * relative_u * root)
    # Any small numbers look like levels of a flat response.
    if np.max(magnitude) < 400.0 and np.ptp(magnitude) > 3.0:
        ratio = 10.0 ** (magnitude / 20.0)
        text = (
            "The magnitudes fit far better as decibels: "
            "the column wants the ratio itself, not its level"
        )
        relative_u = (
            relative_u if table.magnitude_uncertainty is None else magnitude_u * np.log(10.0) / 20.0
        )
        yield reading(text, magnitude=ratio, magnitude_u=ratio * relative_u)
