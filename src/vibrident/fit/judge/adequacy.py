"""From an estimate to the parts of a result: prediction, deviations, metrics, excerpts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from vibrident.base.amounts import plain
from vibrident.base.errors import InputError
from vibrident.data.records import FloatArray, Record, SystematicEffect
from vibrident.fit.decay import decay_deviations
from vibrident.fit.descent.weighed import Weighed, weighed_segments, weighed_series
from vibrident.fit.estimators import Estimate
from vibrident.fit.estimators.residual_tones import network_problem, residual_tones
from vibrident.fit.problem import Evidence, network_of
from vibrident.fit.response import MeasuredResponse
from vibrident.fit.response.rounding import rounding_variance
from vibrident.fit.response.transform import about_mean, line_frequencies, power_of
from vibrident.fit.response.verdict import REJECTION, probability
from vibrident.fit.uncertainty.adequacy import (
    Adequacy,
    Points,
    Response,
    assess,
    factor_points,
    looks_random,
    tone_points,
)
from vibrident.fit.uncertainty.explained import UNKNOWN_SHARES, Shares, powers, shares_of
from vibrident.fit.uncertainty.factors import band_factors
from vibrident.fit.uncertainty.steps import effects_of_steps
from vibrident.physics.discretisation import Weights
from vibrident.physics.discretisation.weights import weight_table
from vibrident.result import Signal

if TYPE_CHECKING:
    from vibrident.fit.decay.deviations import DecayDeviation

_EXCERPT_SAMPLES = 5_000  # of all records together; a picture is a few hundred wide


@dataclass(frozen=True, eq=False)
class Judgement:
    """What the estimate says of the data.

    Attributes:
        adequacy: points, χ², verdict.
        lack_of_fit: the warning's text, should it be needed.
        birge: factor on the uncertainties that the deviations demand, at least one.
        predicted: predicted response of each record, NaN where it is not defined; empty for a table.
        scatter: standard deviation of the weighted residuals where no uncertainty was stated, else None.
        signals: excerpts for pictures.
        weights: the network's weights as the paper's Table 1.
        tones: of the sine records, cleaned; None without sines.
        points: what the adequacy is made of, those of the tones first.
        found: systematic effects that were found in the data.
        effects: stated and found ones, and how much of each the data show, in its standard uncertainties.
        remedied: χ²/ν of another model that explains the data, so that all else is misfit; None where none does.
        explained_by: name of that model.
        shares: of the response's power.
    """

    adequacy: Adequacy
    lack_of_fit: str
    birge: float = 1.0
    predicted: tuple[FloatArray, ...] = ()
    scatter: float | None = None
    signals: tuple[Signal, ...] = ()
    weights: dict[str, Any] = field(default_factory=dict)
    tones: MeasuredResponse | None = None
    points: tuple[Points, ...] = ()
    found: tuple[SystematicEffect, ...] = ()
    effects: tuple[tuple[SystematicEffect, float], ...] = ()
    remedied: float | None = None
    explained_by: str = ""
    shares: Shares = UNKNOWN_SHARES

    @property
    def explained(self) -> float:
        """Share of the response's power that the model explains; all where that is not known."""
        return 1.0 if np.isnan(self.shares.explained) else self.shares.explained


def judge_records(evidence: Evidence, estimate: Estimate) -> Judgement:
    """Predict every record and compare, band by band."""
    model, quantity = evidence.model, evidence.quantity
    values = estimate.coordinates.values(estimate.z)

    def response(frequency: FloatArray) -> Any:
        return model.frequency_response(values, np.asarray(frequency), quantity)

    points, tones, shares = list[Points](), None, list[FloatArray]()
    predicted, weights = _predict(evidence, estimate)
    if evidence.tones is not None and estimate.criterion != "samples":
        tones = estimate.tones or _tones(evidence, estimate, values)
        points.append(tone_points(tones, response, [record.name for record in evidence.records]))
        shares.append(_powers_of_tones(tones, response))
    for bins in weighed_records(evidence, estimate, predicted):
        record = evidence.records[bins.record]
        sine = record.excitation == "sine"
        if sine and tones is not None:
            continue
        factors = band_factors(bins, sine=sine, least=_of_rounding(record, bins, response))
        points += (
            [] if factors is None else [factor_points(factors, record, bins.samples, response)]
        )
        shares.append(_powers(evidence, record, bins, model.delay_s(values)))
    decays = decay_deviations(evidence.records, model, values)
    adequacy = assess(points, len(estimate.z), decays)
    if _is_the_measurement(evidence, adequacy.degrees_of_freedom, adequacy.frequency_hz):
        adequacy = replace(adequacy, adequate=True)
    birge = _birge(estimate, points, adequacy, decays)
    text, share = _misfit(adequacy, points, response, decays), shares_of(shares)
    if share.lacking:
        adequacy, text = (
            replace(adequacy, adequate=False),
            str(share) if adequacy.adequate else f"{text} {share}",
        )
    return Judgement(
        adequacy,
        text,
        birge,
        predicted,
        signals=_excerpts(evidence, predicted),
        weights=weights,
        tones=tones,
        points=tuple(points),
        found=tuple(effects_of_steps(evidence.records, predicted, response, adequacy))
        if model.is_linear
        else (),
        shares=share,
    )


def weighed_records(
    evidence: Evidence, estimate: Estimate, predicted: Sequence[FloatArray]
) -> Iterator[Weighed]:
    """Yield records with a reference, or their segments, in the noise at the estimate.

    ``predicted``: response of each record, NaN where it is not defined.
    """
    if estimate.in_noise is not None:
        yield from weighed_segments(estimate.in_noise, estimate.z, estimate.coordinates)
        return
    for number, (record, series) in enumerate(zip(evidence.records, predicted, strict=True)):
        own = None if record.reference is None else weighed_series(number, record, series)
        if own is not None:
            yield own


def _of_rounding(record: Record, bins: Weighed, response: Response) -> FloatArray | float:
    """Return the variance a sample of the converters' rounding, shape (bins,); noise is not below it."""
    hz = line_frequencies(bins.samples, record.sampling_rate_hz)[: bins.residual.size]
    found = rounding_variance(record, lambda: power_of(response(hz)))
    return 0.0 if found is None else found


def _powers(evidence: Evidence, record: Record, bins: Weighed, delay_s: float) -> FloatArray:
    """Return what a record says of the shares of the response's power, in the band of the motion."""
    assert record.reference is not None
    used = record.reference_mask[bins.span] & bins.used
    low, high = (int(hz * bins.samples / record.sampling_rate_hz) for hz in evidence.band_hz)
    band = slice(max(low, 1), high + 2)
    reference = about_mean(record.reference[bins.span], used)
    return powers(bins, reference, delay_s * record.sampling_rate_hz, band)


def _powers_of_tones(tones: MeasuredResponse, response: Response) -> FloatArray:
    """What sines say of the shares of the response's power."""
    left = tones.response - response(tones.frequency_hz) * tones.reference
    return _summed(
        power_of(tones.response), power_of(left), 2.0 * tones.error_deviation(response) ** 2
    )


def _summed(power: FloatArray, left: FloatArray, noise: FloatArray) -> FloatArray:
    """Sums over points, as of :func:`powers`; all noise is incoherent."""
    return np.array([np.sum(each) for each in (power, left, noise, noise**2)])


def _tones(evidence: Evidence, estimate: Estimate, values: dict[str, float]) -> MeasuredResponse:
    """Tones at the estimate, by the network with exact weights, for any trained network."""
    exact = estimate.findings.method.is_exact
    problem = estimate.problem if exact else None
    problem = problem or network_problem(evidence, values)
    predicted = estimate.predicted if exact and estimate.predicted is not None else None
    return residual_tones(evidence, problem, estimate.coordinates, estimate.z, predicted)


def _birge(
    estimate: Estimate,
    points: Sequence[Points],
    adequacy: Adequacy,
    decays: Sequence[DecayDeviation],
) -> float:
    """By how much the deviations exceed what the estimate's own covariance allows for: √(χ²/dof), at least one.

    Equal weights hold a record's whole residual, misfit and all, and a deviation is compared with what that allows.
    """
    network = estimate.findings.network
    if network is None or network.weights != "white" or adequacy.degrees_of_freedom <= 0:
        return adequacy.birge
    total = sum(
        float(np.sum(each.squares * each.unweighted))
        for each in points
        if each.unweighted is not None
    )
    total += sum(decay.parts.chi2 for decay in decays)
    return float(np.sqrt(max(total / adequacy.degrees_of_freedom, 1.0)))


def _misfit(
    adequacy: Adequacy, points: list[Points], response: Any, decays: Sequence[DecayDeviation] = ()
) -> str:
    """The warning that an inadequate model gets."""
    if not points:
        return (
            "It cannot be tested whether the model explains the data: in no band does the response exceed the "
            "residual. The records are too short for a test, or noise and misfit are too large."
        )
    if adequacy.degrees_of_freedom <= 0:
        equations = 2 * len(adequacy.frequency_hz)
        return _nothing_left(equations, equations - adequacy.degrees_of_freedom, "data")
    chi2 = adequacy.chi2_reduced or 0.0
    worst = _worst(points, response)
    if decays:
        far = max(decays, key=lambda decay: decay.parts.chi2)
        if far.parts.chi2 > max(float(np.max(part.squares)) for part in points):
            worst = f"; most in a free decay: {far.words}"
    return (
        f"The model does not explain the data: deviations at the excited frequencies are {plain(chi2**0.5, 3)} times "
        f"what the noise explains (χ²/dof = {plain(chi2, 4)}, {adequacy.degrees_of_freedom} degrees of freedom)"
        f"{worst}."
    )


def _is_the_measurement(evidence: Evidence, degrees: int, frequency_hz: FloatArray) -> bool:
    """Return whether the model says what was measured at one frequency and claims nothing else."""
    return evidence.model.is_gain_alone and degrees == 0 and np.ptp(frequency_hz) == 0.0


def _nothing_left(equations: int, parameters: int, what: str) -> str:
    """A model with no fewer parameters than there are equations meets any data."""
    return (
        f"It cannot be tested whether the model explains the {what}: {parameters} parameters meet {equations} measured "
        "values, and none is left to judge by. Measure at more frequencies, or take a model with fewer parameters."
    )


def _worst(points: list[Points], response: Any) -> str:
    frequency = np.concatenate([p.frequency_hz for p in points])
    measured = np.concatenate([p.measured for p in points])
    weighted = np.concatenate([p.squares for p in points])
    index = int(np.argmax(weighted))
    off = 100 * abs(response(frequency[index : index + 1])[0] / measured[index] - 1.0)
    return f", most at {frequency[index]:.4g} Hz, where model and measurement differ by {off:.2g} %"


def _predict(
    evidence: Evidence, estimate: Estimate
) -> tuple[tuple[FloatArray, ...], dict[str, Any]]:
    """Predicted responses by the network with exact weights (or those it was trained with), and its Table 1."""
    step = estimate.findings.method
    values = estimate.coordinates.values(estimate.z)
    try:
        problem = estimate.problem or network_of(
            evidence.records, evidence.model, step, evidence.quantity, values
        )
    except InputError:  # all records are too short to interpolate: only the tones remain
        return tuple(np.full(r.samples, np.nan) for r in evidence.records), {}
    predicted = estimate.predicted or tuple(problem.predict(estimate.coordinates, estimate.z))
    if estimate.criterion != "samples":
        return predicted, {}
    first = Weights(*(np.asarray(weight)[0] for weight in problem.weights(values)))
    scale = evidence.model.rational(values, evidence.quantity).angular_scale
    try:
        table = weight_table(
            first, scale ** np.arange(problem.frame.order)
        )  # in the paper's states V, V̇
    except (
        np.linalg.LinAlgError
    ):  # a sensor that forgets its state within a sample has no W2 = C Φ⁻¹
        return predicted, {}
    return predicted, {
        **table,
        "discretisation": step.name,
        "sampling_interval_s": min(record.sampling_interval_s for record in evidence.records),
    }


def judge_decays(evidence: Evidence, estimate: Estimate) -> Judgement:
    """Compare free decays, which have no reference, with the free motion, stretch of time by stretch."""
    from vibrident.fit.decay import estimate as free  # only where there are decays

    predicted, verdict, text = free.predicted(evidence, estimate), *free.lack_of_fit(estimate)
    adequacy = Adequacy(np.zeros(0), np.zeros(0, dtype=complex), np.zeros(0), (), *verdict)
    return Judgement(
        adequacy, text, adequacy.birge, predicted, signals=_excerpts(evidence, predicted)
    )


def judge_table(evidence: Evidence, estimate: Estimate) -> Judgement:
    """Compare the model with a table."""
    table, problem = evidence.calibration.table, evidence.first_look
    assert table is not None
    assert problem is not None
    residual = np.asarray(problem.residual(estimate.z, estimate.coordinates))
    squares, degrees = float(np.sum(residual**2)), len(residual) - len(estimate.z)
    chi2 = squares / degrees if degrees > 0 else None
    chance, scatter = probability(squares, degrees), None
    measured = _is_the_measurement(evidence, degrees, table.frequency_hz)
    adequate = measured or (degrees > 0 and chance >= REJECTION)
    if table.magnitude_uncertainty is None:
        scatter = (
            1e8 if chi2 is None else float(np.sqrt(chi2))
        )  # where nothing tells it: the points say nothing
        order = np.argsort(table.frequency_hz, kind="stable")
        n = table.points
        parts = [residual[:n][order]] + ([residual[n:][order]] if problem.has_phase else [])
        chi2, chance = None, 1.0
        adequate = measured or (degrees > 0 and all(looks_random(part) for part in parts))
        text = "The deviations from the model follow a pattern along frequency: the model does not explain the table."
    else:
        text = (
            f"The model does not explain the table: deviations are {plain((chi2 or 0.0) ** 0.5, 3)} times the stated "
            f"uncertainties (χ²/dof = {plain(chi2 or 0.0, 4)}, {degrees} degrees of freedom)."
        )
        if problem.has_phase and table.phase_uncertainty_rad is None:
            text += " The phase's, which is not stated, is taken to be the magnitude's, in rad."
    if degrees <= 0:
        text = _nothing_left(len(residual), len(estimate.z), "table")
    model = evidence.model.frequency_response(
        estimate.coordinates.values(estimate.z), table.frequency_hz, evidence.quantity
    )
    left, size = table.response - model, np.abs(table.response)
    if not problem.has_phase:
        left = size - np.abs(model)
    names = (table.provenance.file or "table",) * table.points
    relative = (
        problem.relative_deviation if scatter is None else problem.relative_deviation * scatter
    )
    turn = np.asarray(problem.data[4]) * (scatter or 1.0)
    adequacy = Adequacy(
        table.frequency_hz, table.response, relative, names, chi2, degrees, adequate, turn, chance
    )
    noise = (1.0 + problem.has_phase) * (adequacy.relative_deviation * size) ** 2
    share = shares_of([_summed(size**2, np.abs(left) ** 2, noise)])
    return Judgement(adequacy, text, adequacy.birge, scatter=scatter, shares=share)


def _excerpts(evidence: Evidence, predicted: tuple[FloatArray, ...]) -> tuple[Signal, ...]:
    """Return a piece of every record from where its response is largest, a few periods long.

    They have :data:`_EXCERPT_SAMPLES` samples together. One that took no part in the fit is NaN.
    """
    signals, tones = [], evidence.tones
    most = int(np.clip(_EXCERPT_SAMPLES // max(len(predicted), 1), 24, 600))
    owners = {} if tones is None else dict(zip(tones.record, tones.frequency_hz, strict=True))
    for index, (record, series) in enumerate(zip(evidence.records, predicted, strict=True)):
        takes_part = record.mask & np.isfinite(series)
        used = np.flatnonzero(takes_part)
        if used.size < 2:
            continue
        residual = record.response[used] - series[used]
        deviation = float(np.std(record.response[used]))
        rmse = float(np.sqrt(np.mean(residual**2)))
        span = used.size
        if index in owners:
            span = int(np.clip(3.0 * record.sampling_rate_hz / owners[index], 16, used.size))
        start = 0
        if record.excitation == "shock":
            peak = int(np.argmax(np.abs(record.response[used] - np.median(record.response[used]))))
            span = min(used.size, max(64, used.size // 4))
            start = int(np.clip(peak - span // 3, 0, used.size - span))
        first, last = int(used[start]), int(used[start + span - 1])
        step = -(-(last - first + 1) // most)
        piece = slice(first, last + 1, step)
        measured = np.where(takes_part[piece], record.response[piece], np.nan)
        signals.append(
            Signal(
                record.name,
                first / record.sampling_rate_hz,
                step / record.sampling_rate_hz,
                measured,
                measured - series[piece],
                evidence.calibration.response_unit,
                rmse,
                rmse / deviation if deviation > 0 else 0.0,
            )
        )
    return tuple(signals)
