"""The fit at one clock, where the response was read by another than the reference."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vibrident.base.errors import VibridentError
from vibrident.data.records import STATIONARY_EXCITATIONS, FloatArray, Record, SystematicEffect
from vibrident.data.screening import ScreeningFinding
from vibrident.fit.departures.kinds.clocks import CLOCKS, slope_with_time
from vibrident.fit.departures.score import LinearFit
from vibrident.fit.departures.sources import groups_of
from vibrident.fit.departures.sums import ExactSums, RecordInformation
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.judge.departure_report import departures_of
from vibrident.fit.response.bands import band_edges
from vibrident.fit.response.clock_ratio import nearby_offset
from vibrident.fit.response.clock_search import MAX_OFFSET
from vibrident.fit.response.transform import power_of
from vibrident.fit.uncertainty.parameters import deviations

SOURCE = "the ratio of the two clocks"
CHANGE = "change"  # the departure that two clocks look like: a sensor that changes evenly
MIN_SIGMA = 4.0  # of ε, to be tried
DELAY_ORDER = 2  # of a rational function for what remains of a delay (Padé)
MAX_SETTLED_STEP = 0.3  # of ε, in its standard uncertainty
MAX_ROUNDS = 6
MIN_FALL = 2.0  # of the power that is not explained, for a fit that is rejected still


def at_one_clock(fitted: Fitted) -> Fitted:
    """Return the fit with the response at the reference's clock, where two clocks explain the data.

    ε comes from the score of t dŷ/dt beside the parameters and a delay, by Gauss–Newton steps, each
    with a fit; so fit and ε have one optimum together. What u(ε) does to the parameters is a row of
    the budget.
    """
    known = fitted.evidence.clock_offset != 0.0
    if not known:
        fitted = replace(fitted, departures=departures_of(fitted))
        if fitted.adequate and not _departure_names(fitted) & {CLOCKS.name, CHANGE}:
            return fitted
        if _goes_on_alike(fitted) and fitted.judgement.shares.is_of_steady_sensor:
            return fitted
    settled = _settle_offset(fitted, known)
    if settled is None:
        return fitted
    best, u = settled
    offset = best.evidence.clock_offset
    has_offset = best.adequate and abs(offset) > MIN_SIGMA * u
    has_offset = has_offset and CHANGE not in _departure_names(best)
    if not known:
        return _with_statement(best, offset, u) if has_offset else fitted
    # Of ringing alone, two clocks and another natural frequency are one: one clock suffices there.
    at_no_offset = _fit_at_offset(best, 0.0)
    may_state = math.isfinite(u) and not best.judgement.shares.lacking
    if at_no_offset is None:
        return _with_statement(best, offset, u) if may_state else fitted
    if may_state and not _suffices(at_no_offset, best, has_offset):
        return _with_statement(best, offset, u)
    return at_one_clock(at_no_offset)


def _goes_on_alike(fitted: Fitted) -> bool:
    """Return whether the motion of every record goes on alike, and no sine is among them."""
    kinds = {record.excitation for record in fitted.evidence.records}
    return kinds <= set(STATIONARY_EXCITATIONS)


def _suffices(at_no_offset: Fitted, best: Fitted, has_offset: bool) -> bool:
    """Return whether one clock explains as much; ``has_offset``: whether two clocks explain all."""
    if not has_offset:
        return at_no_offset.adequate or at_no_offset.chi2 < best.chi2
    unexplained, unexplained_best = (1.0 - fit.judgement.explained for fit in (at_no_offset, best))
    return at_no_offset.adequate and unexplained <= MIN_FALL * unexplained_best


def _settle_offset(fitted: Fitted, known: bool) -> tuple[Fitted, float] | None:
    """Return the fit at the ε that its score leads to, and u(ε); None where ε is nothing.

    ``known``: whether the fit is at an ε of its own already.
    """
    best = fitted
    u = math.inf
    for round_number in range(MAX_ROUNDS):
        step = _offset_step(best)
        if step is None:
            break
        change, u = step
        if round_number == 0 and best.adequate and not known and abs(change) < MIN_SIGMA * u:
            return None
        if abs(change) < MAX_SETTLED_STEP * u:
            break
        steps = [change]
        if round_number == 0 and not best.adequate:  # ε may be beyond first order
            steps = [*filter(None, [_distance_to_nearby(best)]), change]
        improved = next(filter(None, (_improved(best, step) for step in steps)), None)
        if improved is None:
            break
        best = improved
    return best, u


def _improved(fitted: Fitted, change: float) -> Fitted | None:
    """Return the fit at an ε larger by ``change``, or None where it explains no more."""
    candidate = _fit_at_offset(fitted, fitted.evidence.clock_offset + change)
    if candidate is None or candidate.adequate:
        return candidate
    # χ² may rise where the misfit falls, as the noise beside it does.
    unexplained, unexplained_before = (1.0 - fit.judgement.explained for fit in (candidate, fitted))
    falls = unexplained < unexplained_before / MIN_FALL or candidate.chi2 < fitted.chi2 / MIN_FALL
    return candidate if falls else None


def _fit_at_offset(fitted: Fitted, offset: float) -> Fitted | None:
    """Return the fit at another ε, or None where it leads to none, or no clock goes so wrong.

    A fit that was rejected is no start: its parameters stand in for ε.
    """
    if abs(offset) > MAX_OFFSET:
        return None
    try:
        evidence = fitted.evidence.at_clock(offset)
        return fitted.anew(evidence) if fitted.adequate else fitted.once(evidence)
    except VibridentError:
        return None


def _departure_names(fitted: Fitted) -> set[str]:
    """Return the kinds of departures from a fit."""
    return {
        departure.kind.name for group in departures_of(fitted) for departure in group.departures
    }


def _distance_to_nearby(fitted: Fitted) -> float:
    """Return how far ε is from that of the fit, by a function of the model's order; 0 of none."""
    model = fitted.evidence.model.linear
    system = model.rational(fitted.values, fitted.evidence.quantity)
    delay_order = DELAY_ORDER if model.has_delay else 0
    orders = len(system.denominator) - 1 + delay_order, len(system.numerator) - 1 + delay_order
    return nearby_offset(fitted.evidence.records, *orders, delayed=model.has_delay)


def _offset_step(fitted: Fitted) -> tuple[float, float] | None:
    """Return how far ε is from that of the fit, and its u; None where nothing tells it."""
    evidence = fitted.evidence
    estimate = fitted.estimate
    judgement = fitted.judgement
    tones = judgement.points[0] if judgement.tones is not None else None
    information: list[RecordInformation] = []
    total: ExactSums | None = None
    spread: FloatArray | float = 0.0
    common: FloatArray | float = 0.0
    for group in groups_of(evidence, estimate, judgement.predicted, tones):
        group = group.again(slope_with_time(group, 0.0))
        rows = group.freed(group.whiten(slope_with_time(group, 0.0)))
        sums = group.exact_sums(rows, None).total()
        total = sums if total is None else total + sums
        information.append(group.information)
        profiles, known = group.spread
        spread = spread + np.sum(profiles, axis=0)
        common = common + np.sum(known, axis=0)
    if total is None:
        return None
    fit = LinearFit.from_records(
        RecordInformation.joined(information), deviations(estimate.covariance)
    )
    _, _, gram = fit.beside_parameters(total)
    delay_share = gram[0, 1] / gram[1, 1] if gram[1, 1] > total.least[1] else 0.0
    beside_delay = total.combined(np.array([[1.0, -delay_share]]))
    score = replace(fit, spread=np.asarray(spread), common=np.asarray(common)).test(beside_delay)
    if score is None or score.statistic <= 0.0:
        return None
    change = float(score.amounts[0])
    return change, abs(change) / math.sqrt(score.statistic)


def _with_statement(fitted: Fitted, offset: float, u: float) -> Fitted:
    """Return the fit with the warning of two clocks, and ε's uncertainty in the budget."""
    evidence = fitted.evidence
    text = (
        f"The clocks of reference and response differ: the intervals of the response are "
        f"1 + ε times those of the reference, ε = {_format_with_u(offset, u)}. The response was "
        "brought to the clock of the reference before the fit."
    )
    effect = SystematicEffect(SOURCE, "clocks", u, pattern=_delay_pattern(evidence.records))
    findings = (*evidence.findings, ScreeningFinding("clock_suspect", text))
    evidence = replace(evidence, findings=findings, effects=(*evidence.effects, effect))
    return replace(fitted.with_evidence(evidence), departures=None)


def _format_with_u(offset: float, u: float) -> str:
    """Return ε ± u, to two digits of u."""
    power = math.floor(math.log10(abs(offset))) if offset else math.floor(math.log10(u))
    digits = max(1 + power - math.floor(math.log10(u)), 0)
    scale = 10.0**power
    return f"({offset / scale:.{digits}f} ± {u / scale:.{digits}f})e{power}"


def _delay_pattern(records: Sequence[Record]) -> tuple[tuple[float, float, float], ...]:
    """Return the change of log H for ε = 1.

    It is a delay as long as the time at which each frequency was excited.
    """
    hz_by_record = []
    powers_by_record = []
    moments_by_record = []
    for record in records:
        if record.reference is None:
            continue
        edges = band_edges(record.samples, record.sampling_rate_hz).astype(int)
        motion = np.where(record.reference_mask, record.reference, 0.0)
        motion = motion - motion.mean()
        lines, moment = (
            np.asarray(np.fft.rfft(values)) for values in (motion, motion * record.time_s)
        )
        sums = [
            np.add.reduceat(values[: edges[-1]], edges[:-1])
            for values in (power_of(lines), np.real(np.conj(lines) * moment))
        ]
        hz_by_record.append(
            0.5 * (edges[1:] + edges[:-1]) * record.sampling_rate_hz / record.samples
        )
        powers_by_record.append(sums[0])
        moments_by_record.append(sums[1])
    all_hz, power, moment_sum = (
        np.concatenate(arrays) for arrays in (hz_by_record, powers_by_record, moments_by_record)
    )
    order = np.argsort(all_hz, kind="stable")
    loud = order[power[order] > 1e-6 * np.max(power)]
    time_s = moment_sum[loud] / power[loud]
    phase = 2.0 * np.pi * all_hz[loud] * time_s
    return tuple(
        (frequency, 0.0, angle)
        for frequency, angle in zip(all_hz[loud].tolist(), phase.tolist(), strict=True)
    )
