"""Second thoughts about a fit: the doubts that show only once a model is fitted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import get_args

import numpy as np

from vibrident.base.errors import VibridentError
from vibrident.base.nominal import SAME, nominal_value
from vibrident.base.tails import f_tail
from vibrident.data.records import FloatArray, Quantity, ResponseTable
from vibrident.data.records.basis import distinct
from vibrident.fit.estimators import Estimate
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.problem import Evidence, FrequencyProblem
from vibrident.fit.start.search import TargetFRF
from vibrident.fit.start.start import Start, find_start, sought_response
from vibrident.fit.uncertainty.alternatives import Solution, other_solutions
from vibrident.fit.uncertainty.parameters import deviations, parameter_units
from vibrident.physics.models import ADD_ONS, CORES, SensorModel, parse
from vibrident.physics.naming import in_words
from vibrident.result import ResultWarning

#: Another reading of the data is proposed where it fits this many times better, and well.
BETTER = 10.0
WELL = 4.0
#: … and if chance would make a wrong reading fit as well with a probability below this.
CHANCE = 1e-4
ANGULAR = (
    "The frequencies are 2π times those of the one-third-octave series: are they in rad/s? "
    "The column wants Hz, and the natural frequency is in the unit of the column."
)


def second_thoughts(fitted: Fitted, covariance: FloatArray) -> list[ResultWarning]:
    """Warnings ``reference_noise``, ``weakly_determined`` where another solution fits as well, and ``units_suspect``.

    ``covariance``: of the coordinates, by the data alone, shape (p, p).
    """
    warnings = [*_reference_noise(fitted.estimate), *_one_frequency(fitted)]
    warnings += _others(fitted, covariance)
    if _in_angular_frequencies(fitted.evidence.calibration.table):
        return [*warnings, ResultWarning("units_suspect", ANGULAR)]
    # Without stated uncertainties a table that is misread is one that scatters.
    doubted = not fitted.adequate or fitted.judgement.scatter is not None
    if doubted and fitted.judgement.adequacy.degrees_of_freedom > 0:
        warnings += _misread(fitted.evidence, fitted.estimate, fitted.judgement.remedied)
    return warnings


def _one_frequency(fitted: Fitted) -> list[ResultWarning]:
    """Propose the gain alone for the data of a single frequency."""
    model = fitted.evidence.model
    points = fitted.judgement.adequacy
    at = points.frequency_hz
    if model.is_gain_alone or not at.size or np.max(at) > np.min(at) * (1.0 + SAME):
        return []
    alone = next(name for name in CORES if parse(name).is_gain_alone)
    delay = next(name for name, addon in ADD_ONS.items() if addon.is_delay)
    text = (
        f"All data are at {at[0]:.6g} Hz, so they tell the sensitivity there and nothing else: "
        f"the measured value. The model {alone}+{delay} states it, or {alone} where no phase is "
        "measured."
    )
    return [ResultWarning("weakly_determined", text)]


def _others(fitted: Fitted, covariance: FloatArray) -> list[ResultWarning]:
    """Other solutions that fit as well."""
    evidence = fitted.evidence
    estimate = fitted.estimate
    judgement = fitted.judgement
    coordinates = estimate.coordinates
    z = estimate.z
    points = judgement.adequacy
    if not coordinates.model.is_linear or not points.adequate or not len(points.frequency_hz):
        return []
    problem = evidence.first_look
    if evidence.calibration.table is not None and problem is not None:
        sought = sought_response(problem).scaled(judgement.scatter or 1.0)
    else:
        deviation = points.relative_deviation
        sought = TargetFRF(
            points.frequency_hz, points.measured, deviation, deviation, has_phase=True, polar=False
        )
    spread = np.abs(coordinates.slopes(z)) * deviations(covariance)
    found = Solution(
        fitted.values, dict(zip(coordinates.model.parameter_names, spread.tolist(), strict=True))
    )
    units = parameter_units(evidence.model, evidence.calibration)
    return list(
        other_solutions(coordinates.model, evidence.quantity, sought, found, estimate.begin, units)
    )


def _reference_noise(estimate: Estimate) -> list[ResultWarning]:
    noise = estimate.findings.noise
    if noise is None or not np.any(noise.doubt > 0.8):
        return []
    worst = int(np.argmax(noise.doubt))
    name = estimate.coordinates.model.parameter_names[worst]
    text = (
        "Noise of the reference channel itself cannot be separated from noise of the response here; it makes "
        f"up {100 * noise.doubt[worst]:.0f} % of the standard uncertainty of the {in_words(name)}."
    )
    return [ResultWarning("reference_noise", text)]


def _misread(evidence: Evidence, estimate: Estimate, remedied: float | None) -> list[ResultWarning]:
    """A reading of the same data in other units, if it fits far better than by chance, and no worse than a remedy."""
    problem = evidence.first_look
    if problem is None:
        return []
    declared, freedom = _cost(problem, evidence.model, estimate.begin)
    most = min(declared / BETTER, WELL) * freedom
    for text, other in _readings(problem, evidence.calibration.table):
        cost, _ = _cost(other, evidence.model, most=most)
        ratio = declared / max(cost, np.finfo(float).tiny)
        worse = (
            remedied is not None
            and f_tail(1, freedom, (cost - remedied) * freedom / max(remedied, 1.0)) < CHANCE
        )
        if (
            ratio > BETTER
            and cost < WELL
            and f_tail(freedom, freedom, ratio) < CHANCE
            and not worse
        ):
            return [
                ResultWarning(
                    "units_suspect", f"{text} (χ²/dof {cost:.3g} in place of {declared:.3g})."
                )
            ]
    return []


def _cost(
    problem: FrequencyProblem, model: SensorModel, begun: Start | None = None, most: float = np.inf
) -> tuple[float, int]:
    """Cost of the best start (or of this one) for each degree of freedom, and these; infinite where above ``most``."""
    try:
        start = begun or find_start(problem, model, most)
    except VibridentError:
        return float("inf"), 0
    freedom = int(start.equations - len(start.values))
    return start.costs[-1] / max(freedom, 1), freedom


def _in_angular_frequencies(table: ResponseTable | None) -> bool:
    """Whether the frequencies are 2π times those of the one-third-octave series; five of them are so by no chance."""
    frequencies = np.zeros(0) if table is None else distinct(table.frequency_hz)
    return (
        len(frequencies) >= 5
        and not _nominal(frequencies)
        and _nominal(frequencies / (2.0 * np.pi))
    )


def _nominal(frequency_hz: FloatArray) -> bool:
    """Whether all frequencies are of the one-third-octave series, exact or as they are printed (ISO 266)."""
    steps = np.round(10.0 * np.log10(frequency_hz)).astype(int)
    exact = 10.0 ** (steps / 10.0)
    printed = np.array([nominal_value(int(n)) for n in steps])
    off = np.minimum(np.abs(exact / frequency_hz - 1.0), np.abs(printed / frequency_hz - 1.0))
    return bool(np.all(off < 2e-3))


def _readings(
    problem: FrequencyProblem, table: ResponseTable | None
) -> Iterator[tuple[str, FrequencyProblem]]:
    """The same data with phase in the other unit, of the other sign, as decibels, with channels exchanged, or of
    another reference quantity."""
    if table is not None:
        yield from _readings_of_table(problem, table)
    elif np.all(problem.data[2] != 0.0):
        frequency, reference, response, deviation = problem.data
        text = "The data fit far better with reference and response exchanged: are their columns the right way round?"
        data = (frequency, response, reference, deviation * np.abs(reference / response))
        yield text, replace(problem, data=data)
    if problem.quantity != "drive":
        for quantity in get_args(Quantity):
            if quantity not in (problem.quantity, "drive"):
                text = f"The data fit far better with a reference in {quantity}: is its quantity right?"
                yield text, replace(problem, quantity=quantity)


def _readings_of_table(
    problem: FrequencyProblem, table: ResponseTable
) -> Iterator[tuple[str, FrequencyProblem]]:
    frequency, magnitude, phase, magnitude_u, phase_u = problem.data
    if problem.has_phase:
        for text, factor in (
            ('The phases fit far better as degrees: is phase_unit "rad" right?', np.pi / 180.0),
            ('The phases fit far better as radians: is phase_unit "deg" right?', 180.0 / np.pi),
        ):
            # Values without a stated uncertainty keep their weight.
            other_u = phase_u if table.phase_uncertainty_rad is None else factor * phase_u
            if np.median(other_u) < 0.5:  # any phase fits within an uncertainty of a turn
                yield (
                    text,
                    replace(
                        problem, data=(frequency, magnitude, factor * phase, magnitude_u, other_u)
                    ),
                )
        text = "The phases fit far better with the other sign: here a lag is negative"
        yield text, replace(problem, data=(frequency, magnitude, -phase, magnitude_u, phase_u))
    root = np.sqrt(magnitude)
    relative_u = magnitude_u / magnitude
    text = "The magnitudes fit far better as their square root: are they of power?"
    yield text, replace(problem, data=(frequency, root, phase, 0.5 * relative_u * root, phase_u))
    if (
        np.max(magnitude) < 400.0 and np.ptp(magnitude) > 3.0
    ):  # any small numbers look like levels of a flat response
        ratio = 10.0 ** (magnitude / 20.0)
        text = "The magnitudes fit far better as decibels: the column wants the ratio itself, not its level"
        relative_u = (
            relative_u if table.magnitude_uncertainty is None else magnitude_u * np.log(10.0) / 20.0
        )
        yield text, replace(problem, data=(frequency, ratio, phase, ratio * relative_u, phase_u))
