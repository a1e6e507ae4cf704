"""The main path: calibration → evidence → estimate → uncertainty → result."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from vibrident.data.records import Calibration
from vibrident.data.screening.held import is_held_drive
from vibrident.fit.decay import decays_alone, with_free_decays
from vibrident.fit.estimators import AUTO, Estimate, Estimator, choose
from vibrident.fit.estimators.kinds.ipnn import Ipnn
from vibrident.fit.judge.attempts import Fitted, Told
from vibrident.fit.judge.clocks import at_one_clock
from vibrident.fit.judge.document import Uncertainty, document, own_rows
from vibrident.fit.judge.refits import beside_departures, with_phase_scatter, without_dead_records
from vibrident.fit.judge.remedy import with_remedy
from vibrident.fit.judge.stairs import fit_stairs
from vibrident.fit.optimise import Progress
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
    rows = own_rows(fitted, uncertainty)
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
    """Estimate and judge; arguments and errors as :func:`identify_run`."""
    sensor_model = model_of(calibration, model)
    if decays_alone(calibration):
        from vibrident.fit.decay import estimate as decays  # only where there are decays

        decays.require_plain(estimator)
        evidence, chosen, reason = (
            decays.gathered(calibration, sensor_model),
            decays.FreeDecays(),
            decays.METHOD,
        )
        found = Fitted.of(evidence, chosen, progress)
        found = replace(found, told=(Told(warnings=tuple(decays.decay_warnings(found.estimate))),))
    else:

        def fit_anew(other: SensorModel) -> Fitted:
            return _fit_model(calibration, other, estimator, uncertainty, progress)

        fitted = _fit_model(calibration, sensor_model, estimator, uncertainty, progress)
        return with_remedy(fitted, fit_anew)
    return replace(found, reason=reason)


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
    if calibration.quantity == "drive" and model.is_linear and calibration.records:
        fitted = _fit_drive(evidence, chosen, _stairs(estimator), progress)
        reason = fitted.reason or reason
    else:
        fitted = Fitted.of(evidence, chosen, progress)
    fitted = replace(fitted, reason=reason)
    for step in (at_one_clock, without_dead_records, with_phase_scatter, beside_departures):
        fitted = step(fitted)
    return fitted


def _stairs(asked: str | Estimator) -> Ipnn | None:
    """Return the network of a held drive; None where another was asked for."""
    if asked == AUTO:
        return Ipnn(discretisation="zoh")
    return asked if isinstance(asked, Ipnn) and asked.discretisation == "zoh" else None


def _fit_drive(
    evidence: Evidence, chosen: Estimator, stairs: Ipnn | None, progress: Progress
) -> Fitted:
    """Estimate a model by a commanded drive, held from sample to sample where that explains it."""
    if stairs is None:
        return Fitted.of(evidence, chosen, progress)
    if not is_held_drive(evidence.calibration):
        plain = Fitted.of(evidence, chosen, progress)
        if plain.adequate:
            return plain
        held = fit_stairs(Fitted.of(evidence, stairs, progress))
        return held if held.adequate else plain
    held = fit_stairs(Fitted.of(evidence, stairs, progress))
    if held.adequate or chosen is stairs:
        return held
    plain = Fitted.of(evidence, chosen, progress)
    return held if held.chi2 < plain.chi2 else plain


def _data_scale(estimate: Estimate, data: BudgetRow) -> float:
    """Factor on the data's standard deviations that the stated covariance carries: scatter, or the Birge ratio."""
    part, whole = (float(np.trace(c)) for c in (estimate.covariance, data.covariance))
    return float(np.sqrt(whole / part)) if part > 0.0 else 1.0


def _estimator(
    evidence: Evidence, asked: str | Estimator, scope: Uncertainty
) -> tuple[Estimator, str]:
    if not isinstance(asked, str):
        return asked, "chosen by the user"
    chosen, reason = (
        choose(evidence) if asked == AUTO else (ESTIMATORS[asked], "chosen by the user")
    )
    return (chosen.for_noise_alone() if scope == "noise" else chosen), reason
