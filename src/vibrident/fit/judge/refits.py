"""Fits of other data than were given: without dead records, drift or hum, and with a scatter that was not stated.

Each step takes the attempt so far and returns it, or a better one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vibrident.data.records import FloatArray, Record
from vibrident.fit.estimators import Estimate
from vibrident.fit.information import inverse_where_shown
from vibrident.fit.judge.attempts import Attempt
from vibrident.fit.problem import Evidence, network_of
from vibrident.fit.problem.frequency_domain import response_residual
from vibrident.fit.response.explained import part_left
from vibrident.fit.response.verdict import rejected
from vibrident.fit.screening.drift import beside_slow_motion, slow_tones, without_drift
from vibrident.fit.screening.hum import Tones, hum_tones, without_tones
from vibrident.fit.uncertainty.adequacy import looks_random
from vibrident.physics.discretisation import method

#: Records that seem dead are left out where the model explains the others so many times better.
MUCH_BETTER = 4.0
#: Rounds in which the scatter of a table's phase settles, at most.
PHASE_ROUNDS = 20
#: It is settled when it changes by less than this part.
PHASE_SETTLED = 0.01
#: What a table's record and the result say of it.
PHASE_BY_SCATTER = "the phase's uncertainty, which the table does not state, by its scatter"
#: Free motion of fewer turns over a record than this may be taken for a drift.
AS_SLOW = 5.0
#: Largest standard uncertainty of a coordinate with which two estimates are compared.
KNOWN = 0.05
#: Rounds in which hum is told from what the fit before took of it.
HUM_ROUNDS = 5
#: Change of a tone's place, in lines, that needs no further round.
HUM_SETTLED = 0.01


def without_dead_records(first: Attempt) -> Attempt:
    """The fit without records that seem dead, where the model explains the others so much better."""
    others = first.evidence.without_dead_records()
    if others is None:
        return first
    better = first.afresh(others)
    chi2 = [attempt.judgement.adequacy.chi2_reduced or np.inf for attempt in (better, first)]
    # A dead record of little noise may draw the whole fit to itself, and leave the others as noise.
    records, predicted = first.evidence.records, first.judgement.predicted
    kept = [index for index, record in enumerate(records) if any(record is other for other in others.records)]
    left = [part_left(others.records, p) for p in (better.judgement.predicted, [predicted[i] for i in kept])]
    spoilt = chi2[0] < chi2[1] / MUCH_BETTER or left[0] < left[1] / MUCH_BETTER
    return better if spoilt else first


def with_phase_scatter(first: Attempt) -> Attempt:
    """The fit of a table that states the magnitude's uncertainty alone: that of the phase is seen in its deviations.

    It is taken in proportion to the magnitude's. Where the deviations follow a pattern, the model does not explain the
    phase, and their size says nothing of its uncertainty.
    """
    calibration, problem, now = first.evidence.calibration, first.evidence.first_look, first
    table = calibration.table
    if table is None or problem is None or not problem.has_phase:
        return first
    if table.magnitude_uncertainty is None or table.phase_uncertainty_rad is not None:
        return first
    free, order = table.points - 0.5 * len(first.estimate.z), np.argsort(table.frequency_hz, kind="stable")
    provenance = replace(table.provenance, history=(*table.provenance.history, PHASE_BY_SCATTER))
    known = 1.0
    for _ in range(PHASE_ROUNDS if free > 1.0 else 0):
        args = (now.estimate.coordinates, problem.polar, problem.has_phase, first.evidence.quantity, problem.data)
        turn = np.asarray(response_residual(now.estimate.z, *args))[table.points :][order]
        scatter = float(np.sqrt(np.sum(turn**2) / free))
        if abs(scatter - known) < PHASE_SETTLED * known or scatter == 0.0:
            return now if looks_random(turn) else first
        known, stated = scatter, scatter * problem.relative_deviation
        told = replace(table, phase_uncertainty_rad=stated, provenance=provenance)
        again = first.anew(Evidence.gather(replace(calibration, table=told), first.evidence.model))
        now = replace(again, phase_by_scatter=True)
    return first


def without_drifts(first: Attempt) -> Attempt:
    """The fit of the records without the drift that is seen beside the predicted response."""
    evidence, unit = first.evidence, first.evidence.calibration.response_unit
    beside = _beside_slow_motion(first)
    predicted = first.judgement.predicted if beside is None else beside
    records, drifts = without_drift(evidence.records, predicted, unit, likely=beside is not None and first.adequate)
    if all(kept is record for kept, record in zip(records, evidence.records, strict=True)):
        return replace(first, drifts=tuple(drifts))
    return replace(first.anew(evidence.with_records(records)), drifts=tuple(drifts))


def _beside_slow_motion(first: Attempt) -> Sequence[FloatArray] | None:
    """What a fit beside slow motion of every record's zero predicts, where the data ask for it.

    A sensor whose own free motion is as slow takes a drift for that, and its residual does not show it: the parameters
    do, which then move by more than noise lets them.
    """
    evidence, estimate = first.evidence, first.estimate
    values = estimate.coordinates.values(estimate.z)
    slowest = min((value for name, value in values.items() if name.endswith("frequency")), default=np.inf)
    slow = any(slowest * record.duration_s < AS_SLOW for record in evidence.records)
    if not slow or not evidence.model.is_linear:
        return None
    others = evidence.with_records(tuple(beside_slow_motion(record) for record in evidence.records))
    again = first.once(replace(others, start=values)) if first.adequate else first.anew(others)
    if not again.adequate or (first.adequate and not _moved(estimate, again.estimate)):
        return None
    return again.judgement.predicted


def _moved(estimate: Estimate, freer: Estimate) -> bool:
    """Whether further unknowns move an estimate by more than its noise then makes likely (Hausman 1978).

    Beside unknowns that imitate the motion little is left to tell the parameters by: along a valley as long as that a
    step is no straight one, and nothing is seen to move.
    """
    if np.any(np.diag(freer.covariance) > KNOWN**2):
        return False
    shift = freer.coordinates.place(estimate.coordinates.values(estimate.z)) - freer.z
    return rejected(float(shift @ inverse_where_shown(freer.covariance) @ shift), len(shift))


def without_hum(first: Attempt) -> Attempt:
    """The fit with hum as unknowns of every record, where that explains the data.

    What initial states and parameters took of it is in all lines, so that only a fit beside it tells its frequency.
    """
    evidence, slow, known = first.evidence, _slow(first.evidence), first.estimate.findings.hum_hz
    seen = first.estimate.tones is not None or (any(known) and known != slow)
    if not evidence.records or not evidence.model.is_linear or (first.adequate and not seen):
        return first
    plain = _without_knowing_hum(first)
    # What the start values left may be no hum.
    if plain is not None and hum_tones(evidence.records, plain, slow) == slow:
        values = first.estimate.coordinates.values(first.estimate.z)
        again = first.anew(replace(evidence, start=values))
        if again.adequate:
            return replace(again, evidence=evidence)
    best, now, known = first, first, slow
    for number in range(HUM_ROUNDS):
        tones = hum_tones(evidence.records, now.judgement.predicted, known)
        # The first fit beside hum is of records from which what the fit before took for hum was removed.
        if tones == slow or (number > 1 and _alike(tones, known, evidence.records)):
            break
        known = tones
        cleaned = without_tones(evidence.records, now.judgement.predicted, tones)
        now = first.anew(evidence.with_records(cleaned))
        if not now.adequate:
            break
        best = now
    return best


def _slow(evidence: Evidence) -> Tones:
    return tuple(slow_tones(record) for record in evidence.records)


def _without_knowing_hum(first: Attempt) -> tuple[FloatArray, ...] | None:
    """Prediction of records with hum in them, where the estimate was made beside it; None where it was not.

    What initial states can imitate is left to them: it is no hum.
    """
    evidence, estimate = first.evidence, first.estimate
    if estimate.problem is None or all(record.hum_hz == slow_tones(record) for record in estimate.problem.records):
        return None
    values = estimate.coordinates.values(estimate.z)
    network = estimate.findings.network
    same = method(network.discretisation if network is not None else "bandlimited")
    plain = network_of(evidence.records, evidence.model, same, evidence.quantity, values)
    return tuple(plain.predict(estimate.coordinates, estimate.z))


def _alike(tones: Tones, known: Tones, records: Sequence[Record]) -> bool:
    """Whether two sets of tones are the same within a hundredth of a line."""
    if [len(own) for own in tones] != [len(own) for own in known]:
        return False
    return all(
        abs(one - other) * record.duration_s < HUM_SETTLED
        for record, own, before in zip(records, tones, known, strict=True)
        for one, other in zip(own, before, strict=True)
    )
