"""The main path: calibration → evidence → estimate → uncertainty → result."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from vibrident.decay import decays_alone
from vibrident.discretize import method
from vibrident.estimators import AUTO, Estimate, Estimator, choose
from vibrident.estimators.optimise import Progress, silent
from vibrident.judge import (
    Fitted,
    Judgement,
    Uncertainty,
    document,
    fitted_and_judged,
    linearised,
    own_rows,
    with_phase_scatter,
    with_remedy,
    without_dead_records,
)
from vibrident.measure.drift import beside_slow_motion, slow_tones, without_drift
from vibrident.measure.hum import Tones, hum_tones, without_tones
from vibrident.models import model_of
from vibrident.problem import Evidence, network_of
from vibrident.records import Calibration, FloatArray, Record
from vibrident.registry import ESTIMATORS
from vibrident.result import Result
from vibrident.uncertainty.budget import BudgetRow

#: Rounds in which hum is told from what the fit before took of it.
HUM_ROUNDS = 5
#: Change of a tone's place, in lines, that needs no further round.
HUM_SETTLED = 0.01
#: Free motion of fewer turns over a record than this may be taken for a drift.
AS_SLOW = 5.0

if TYPE_CHECKING:
    from vibrident.uncertainty.posterior import Sampling


def identify(
    calibration: Calibration | str | os.PathLike[str],
    model: str | None = None,
    estimator: str | Estimator = AUTO,
    *,
    uncertainty: Uncertainty = "auto",
    posterior: Sampling | None = None,
    progress: Progress = silent,
) -> Result:
    """Identify a sensor from its calibration.

    Args:
        calibration: from :func:`vibrident.read`, :func:`vibrident.simulate` or made by hand; or the path of a
            calibration file.
        model: name of the sensor model; None takes the calibration's.
        estimator: ``auto``, a name, or an estimator object with settings of its own, such as
            ``Ipnn(discretisation="euler", optimiser="adam")``.
        uncertainty: what the uncertainties cover. ``noise``: the noise, or the stated uncertainty, of the data alone.
            ``inflated``: where the deviations from the model are larger than that, the misfit too: sine records under
            ``ml`` get a relative model error, all else is scaled by √(χ²/dof) (Birge ratio). ``auto``: ``inflated`` for
            records whose model is rejected (with the warning ``lack_of_fit``), ``noise`` otherwise; the stated
            uncertainties of a table are never scaled unasked.
        posterior: settings for sampling the parameters' posterior distribution, which ``settings.posterior`` then
            sums up; for the estimator ``ml``, with the extra ``bayes``. None: not sampled.
        progress: called after each iteration of the optimiser.

    Returns:
        The result; its warnings are empty for a clean calibration of an adequate model.

    Raises:
        InputError: the data cannot be used.
        ModelError: model, estimator and data do not fit together.
        NotConverged: no start leads to a finite fit.
    """
    if not isinstance(calibration, Calibration):
        from vibrident.io import read

        calibration = read(calibration)
    if decays_alone(calibration):
        from vibrident.decay.document import identify_decays, require_plain

        require_plain(estimator, sampled=posterior is not None)
        return identify_decays(calibration, model, inflate=uncertainty != "noise")
    begin = time.perf_counter()
    if posterior is not None:
        from vibrident.uncertainty.posterior import sampler

        sampler()  # before the fit that it would come after
    fitted = fit(calibration, model, estimator, uncertainty=uncertainty, progress=progress)
    rows = own_rows(fitted, uncertainty)
    result = document(fitted, rows)
    settings = {**result.settings, "time_s": time.perf_counter() - begin}
    if posterior is not None:
        from vibrident.uncertainty.posterior import sample_posterior

        scale = _data_scale(fitted.estimate, rows[0])
        settings["posterior"] = sample_posterior(fitted.evidence, fitted.estimate, scale, posterior)
    return replace(result, settings=settings)


def fit(
    calibration: Calibration,
    model: str | None,
    estimator: str | Estimator,
    *,
    uncertainty: Uncertainty,
    progress: Progress,
) -> Fitted:
    """Estimate and judge; arguments and errors as :func:`identify`."""
    sensor_model = model_of(calibration, model)
    evidence = Evidence.gather(calibration, sensor_model)
    chosen, reason = _estimator(evidence, estimator, uncertainty)
    estimate, judgement = fitted_and_judged(evidence, chosen, progress)
    found = without_dead_records(evidence, judgement, chosen, progress)
    evidence, estimate, judgement = found or (evidence, estimate, judgement)
    evidence, estimate, judgement = with_phase_scatter(evidence, chosen, (estimate, judgement), progress)
    predicted = _beside_slow_motion(evidence, estimate, judgement, chosen, progress) or judgement.predicted
    records, drifts = without_drift(evidence.records, predicted, calibration.response_unit)
    if any(kept is not record for kept, record in zip(records, evidence.records, strict=True)):
        evidence = evidence.with_records(records)
        estimate, judgement = fitted_and_judged(evidence, chosen, progress)
    known = estimate.findings.hum_hz
    hum_seen = estimate.tones is not None or (any(known) and known != _slow(evidence))
    if evidence.records and sensor_model.is_linear and (hum_seen or not judgement.adequacy.adequate):
        found = _without_hum(evidence, estimate, judgement, chosen, progress)
        evidence, estimate, judgement = found or (evidence, estimate, judgement)
    judgement = with_remedy(evidence, estimate, judgement, chosen, progress)
    linear = linearised(evidence, estimate, judgement)
    return Fitted(evidence, estimate, judgement, linear, chosen, reason, () if judgement.remedied else tuple(drifts))


def _beside_slow_motion(
    evidence: Evidence, estimate: Estimate, judgement: Judgement, chosen: Estimator, progress: Progress
) -> Sequence[FloatArray] | None:
    """What a fit beside slow motion of every record's zero predicts, where that alone explains the data.

    A sensor whose own free motion is as slow takes a drift for that, and its residual does not show it.
    """
    values = estimate.coordinates.values(estimate.z)
    slowest = min((value for name, value in values.items() if name.endswith("frequency")), default=np.inf)
    slow = any(slowest * record.duration_s < AS_SLOW for record in evidence.records)
    if judgement.adequacy.adequate or not slow or not evidence.model.is_linear:
        return None
    beside = evidence.with_records(tuple(beside_slow_motion(record) for record in evidence.records))
    _, again = fitted_and_judged(beside, chosen, progress)
    return again.predicted if again.adequacy.adequate else None


def _slow(evidence: Evidence) -> Tones:
    return tuple(slow_tones(record) for record in evidence.records)


def _without_hum(
    evidence: Evidence, estimate: Estimate, judgement: Judgement, chosen: Estimator, progress: Progress
) -> tuple[Evidence, Estimate, Judgement] | None:
    """The fit with hum as unknowns of every record, where that explains the data.

    What initial states and parameters took of it is in all lines, so that only a fit beside it tells its frequency.
    """
    slow = _slow(evidence)
    plain = _without_knowing_hum(evidence, estimate)
    if (
        plain is not None and hum_tones(evidence.records, plain, slow) == slow
    ):  # what the start values left may be no hum
        values = estimate.coordinates.values(estimate.z)
        again = fitted_and_judged(replace(evidence, start=values), chosen, progress)
        if again[1].adequacy.adequate:
            return evidence, *again
    best, known = None, slow
    for number in range(HUM_ROUNDS):
        tones = hum_tones(evidence.records, judgement.predicted, known)
        # The first fit beside hum is of records from which what the fit before took for hum was removed.
        if tones == slow or (number > 1 and _alike(tones, known, evidence.records)):
            break
        known = tones
        cleaned = evidence.with_records(without_tones(evidence.records, judgement.predicted, tones))
        estimate, judgement = fitted_and_judged(cleaned, chosen, progress)
        if not judgement.adequacy.adequate:
            break
        best = cleaned, estimate, judgement
    return best


def _without_knowing_hum(evidence: Evidence, estimate: Estimate) -> tuple[FloatArray, ...] | None:
    """Prediction of records with hum in them, where the estimate was made beside it; None where it was not.

    What initial states can imitate is left to them: it is no hum.
    """
    problem = estimate.problem
    if problem is None or all(record.hum_hz == slow_tones(record) for record in problem.records):
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


def _data_scale(estimate: Estimate, data: BudgetRow) -> float:
    """Factor on the data's standard deviations that the stated covariance carries: scatter, or the Birge ratio."""
    part, whole = (float(np.trace(c)) for c in (estimate.covariance, data.covariance))
    return float(np.sqrt(whole / part)) if part > 0.0 else 1.0


def _estimator(evidence: Evidence, asked: str | Estimator, scope: Uncertainty) -> tuple[Estimator, str]:
    if not isinstance(asked, str):
        return asked, "chosen by the user"
    chosen, reason = choose(evidence) if asked == AUTO else (ESTIMATORS[asked], "chosen by the user")
    return (chosen.for_noise_alone() if scope == "noise" else chosen), reason
