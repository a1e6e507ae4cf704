"""The main path: calibration → evidence → estimate → uncertainty → result."""

from __future__ import annotations

import os
import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from vibrident.base.errors import InputError
from vibrident.base.memory import in_one_thread
from vibrident.base.participants import watching
from vibrident.data.records import Calibration
from vibrident.fit.decay import decays_alone, with_free_decays
from vibrident.fit.descent.optimise import Progress, silent
from vibrident.fit.estimators import AUTO, Estimate, Estimator, choose
from vibrident.fit.estimators.kinds.ipnn import Ipnn
from vibrident.fit.judge.attempts import Fitted, Told
from vibrident.fit.judge.clocks import at_one_clock
from vibrident.fit.judge.document import Uncertainty, document, own_rows
from vibrident.fit.judge.refits import beside_departures, with_phase_scatter, without_dead_records
from vibrident.fit.judge.remedy import with_remedy
from vibrident.fit.judge.stairs import fit_stairs
from vibrident.fit.problem import Evidence
from vibrident.fit.registry import ESTIMATORS
from vibrident.fit.repeats import identify_runs, runs_of
from vibrident.fit.screening.held import is_held_drive
from vibrident.fit.temperature import identify_temperatures, temperatures_of
from vibrident.fit.uncertainty.budget import BudgetRow
from vibrident.physics.models import SensorModel, model_of
from vibrident.result import Result

if TYPE_CHECKING:
    from vibrident.fit.uncertainty.posterior import Sampling


@in_one_thread
@watching()
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

    Records of several runs (``run``, ``mounting``) are identified run by run, and the scatter of these is in the
    uncertainty; records at several temperatures (``temperature_c``) temperature by temperature, with the coefficients.

    Returns:
        The result; its warnings are empty for a clean calibration of an adequate model.

    Raises:
        InputError: the data cannot be used.
        ModelError: model, estimator and data do not fit together.
        NotConverged: no start leads to a finite fit.
    """
    if not isinstance(calibration, Calibration):
        from vibrident.data.io import read

        calibration = read(calibration)
    if posterior is not None and decays_alone(calibration):
        from vibrident.fit.decay.estimate import require_plain

        require_plain(estimator, sampled=True)
    groups, runs = temperatures_of(calibration), runs_of(calibration)
    if posterior is not None and (groups or len(runs) > 1):
        raise InputError(
            "The posterior is sampled for one run at one temperature.",
            expected="records without run, mounting and temperature_c, or of one each",
            found=f"{len(runs)} runs, {max(len(groups), 1)} temperatures",
            where=calibration.source or "calibration in memory",
            remedy="leave the posterior out, or identify one of them",
        )
    if groups:
        return identify_temperatures(
            groups, lambda one: identify(one, model, estimator, uncertainty=uncertainty, progress=progress)
        )
    if len(runs) > 1:
        return identify_runs(
            runs, lambda one: fit(one, model, estimator, uncertainty=uncertainty, progress=progress), uncertainty
        )
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
    if decays_alone(calibration):
        from vibrident.fit.decay import estimate as decays  # only where there are decays

        decays.require_plain(estimator)
        evidence, chosen, reason = decays.gathered(calibration, sensor_model), decays.FreeDecays(), decays.METHOD
        found = Fitted.of(evidence, chosen, progress)
        found = replace(found, told=(Told(warnings=tuple(decays.said(found.estimate))),))
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
    if calibration.quantity == "drive" and model.is_linear:
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


def _fit_drive(evidence: Evidence, chosen: Estimator, stairs: Ipnn | None, progress: Progress) -> Fitted:
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


def _estimator(evidence: Evidence, asked: str | Estimator, scope: Uncertainty) -> tuple[Estimator, str]:
    if not isinstance(asked, str):
        return asked, "chosen by the user"
    chosen, reason = choose(evidence) if asked == AUTO else (ESTIMATORS[asked], "chosen by the user")
    return (chosen.for_noise_alone() if scope == "noise" else chosen), reason
