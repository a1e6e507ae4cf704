"""The verdict of an estimate on its data: prediction, deviations, their test, excerpts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vibrident.base.amounts import plain
from vibrident.base.errors import InputError
from vibrident.data.records import FloatArray, Record, SystematicEffect
from vibrident.fit.decay import decay_deviations
from vibrident.fit.descent.weighted_bins import (
    PredictedRecord,
    Transfer,
    WeightedBins,
    weighted_records,
    weighted_segments,
)
from vibrident.fit.estimators import Estimate
from vibrident.fit.estimators.residual_tones import network_problem, residual_tones
from vibrident.fit.judge.excerpts import excerpts
from vibrident.fit.judge.misfit import describe_misfit, describe_no_freedom
from vibrident.fit.problem import Evidence, network_of
from vibrident.fit.response import MeasuredResponse
from vibrident.fit.response.bands import LINES_IN_BAND
from vibrident.fit.response.rounding import rounding_variance
from vibrident.fit.response.transform import about_mean, line_frequencies, power_of
from vibrident.fit.response.verdict import REJECTION, probability
from vibrident.fit.uncertainty.adequacy import (
    Adequacy,
    Points,
    assess,
    factor_points,
    looks_random,
    tone_points,
)
from vibrident.fit.uncertainty.explained import (
    MAX_UNEXPLAINED,
    UNKNOWN_SHARES,
    Shares,
    powers,
    shares_of,
)
from vibrident.fit.uncertainty.factors import band_factors
from vibrident.fit.uncertainty.steps import effects_of_steps
from vibrident.physics.discretisation import Weights
from vibrident.physics.discretisation.weights import weight_table
from vibrident.result import Signal

if TYPE_CHECKING:
    from vibrident.fit.decay.deviations import DecayDeviation


@dataclass(frozen=True, eq=False)
class Judgement:
    """The verdict on the data by an estimate.

    Attributes:
        adequacy: points, χ², verdict.
        lack_of_fit: text of the warning, for a model that is not adequate.
        birge: factor on the uncertainties that the deviations demand, at least one.
        predicted: predicted response of each record, NaN where it is not defined; empty for a
            table.
        scatter: standard deviation of the weighted residuals where no uncertainty was stated, else
            None.
        signals: excerpts for pictures.
        weights: the network's weights as the paper's Table 1.
        tones: of the sine records, cleaned; None without sines.
        points: what the adequacy is made of, those of the tones first.
        detected_effects: systematic effects that were found in the data.
        effects: stated and detected ones, each with the amount that the data show, in its standard
            uncertainty.
        remedy_chi2: χ²/ν of another model that explains the data, so that all departures are
            misfit; None where none does.
        explained_by: name of that model.
        shares: of the response's power.
        least_explained: the smallest share that the model explains of any record; one where none
            has a reference.
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
    detected_effects: tuple[SystematicEffect, ...] = ()
    effects: tuple[tuple[SystematicEffect, float], ...] = ()
    remedy_chi2: float | None = None
    explained_by: str = ""
    shares: Shares = UNKNOWN_SHARES
    least_explained: float = 1.0

    @property
    def tone_points(self) -> Points | None:
        """Return the points of the tones, None without sines."""
        return None if self.tones is None else self.points[0]

    @property
    def explained(self) -> float:
        """Return the share of the response's power that the model explains; one where not known."""
        return 1.0 if np.isnan(self.shares.explained) else self.shares.explained

    @property
    def unexplained(self) -> float:
        """Return the share of the response's power that the model leaves; zero where not known."""
        return 1.0 - self.explained


def judge_records(evidence: Evidence, estimate: Estimate) -> Judgement:
    """Predict every record and compare it with the measured response, band by band."""
    model = evidence.model
    quantity = evidence.quantity
    values = estimate.coordinates.values(estimate.z)

    def response(frequency: FloatArray) -> Any:
        return model.frequency_response(values, frequency, quantity)

    points: list[Points] = []
    powers_of_tones: list[FloatArray] = []
    tones = None
    predicted, weights = _predict(evidence, estimate)
    if evidence.tones is not None and estimate.criterion != "samples":
        tones = estimate.tones or _clean_tones(evidence, estimate)
        points.append(tone_points(tones, response, [record.name for record in evidence.records]))
        powers_of_tones.append(_powers_of_tones(tones, response))
    powers_by_record = list(powers_of_tones)
    delay_s = model.delay_s(values)
    band_hz = _band_of_fit(evidence, estimate)
    for bins in weighed_records(evidence, estimate, predicted, sines=tones is None):
        record = evidence.records[bins.record]
        sine = record.excitation == "sine"
        factors = band_factors(bins, sine=sine, least=_rounding_floor(record, bins, response))
        if factors is not None:
            points.append(factor_points(factors, record, bins.samples, response))
        powers_by_record.append(_powers(band_hz, record, bins, delay_s))
    decays = decay_deviations(evidence.records, model, values)
    adequacy = assess(points, len(estimate.z), decays)
    if _is_measurement(evidence, adequacy.degrees_of_freedom, adequacy.frequency_hz):
        adequacy = replace(adequacy, adequate=True)
    birge = _birge(estimate, points, adequacy, decays)
    lack_of_fit = describe_misfit(adequacy, points, response, decays)
    shares = shares_of(powers_by_record)
    if not (adequacy.adequate and shares.explained > 1.0 - MAX_UNEXPLAINED):
        # What is common to both channels ends where a first look sees it end, not the fit, and
        # begins where either does.
        low_hz, high_hz = _band_of_look(evidence, estimate)
        band_hz = min(band_hz[0], low_hz), high_hz
        powers_by_record = powers_of_tones + [
            _powers(band_hz, evidence.records[bins.record], bins, delay_s)
            for bins in weighed_records(
                evidence, estimate, predicted, sines=tones is None, fitted_everywhere=True
            )
        ]
        shares = shares_of(powers_by_record)
    effects: list[SystematicEffect] = []
    if model.is_linear:
        band_limited = estimate.findings.method.is_band_limited
        effects = effects_of_steps(
            evidence.records, predicted, response, adequacy, band_limited=band_limited
        )
    if shares.lacking:
        lack_of_fit = str(shares) if adequacy.adequate else f"{lack_of_fit} {shares}"
        adequacy = replace(adequacy, adequate=False)
    return Judgement(
        adequacy,
        lack_of_fit,
        birge,
        predicted,
        signals=excerpts(evidence, predicted),
        weights=weights,
        tones=tones,
        points=tuple(points),
        detected_effects=tuple(effects),
        shares=shares,
        least_explained=min(
            (shares_of([part]).explained for part in powers_by_record), default=1.0
        ),
    )


def weighed_records(
    evidence: Evidence,
    estimate: Estimate,
    predicted: Sequence[FloatArray],
    *,
    sines: bool,
    fitted_everywhere: bool = False,
) -> Iterator[WeightedBins]:
    """Yield records with a reference, or their segments, in the noise at the estimate.

    Args:
        evidence: the data.
        estimate: the fit.
        predicted: response of each record, NaN where it is not defined.
        sines: whether sines are among them.
        fitted_everywhere: as of :func:`weighted_segments`.
    """
    wanted = {
        number
        for number, record in enumerate(evidence.records)
        if record.reference is not None and (sines or record.excitation != "sine")
    }
    if estimate.in_noise is not None and wanted:
        segments = weighted_segments(
            estimate.in_noise,
            estimate.z,
            estimate.coordinates,
            fitted_everywhere=fitted_everywhere,
        )
        yield from (bins for bins in segments if bins.record in wanted)
        return
    for number in sorted(wanted):
        record = PredictedRecord(number, evidence.records[number], predicted[number])
        yield from weighted_records([record])


def _rounding_floor(record: Record, bins: WeightedBins, response: Transfer) -> FloatArray | float:
    """Return the variance a sample of the converters' rounding, shape (bins,); zero without any.

    No noise is below it.
    """
    hz = line_frequencies(bins.samples, record.sampling_rate_hz)[: bins.residual.size]
    variance = rounding_variance(record, lambda: power_of(response(hz)))
    return 0.0 if variance is None else variance


def _band_of_fit(evidence: Evidence, estimate: Estimate) -> tuple[float, float]:
    """Return the band of the fit in Hz, less what drift and free motion are in."""
    low, high = estimate.coordinates.band_hz.tolist()
    shortest_s = min(record.duration_s for record in evidence.records)
    return max(low, LINES_IN_BAND / shortest_s), high


def _band_of_look(evidence: Evidence, estimate: Estimate) -> tuple[float, float]:
    """Return the band of the nonparametric response where the network's inputs are accurate, Hz."""
    low, high = evidence.band_hz
    if estimate.in_noise is not None:
        high = min(high, estimate.in_noise.band.problem.frame.top_hz)
    return low, high


def _powers(
    band_hz: tuple[float, float], record: Record, bins: WeightedBins, delay_s: float
) -> FloatArray:
    """Return a record's summands of the shares of the response's power, in the motion's band."""
    assert record.reference is not None
    low, high = (int(hz * bins.samples / record.sampling_rate_hz) for hz in band_hz)
    band = slice(max(low, 1), high + 2)
    delay = delay_s * record.sampling_rate_hz
    late = round(delay)  # the response of a span is to what the reference was before
    used = _earlier(record.reference_mask, bins.span, late) & bins.used
    reference = about_mean(_earlier(record.reference, bins.span, late), used)
    response = about_mean(record.response[bins.span], bins.used)
    is_sine = record.excitation == "sine"
    return powers(bins, reference, response, delay - late, band, where_excited=is_sine)


def _earlier(series: NDArray[Any], span: slice, late: int) -> NDArray[Any]:
    """Return what a series was so many samples before those of a span, zero beyond its ends."""
    first, last = (min(max(at - late, 0), series.size) for at in (span.start, span.stop))
    before = min(max(late - span.start, 0), span.stop - span.start)
    known = series[first:last]
    if known.size == span.stop - span.start:
        return known
    return np.pad(known, (before, span.stop - span.start - known.size - before))


def _powers_of_tones(tones: MeasuredResponse, response: Transfer) -> FloatArray:
    """Return the sines' summands of the shares of the response's power; all noise is incoherent.

    A sine counts as far as its amplitude is no noise: that of less than a period may be of any
    size.
    """
    residual = tones.response - response(tones.frequency_hz) * tones.reference
    power = power_of(tones.response)
    noise = 2.0 * tones.error_deviation(response) ** 2
    known = np.maximum(1.0 - noise / np.maximum(power, np.finfo(float).tiny), 0.0)
    return _sum_powers(known * power, known * power_of(residual), known * noise)


def _sum_powers(power: FloatArray, residual_power: FloatArray, noise: FloatArray) -> FloatArray:
    """Return sums over points as those of :func:`powers`; all noise is incoherent."""
    return np.sum([power, residual_power, noise, noise**2], axis=1)


def _clean_tones(evidence: Evidence, estimate: Estimate) -> MeasuredResponse:
    """Return the tones at the estimate, by the network with exact weights.

    A network that was trained with other weights is not used.
    """
    exact = estimate.findings.method.is_band_limited
    values = estimate.coordinates.values(estimate.z)
    problem = (estimate.problem if exact else None) or network_problem(evidence, values)
    predicted = estimate.predicted if exact else None
    return residual_tones(evidence, problem, estimate.coordinates, estimate.z, predicted)


def _birge(
    estimate: Estimate,
    points: Sequence[Points],
    adequacy: Adequacy,
    decays: Sequence[DecayDeviation],
) -> float:
    """Return the factor by which deviations exceed the estimate's own covariance: √(χ²/dof) ≥ 1.

    Equal weights are by a record's residual with its misfit, so deviations are compared with that.
    """
    network = estimate.findings.network
    if network is None or network.weights != "white" or adequacy.degrees_of_freedom <= 0:
        return adequacy.birge
    total = sum(
        float(np.sum(group.squares * group.unweighted))
        for group in points
        if group.unweighted is not None
    )
    total += sum(decay.parts.chi2 for decay in decays)
    return float(np.sqrt(max(total / adequacy.degrees_of_freedom, 1.0)))


def _is_measurement(evidence: Evidence, degrees: int, frequency_hz: FloatArray) -> bool:
    """Return whether the model states the response measured at one frequency, and nothing else."""
    at_one_frequency = len(set(frequency_hz.tolist())) == 1
    return evidence.model.is_gain_alone and degrees == 0 and at_one_frequency


def _predict(
    evidence: Evidence, estimate: Estimate
) -> tuple[tuple[FloatArray, ...], dict[str, Any]]:
    """Return the responses that the network predicts, and its weights as the paper's Table 1.

    The network has the weights of its training, or exact ones if it was not trained.
    """
    step = estimate.findings.method
    values = estimate.coordinates.values(estimate.z)
    try:
        problem = estimate.problem or network_of(
            evidence.records, evidence.model, step, evidence.quantity, values
        )
    except InputError:  # all records are too short to interpolate: only the tones remain
        return tuple(np.full(record.samples, np.nan) for record in evidence.records), {}
    predicted = estimate.predicted or tuple(problem.predict(estimate.coordinates, estimate.z))
    if estimate.criterion != "samples":
        return predicted, {}
    first = Weights(*(np.asarray(weight)[0] for weight in problem.weights(values)))
    scale = evidence.model.rational(values, evidence.quantity).angular_scale
    try:
        table = weight_table(first, scale ** np.arange(problem.frame.order))  # states V, V̇
    except np.linalg.LinAlgError:
        # A sensor that forgets its state within a sample has no W2 = C Φ⁻¹.
        return predicted, {}
    return predicted, {
        **table,
        "discretisation": step.name,
        "sampling_interval_s": min(record.sampling_interval_s for record in evidence.records),
    }


def judge_decays(evidence: Evidence, estimate: Estimate) -> Judgement:
    """Compare free decays, which have no reference, with the free motion in stretches of time."""
    from vibrident.fit.decay import estimate as free  # only where there are decays

    predicted = free.predicted(evidence, estimate)
    verdict, text = free.lack_of_fit(estimate)
    adequacy = Adequacy(np.zeros(0), np.zeros(0, dtype=complex), np.zeros(0), (), *verdict)
    return Judgement(
        adequacy, text, adequacy.birge, predicted, signals=excerpts(evidence, predicted)
    )


def judge_table(evidence: Evidence, estimate: Estimate) -> Judgement:
    """Compare the model with the points of a table."""
    table = evidence.calibration.table
    problem = evidence.first_look
    assert table is not None
    assert problem is not None
    residual = problem.residual(estimate.z, estimate.coordinates)
    squares = float(np.sum(residual**2))
    degrees = len(residual) - len(estimate.z)
    chi2 = squares / degrees if degrees > 0 else None
    chance = probability(squares, degrees)
    explains = chance >= REJECTION
    relative = problem.relative_deviation
    scatter = None
    if table.magnitude_uncertainty is None:
        # Where no point is left to judge the scatter by, the points determine nothing.
        scatter = 1e8 if chi2 is None else float(np.sqrt(chi2))
        relative = relative * scatter
        chi2 = None
        chance = 1.0
        order = np.argsort(table.frequency_hz, kind="stable")
        explains = all(map(looks_random, residual.reshape(-1, table.points)[:, order]))
        text = (
            "The deviations from the model follow a pattern along frequency: "
            "the model does not explain the table."
        )
    else:
        text = (
            "The model does not explain the table: deviations are "
            f"{plain((chi2 or 0.0) ** 0.5, 3)} times the stated uncertainties "
            f"(χ²/dof = {plain(chi2 or 0.0, 4)}, {degrees} degrees of freedom)."
        )
        if problem.has_phase and table.phase_uncertainty_rad is None:
            text += " The phase's, which is not stated, is taken to be the magnitude's, in rad."
    if degrees <= 0:
        text = describe_no_freedom(len(residual), len(estimate.z), "table")
    model = evidence.model.frequency_response(
        estimate.coordinates.values(estimate.z), table.frequency_hz, evidence.quantity
    )
    size = np.abs(table.response)
    deviation = table.response - model if problem.has_phase else size - np.abs(model)
    noise = (1.0 + problem.has_phase) * (relative * size) ** 2
    shares = shares_of([_sum_powers(size**2, np.abs(deviation) ** 2, noise)])
    is_measurement = _is_measurement(evidence, degrees, table.frequency_hz)
    adequacy = Adequacy(
        table.frequency_hz,
        table.response,
        relative,
        (table.provenance.file or "table",) * table.points,
        chi2,
        degrees,
        is_measurement or (degrees > 0 and explains),
        problem.data[4] * (scatter or 1.0),
        chance,
    )
    return Judgement(adequacy, text, adequacy.birge, scatter=scatter, shares=shares)
