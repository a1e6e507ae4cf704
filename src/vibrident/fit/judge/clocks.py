"""The fit at the reference's clock, where the response was read by another clock."""

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
from vibrident.fit.descent.train import MIN_EXPLAINED_SHARE
from vibrident.fit.judge.attempts import MAX_SETTLED_STEP, Fitted
from vibrident.fit.judge.departure_report import departure_names, departures_of
from vibrident.fit.response.bands import band_edges
from vibrident.fit.response.clock_ratio import nearby_offset
from vibrident.fit.response.clock_search import MAX_OFFSET
from vibrident.fit.response.transform import band_sums, power_of
from vibrident.fit.uncertainty.explained import MAX_UNEXPLAINED, MIN_INCOHERENT_MISFIT
from vibrident.fit.uncertainty.parameters import deviations

SOURCE = "the ratio of the two clocks"
CHANGE = "change"  # the departure that two clocks look like: a sensor that changes evenly
MIN_SIGMA = 4.0  # of ε, to be tried
MAX_ROUNDS = 6
TINY = np.finfo(float).tiny
#: Fall of the unexplained power for a fit that remains rejected; the incoherent may not rise so.
MIN_FALL = 2.0


def at_one_clock(fitted: Fitted) -> Fitted:
    """Return the fit with the response at the reference's clock, where two clocks explain the data.

    ε comes from the score of t dŷ/dt beside the parameters and a delay, by Gauss–Newton steps. Each
    step is followed by a fit, so that fit and ε reach their common optimum. The effect of u(ε) on
    the parameters is a row of the budget.
    """
    if any(effect.source == SOURCE for effect in fitted.evidence.effects):
        return fitted
    known = fitted.evidence.clock_offset != 0.0
    if not known:
        fitted = replace(fitted, departures=departures_of(fitted))
        if fitted.adequate and not departure_names(fitted) & {CLOCKS.name, CHANGE}:
            return fitted
    is_rejected = not fitted.adequate and fitted.judgement.adequacy.degrees_of_freedom > 0
    nearby = _distance_to_nearby(fitted) if is_rejected and not known else 0.0
    if not known and nearby == 0.0 and _is_stationary(fitted):
        shares = fitted.judgement.shares
        least = MIN_INCOHERENT_MISFIT * _incoherent_share(fitted)
        if shares.is_incoherent or shares.incoherent_misfit < least:
            return fitted
    settled = _settle_offset(fitted, known, nearby)
    if settled is None:
        return fitted
    best, u = settled
    significant = abs(best.evidence.clock_offset) > MIN_SIGMA * u
    has_offset = best.adequate and significant and CHANGE not in departure_names(best)
    if known:
        return _at_known_offset(fitted, best, u, has_offset)
    if not has_offset:
        return fitted
    # A rejected fit may have been at a wrong place, and ε no more than another start.
    from_best = None if fitted.adequate else _fit_at_offset(best, 0.0)
    if from_best is not None and from_best.adequate:
        return at_one_clock(from_best)
    return _with_statement(best, u)


def _at_known_offset(fitted: Fitted, best: Fitted, u: float, has_offset: bool) -> Fitted:
    """Return the fit at an ε that was corrected before it, or at one clock where that suffices.

    Of ringing alone, two clocks and another natural frequency are one; motion that goes on tells
    them apart.
    """
    if has_offset and math.isfinite(u) and _goes_on(best):
        return _with_statement(best, u)
    at_no_offset = _fit_at_one_clock(best)
    may_state = math.isfinite(u) and not best.judgement.shares.lacking
    if at_no_offset is None:
        return _with_statement(best, u) if may_state else fitted
    if may_state and not _suffices(at_no_offset, best, has_offset):
        return _with_statement(best, u)
    return at_one_clock(at_no_offset)


def _goes_on(fitted: Fitted) -> bool:
    """Return whether the motion of every record is driven to its end."""
    return all(record.excitation not in ("shock", "decay") for record in fitted.evidence.records)


def _is_stationary(fitted: Fitted) -> bool:
    """Return whether the motion of every record is stationary and no sine."""
    return all(record.excitation in STATIONARY_EXCITATIONS for record in fitted.evidence.records)


def _incoherent_share(fitted: Fitted) -> float:
    """Return the share of what two clocks leave unexplained that is incoherent with the motion.

    Two clocks delay motion by ε times its instant. A model without delay leaves all of that
    unexplained, of which the mean delay is coherent with the motion.
    """
    if fitted.evidence.model.has_delay:
        return 1.0
    moments = np.zeros(3)
    for record in fitted.evidence.records:
        if record.reference is None:
            continue
        motion = np.where(record.reference_mask, record.reference, 0.0)
        power = (motion - motion.mean()) ** 2 / max(float(np.var(motion)), TINY)
        moments += [np.sum(power * record.time_s**order) for order in range(3)]
    total, first, second = moments
    return 1.0 - first**2 / max(total * second, TINY)


def _suffices(at_no_offset: Fitted, best: Fitted, has_offset: bool) -> bool:
    """Return whether one clock explains as much; ``has_offset``: whether two clocks explain all."""
    if not has_offset:
        return at_no_offset.adequate or at_no_offset.chi2 < best.chi2
    max_unexplained = MIN_FALL * best.judgement.unexplained
    return at_no_offset.adequate and at_no_offset.judgement.unexplained <= max_unexplained


def _settle_offset(fitted: Fitted, known: bool, nearby: float) -> tuple[Fitted, float] | None:
    """Return the fit at the ε that the score leads to, and u(ε); None where ε is not significant.

    Args:
        fitted: the first fit.
        known: whether the clock was corrected before it.
        nearby: distance to an ε that explains far more, which is tried first; 0 where none does.
    """
    best = fitted
    u = math.inf
    for round_number in range(MAX_ROUNDS):
        step = _offset_step(best)
        if step is None:
            break
        change, u = step
        # First order tells where most of the response to steady motion is explained.
        explains = fitted.judgement.explained > MIN_EXPLAINED_SHARE and _is_stationary(fitted)
        is_told = fitted.adequate or explains
        is_first = round_number == 0 and not (known or nearby)
        if is_first and is_told and abs(change) < MIN_SIGMA * u:
            return None
        # ε may be beyond first order.
        steps = [nearby] if round_number == 0 and nearby else []
        if abs(change) >= MAX_SETTLED_STEP * u:
            steps.append(change)
        improved = next(filter(None, (_improved(best, step) for step in steps)), None)
        if improved is None:
            break
        best = improved
    return best, u


def _improved(fitted: Fitted, change: float) -> Fitted | None:
    """Return the fit at an ε larger by ``change``, or None where it explains no more."""
    candidate = _fit_at_offset(fitted, fitted.evidence.clock_offset + change)
    if candidate is None:
        return None
    # A wrong ratio makes motion incoherent, and what is incoherent is noise.
    incoherent, incoherent_before = (
        1.0 - fit.judgement.shares.coherent for fit in (candidate, fitted)
    )
    if incoherent > MIN_FALL * max(incoherent_before, MAX_UNEXPLAINED):
        return None
    if candidate.adequate:
        return candidate
    # χ² may rise where the misfit falls, as the noise beside it does.
    max_unexplained = fitted.judgement.unexplained / MIN_FALL
    falls = candidate.judgement.unexplained < max_unexplained or (
        candidate.chi2 < fitted.chi2 / MIN_FALL
    )
    return candidate if falls else None


def _fit_at_offset(fitted: Fitted, offset: float) -> Fitted | None:
    """Return the fit at another ε, or None where none converges, or no clock is so far off.

    A rejected fit is no start: its parameters stand in for ε.
    """
    if abs(offset) > MAX_OFFSET:
        return None
    try:
        evidence = fitted.evidence.at_clock(offset)
        if fitted.adequate:
            return fitted.anew(evidence)
        is_near = fitted.judgement.explained > MIN_EXPLAINED_SHARE
        return replace(fitted.once(replace(evidence, is_trial=is_near)), evidence=evidence)
    except VibridentError:
        return None


def _fit_at_one_clock(fitted: Fitted) -> Fitted | None:
    """Return the fit at ε = 0, or None where none converges to a response that can be compared.

    What fits at a wrong clock is no start at the right one.
    """
    try:
        evidence = fitted.evidence.at_clock(0.0)
        candidate = replace(fitted.once(replace(evidence, is_trial=True)), evidence=evidence)
    except VibridentError:
        return None
    return None if math.isnan(candidate.judgement.shares.explained) else candidate


def _distance_to_nearby(fitted: Fitted) -> float:
    """Return the distance from the fit's ε to that of a rational function of the model's order.

    It is 0 where such a function explains little.
    """
    model = fitted.evidence.model.linear
    system = model.rational(fitted.values, fitted.evidence.quantity)
    poles = len(system.denominator) - 1
    zeros = len(system.numerator) - 1
    return nearby_offset(fitted.evidence.records, poles, zeros, delayed=model.has_delay)


def _offset_step(fitted: Fitted) -> tuple[float, float] | None:
    """Return the distance from the fit's ε to that of the score, and its u; None of no score."""
    evidence = fitted.evidence
    estimate = fitted.estimate
    judgement = fitted.judgement
    information: list[RecordInformation] = []
    total: ExactSums | None = None
    spread: FloatArray | float = 0.0
    common: FloatArray | float = 0.0
    for group in groups_of(evidence, estimate, judgement.predicted, judgement.tone_points):
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


def _with_statement(fitted: Fitted, u: float) -> Fitted:
    """Return the fit with the warning of two clocks, and ε's uncertainty in the budget."""
    evidence = fitted.evidence
    offset = evidence.clock_offset
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
    """Return the change of log H for ε = 1: frequency in Hz, real and imaginary part of each point.

    Two clocks delay each frequency by ε times the instant at which it was excited.
    """
    bands = []
    for record in records:
        if record.reference is None:
            continue
        edges = band_edges(record.samples, record.sampling_rate_hz).astype(int)
        motion = np.where(record.reference_mask, record.reference, 0.0)
        motion = motion - motion.mean()
        lines, moment_lines = (np.fft.rfft(values) for values in (motion, motion * record.time_s))
        middle_hz = 0.5 * (edges[1:] + edges[:-1]) * record.sampling_rate_hz / record.samples
        moment = np.real(np.conj(lines) * moment_lines)
        bands.append([middle_hz, *band_sums(np.stack([power_of(lines), moment]), edges)])
    hz, power, moment = np.concatenate(bands, axis=1)
    order = np.argsort(hz, kind="stable")
    loud = order[power[order] > 1e-6 * np.max(power)]
    time_s = moment[loud] / power[loud]
    phase = 2.0 * np.pi * hz[loud] * time_s
    return tuple(
        (frequency, 0.0, angle)
        for frequency, angle in zip(hz[loud].tolist(), phase.tolist(), strict=True)
    )
