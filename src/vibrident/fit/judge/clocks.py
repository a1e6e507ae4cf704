"""The fit at one clock, where the response was read by another than the reference."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vibrident.base.errors import VibridentError
from vibrident.data.records import FloatArray, Record, SystematicEffect
from vibrident.data.screening import Finding
from vibrident.fit.departures.kinds.clocks import CLOCKS, slope_with_time
from vibrident.fit.departures.score import LinearFit
from vibrident.fit.departures.sources import groups_of
from vibrident.fit.departures.sums import ExactSums, RecordInformation
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.judge.examined import departures_of
from vibrident.fit.response.bands import band_edges
from vibrident.fit.response.clock_ratio import nearby_offset
from vibrident.fit.response.transform import power_of
from vibrident.fit.uncertainty.parameters import deviations

SOURCE = "the ratio of the two clocks"
CHANGE = "change"  # the departure that two clocks look like: a sensor that changes evenly
MIN_SIGMA = 4.0  # of ε, to be tried
DELAY_ORDER = 2  # of a rational function for what is left of a delay (Padé)
SETTLED = 0.3  # of its standard uncertainty
MAX_ROUNDS = 6
MIN_FALL = 2.0  # of the power that is not explained, for a fit that is rejected still


def at_one_clock(fitted: Fitted) -> Fitted:
    """Return the fit with the response at the clock of the reference, where two clocks explain the data.

    ε comes from the score of t dŷ/dt beside the parameters and a delay, by Gauss–Newton steps, each
    with a fit; so fit and ε have one optimum together. What u(ε) does to the parameters is a row of
    the budget.
    """
    known = fitted.evidence.clock_offset != 0.0
    if not known:
        fitted = replace(fitted, departures=departures_of(fitted))
        if fitted.adequate and not _names(fitted) & {CLOCKS.name, CHANGE}:
            return fitted
    settled = _settled(fitted, known)
    if settled is None:
        return fitted
    best, u = settled
    offset = best.evidence.clock_offset
    if best.adequate and abs(offset) > MIN_SIGMA * u and CHANGE not in _names(best):
        return _stated(best, offset, u)
    if not known:
        return fitted
    other = _moved(best, 0.0)
    if other is None or not (other.adequate or other.chi2 < best.chi2):
        return _stated(best, offset, u)
    return at_one_clock(other)


def _settled(fitted: Fitted, known: bool) -> tuple[Fitted, float] | None:
    """Return the fit at the ε that its score leads to, and u(ε); None where ε is nothing.

    ``known``: whether the fit is at an ε of its own already.
    """
    best = fitted
    u = math.inf
    for number in range(MAX_ROUNDS):
        step = _step(best)
        if step is None:
            break
        change, u = step
        if number == 0 and best.adequate and not known and abs(change) < MIN_SIGMA * u:
            return None
        if abs(change) < SETTLED * u:
            break
        steps = [change]
        if number == 0 and not best.adequate:  # ε may be beyond first order
            steps = [*filter(None, [_nearby(best)]), change]
        other = next(filter(None, (_better(best, step) for step in steps)), None)
        if other is None:
            break
        best = other
    return best, u


def _better(fitted: Fitted, change: float) -> Fitted | None:
    """Return the fit at an ε that is so much larger; None where it explains no more."""
    other = _moved(fitted, fitted.evidence.clock_offset + change)
    if other is None or other.adequate:
        return other
    # χ² may rise where the misfit falls, as the noise beside it does.
    left, before = (1.0 - each.judgement.explained for each in (other, fitted))
    falls = left < before / MIN_FALL or other.chi2 < fitted.chi2 / MIN_FALL
    return other if falls else None


def _moved(fitted: Fitted, offset: float) -> Fitted | None:
    """Return the fit at another ε; None where it leads to none.

    A fit that was rejected is no start: its parameters stand in for ε.
    """
    try:
        evidence = fitted.evidence.at_clock(offset)
        return fitted.anew(evidence) if fitted.adequate else fitted.once(evidence)
    except VibridentError:
        return None


def _names(fitted: Fitted) -> set[str]:
    """Return the kinds of departures from a fit."""
    return {each.departure.name for group in departures_of(fitted) for each in group.departures}


def _nearby(fitted: Fitted) -> float:
    """Return how far ε is from that of the fit, by a function of the order of the model; 0 of none."""
    model = fitted.evidence.model.linear
    system = model.rational(fitted.values, fitted.evidence.quantity)
    more = DELAY_ORDER if model.has_delay else 0
    orders = len(system.denominator) - 1 + more, len(system.numerator) - 1 + more
    return nearby_offset(fitted.evidence.records, *orders, delayed=model.has_delay)


def _step(fitted: Fitted) -> tuple[float, float] | None:
    """Return how far ε is from that of the fit, and its standard uncertainty; None where nothing tells it."""
    evidence = fitted.evidence
    estimate = fitted.estimate
    judgement = fitted.judgement
    tones = judgement.points[0] if judgement.tones is not None else None
    every: list[RecordInformation] = []
    total: ExactSums | None = None
    spread: FloatArray | float = 0.0
    common: FloatArray | float = 0.0
    for group in groups_of(evidence, estimate, judgement.predicted, tones):
        group = group.again(slope_with_time(group, 0.0))
        rows = group.freed(group.whiten(slope_with_time(group, 0.0)))
        sums = group.exact_sums(rows, None).total()
        total = sums if total is None else total + sums
        every.append(group.own)
        profiles, known = group.spread
        spread = spread + np.sum(profiles, axis=0)
        common = common + np.sum(known, axis=0)
    if total is None:
        return None
    fit = LinearFit.from_records(RecordInformation.joined(every), deviations(estimate.covariance))
    _, _, gram = fit.beside_parameters(total)
    share = gram[0, 1] / gram[1, 1] if gram[1, 1] > total.least[1] else 0.0
    turned = total.combined(np.array([[1.0, -share]]))
    score = replace(fit, spread=np.asarray(spread), common=np.asarray(common)).test(turned)
    if score is None or score.statistic <= 0.0:
        return None
    change = float(score.amounts[0])
    return change, abs(change) / math.sqrt(score.statistic)


def _stated(fitted: Fitted, offset: float, u: float) -> Fitted:
    """Return the fit with the warning, and ε's uncertainty in the budget."""
    evidence = fitted.evidence
    text = (
        f"The clocks of reference and response differ: the intervals of the response are "
        f"1 + ε times those of the reference, ε = {_with_u(offset, u)}. The response was brought to "
        "the clock of the reference before the fit."
    )
    effect = SystematicEffect(SOURCE, "clocks", u, pattern=_pattern(evidence.records))
    findings = (*evidence.findings, Finding("clock_suspect", text))
    evidence = replace(evidence, findings=findings, effects=(*evidence.effects, effect))
    return replace(fitted.with_evidence(evidence), departures=None)


def _with_u(offset: float, u: float) -> str:
    """Return ε ± u, to two digits of u."""
    power = math.floor(math.log10(abs(offset))) if offset else math.floor(math.log10(u))
    digits = max(1 + power - math.floor(math.log10(u)), 0)
    scale = 10.0**power
    return f"({offset / scale:.{digits}f} ± {u / scale:.{digits}f})e{power}"


def _pattern(records: Sequence[Record]) -> tuple[tuple[float, float, float], ...]:
    """Return change of log H for ε = 1: a delay as long as the time at which each frequency was excited."""
    hz = []
    power = []
    late = []
    for record in records:
        if record.reference is None:
            continue
        edges = band_edges(record.samples, record.sampling_rate_hz).astype(int)
        motion = np.where(record.reference_mask, record.reference, 0.0)
        motion = motion - motion.mean()
        x, moment = (np.asarray(np.fft.rfft(v)) for v in (motion, motion * record.time_s))
        sums = [
            np.add.reduceat(v[: edges[-1]], edges[:-1])
            for v in (power_of(x), np.real(np.conj(x) * moment))
        ]
        hz.append(0.5 * (edges[1:] + edges[:-1]) * record.sampling_rate_hz / record.samples)
        power.append(sums[0])
        late.append(sums[1])
    every_hz, every_power, every_late = (np.concatenate(each) for each in (hz, power, late))
    order = np.argsort(every_hz, kind="stable")
    loud = order[every_power[order] > 1e-6 * np.max(every_power)]
    time_s = every_late[loud] / every_power[loud]
    turn = 2.0 * np.pi * every_hz[loud] * time_s
    return tuple((f, 0.0, t) for f, t in zip(every_hz[loud].tolist(), turn.tolist(), strict=True))
