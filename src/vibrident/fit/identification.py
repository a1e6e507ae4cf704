"""The main path: calibration → evidence → estimate → uncertainty → result."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from vibrident.data.records import Calibration
from vibrident.fit.decay import decays_alone, with_free_decays
from vibrident.fit.estimators import AUTO, Estimate, Estimator, choose
from vibrident.fit.judge.attempts import DepartureReport, Fitted
from vibrident.fit.judge.between_samples import fit_between_samples
from vibrident.fit.judge.clocks import at_one_clock
from vibrident.fit.judge.corrections import with_effects_corrected
from vibrident.fit.judge.document import Uncertainty, budget_of, document
from vibrident.fit.judge.reference import with_reference_named
from vibrident.fit.judge.refits import (
    refit_with_departures,
    with_phase_scatter,
    without_dead_records,
)
from vibrident.fit.judge.remedy import with_remedy
from vibrident.fit.optimise import Progress, silent
from vibrident.fit.problem import Evidence
from vibrident.fit.registry import ESTIMATORS
from vibrident.fit.uncertainty.budget import BudgetRow
from vibrident.physics.models import SensorModel, model_of
from vibrident.result import Result

if TYPE_CHECKING:
    from vibrident.fit.uncertainty.posterior import Sampling


def identify_run(
    calibration: Calibration,
    model: str | None,
    estimator: str | Estimator,
    *,
    uncertainty: Uncertainty,
    posterior: Sampling | None,
    progress: Progress,
) -> Result:
    """Identify a sensor from the records of one run at one temperature, or from a table.

    Arguments and errors as of :func:`vibrident.identify`.
    """
    if posterior is not None and decays_alone(calibration):
        from vibrident.fit.decay.estimate import require_plain

        require_plain(estimator, sampled=True)
    begin = time.perf_counter()
    if posterior is not None:
        from vibrident.fit.uncertainty.posterior import sample_posterior, sampler

        sampler()  # before the fit that it would come after
    fitted = fit(calibration, model, estimator, uncertainty=uncertainty, progress=progress)
    rows = budget_of(fitted, uncertainty)
    result = document(fitted, rows)
    settings = {**result.settings, "time_s": time.perf_counter() - begin}
    if posterior is not None:
        scale = _data_scale(fitted.estimate, rows[0])
        settings["posterior"] = sample_posterior(
            fitted.evidence, fitted.estimate, fitted.linear, scale, posterior
        )
    return replace(result, settings=settings)


def fit(
    calibration: Calibration,
    model: str | None,
    estimator: str | Estimator,
    *,
    uncertainty: Uncertainty,
    progress: Progress,
) -> Fitted:
    """Estimate and judge; arguments and errors are those of :func:`identify_run`."""
    sensor_model = model_of(calibration, model)
    if decays_alone(calibration):
        from vibrident.fit.decay import estimate as decays  # only where there are decays

        decays.require_plain(estimator)
        evidence = decays.gathered(calibration, sensor_model)
        chosen = decays.FreeDecays()
        reason = decays.METHOD
        fitted = Fitted.from_evidence(evidence, chosen, progress)
        fitted = replace(
            fitted,
            reports=(DepartureReport(warnings=tuple(decays.decay_warnings(fitted.estimate))),),
        )
    else:
        fitted = _fit_model(calibration, sensor_model, estimator, uncertainty, progress)
        return with_reference_named(with_remedy(fitted))
    return replace(fitted, reason=reason)


def _fit_model(
    calibration: Calibration,
    model: SensorModel,
    estimator: str | Estimator,
    uncertainty: Uncertainty,
    progress: Progress,
) -> Fitted:
    """Estimate a model by records or a table, beside the departures that the data show."""
    evidence = with_free_decays(Evidence.gather(calibration, model))
    chosen, reason = _estimator(evidence, estimator, uncertainty)
    if model.is_linear and calibration.records:
        fitted = fit_between_samples(evidence, chosen, estimator, progress)
        reason = fitted.reason or reason
    else:
        fitted = Fitted.from_evidence(evidence, chosen, progress)
    return _refitted(replace(fitted, reason=reason))


def fit_near(
    calibration: Calibration,
    model: SensorModel,
    estimator: Estimator,
    start: Mapping[str, float],
) -> Fitted:
    """Estimate and judge from values by name that are nearly right; no remedy is looked for.

    Raises:
        InputError: the data cannot be used.
        NotConverged: the start leads to no finite fit.
    """
    evidence = replace(Evidence.gather(calibration, model), start=dict(start))
    return _refitted(Fitted.from_evidence(evidence, estimator, silent))


def _refitted(fitted: Fitted) -> Fitted:
    """Return the fit of corrected records at one clock, without dead ones, beside departures."""
    steps = (
        with_effects_corrected,
        at_one_clock,
        without_dead_records,
        with_phase_scatter,
        refit_with_departures,
    )
    for step in steps:
        fitted = step(fitted)
    return fitted


def _data_scale(estimate: Estimate, data: BudgetRow) -> float:
    """Return the factor on the data's standard deviations that the stated covariance carries.

    It is the scatter, or the Birge ratio.
    """
    by_estimate, stated = (
        float(np.trace(covariance)) for covariance in (estimate.covariance, data.covariance)
    )
    return float(np.sqrt(stated / by_estimate)) if by_estimate > 0.0 else 1.0


def _estimator(
    evidence: Evidence, estimator: str | Estimator, scope: Uncertainty
) -> tuple[Estimator, str]:
    """Return the estimator asked for or the one that suits, and the reason.

    ``scope``: what the uncertainty covers.
    """
    if not isinstance(estimator, str):
        return estimator, "chosen by the user"
    chosen, reason = (
        choose(evidence) if estimator == AUTO else (ESTIMATORS[estimator], "chosen by the user")
    )
    return (chosen.for_noise_alone() if scope == "noise" else chosen), reason
