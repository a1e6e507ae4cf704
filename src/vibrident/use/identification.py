"""Identify a sensor: from a calibration or its file to a result."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from vibrident.base.errors import InputError
from vibrident.base.memory import in_one_thread
from vibrident.base.participants import watching
from vibrident.data.io import GivenCalibration, as_calibration
from vibrident.data.io.long_records import LongRecords, long_records_in, long_records_of
from vibrident.data.records import Calibration
from vibrident.fit.estimators import AUTO, Estimator
from vibrident.fit.identification import fit, identify_run
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.judge.document import Uncertainty
from vibrident.fit.optimise import Progress, silent
from vibrident.physics.models import GivenModel, named
from vibrident.result import Result
from vibrident.use.regimes import with_regimes
from vibrident.use.repeats import group_by_run, identify_runs
from vibrident.use.stretches.identification import FitChoices, Sharing, identify_long
from vibrident.use.temperature import group_by_temperature, identify_temperatures

if TYPE_CHECKING:
    from vibrident.fit.uncertainty.posterior import Sampling


@in_one_thread
@watching()
def identify(
    calibration: GivenCalibration | LongRecords,
    model: GivenModel | None = None,
    estimator: str | Estimator = AUTO,
    *,
    band_hz: tuple[float, float] | None = None,
    uncertainty: Uncertainty = "auto",
    posterior: Sampling | None = None,
    scheduler: str | None = None,
    work: str | os.PathLike[str] | None = None,
    progress: Progress = silent,
) -> Result:
    """Identify a sensor from its calibration.

    Args:
        calibration: from :func:`vibrident.read`, :func:`vibrident.simulate` or made by hand; or the
            path of a calibration file.
        model: name of the sensor model, or a :class:`vibrident.Model`, alone or with add-ons
            (``model + "delay"``); None takes the calibration's.
        estimator: ``auto``, a name, or an estimator object with settings of its own, such as
            ``Ipnn(discretisation="euler", optimiser="adam")``.
        band_hz: lowest and highest frequency that the fit takes, Hz; None: those that the
            calibration states, or all. Free decays are taken whole.
        uncertainty: what the uncertainties cover. ``noise``: the noise, or the stated uncertainty,
            of the data alone. ``inflated``: where the deviations from the model are larger than
            that, the misfit too: sine records under ``ml`` get a relative model error, all else is
            scaled by √(χ²/dof) (Birge ratio). ``auto``: ``inflated`` for records whose model is
            rejected (with the warning ``lack_of_fit``), ``noise`` otherwise; the stated
            uncertainties of a table are never scaled unasked.
        posterior: settings for sampling the parameters' posterior distribution, which
            ``settings.posterior`` then sums up; of a linear model, with the extra ``bayes``. None:
            not sampled.
        scheduler: ``local``, or address or file of a running Dask scheduler, whose workers share
            the stretches of long records (extra ``cluster``); None: this process fits them.
        work: folder that keeps what is fitted of long records; the same call continues there after
            an interruption.
        progress: called after each iteration of the optimiser.

    Records of several runs (``run``, ``mounting``) are identified run by run, and the scatter of
    these is in the uncertainty; records at several temperatures (``temperature_c``) temperature by
    temperature, with the coefficients. Random and multisine records of more than 1,048,576 samples
    together are fitted a stretch at a time, which bounds memory; the numbers do not depend on who
    fits the stretches.

    Returns:
        The result; its warnings are empty for a clean calibration of an adequate model.

    Raises:
        InputError: the data cannot be used.
        ModelError: model, estimator and data do not fit together.
        NotConverged: no start leads to a finite fit.

    Examples:
        >>> import vibrident
        >>> hz = [100, 300, 650, 1000]
        >>> calibration = vibrident.simulate(frequencies_hz=hz, samples=2000, response_noise=1e-3)
        >>> result = vibrident.identify(calibration, model="accelerometer")
        >>> sensitivity = result.parameters["sensitivity"]
        >>> print(f"{sensitivity.value:.4f} {sensitivity.unit}")
        0.1040 V/(m/s^2)
        >>> result.fit.adequate
        True
    """
    name = named(model)
    long_records = None if posterior is not None else _long_records(calibration)
    if long_records is not None:
        choices = FitChoices(name, estimator, band_hz, uncertainty, progress)
        result = identify_long(long_records, choices, Sharing(scheduler, work))
        if result is not None:
            return result
        calibration = long_records
    if isinstance(calibration, LongRecords):
        calibration = calibration.in_memory()
    calibration = as_calibration(calibration).within(band_hz)
    temperatures = group_by_temperature(calibration)
    runs = group_by_run(calibration)
    if posterior is not None and (temperatures or len(runs) > 1):
        raise _several_runs_error(calibration, len(runs), max(len(temperatures), 1))
    if temperatures:
        return identify_temperatures(
            temperatures,
            lambda group: identify(
                group, name, estimator, uncertainty=uncertainty, progress=progress
            ),
        )

    def fit_group(group: Calibration) -> Fitted:
        return fit(group, name, estimator, uncertainty=uncertainty, progress=progress)

    if len(runs) > 1:
        return identify_runs(runs, fit_group, uncertainty)
    result = identify_run(
        calibration,
        name,
        estimator,
        uncertainty=uncertainty,
        posterior=posterior,
        progress=progress,
    )
    if posterior is not None:
        return result
    return with_regimes(calibration, name, result, fit_group, uncertainty)


def _long_records(calibration: GivenCalibration | LongRecords) -> LongRecords | None:
    """Return records that are to be fitted a stretch at a time, or None."""
    if isinstance(calibration, LongRecords):
        return calibration
    if isinstance(calibration, Calibration):
        return long_records_in(calibration)
    return long_records_of(calibration)


def _several_runs_error(calibration: Calibration, runs: int, temperatures: int) -> InputError:
    """Return the error of a posterior of several runs or temperatures."""
    return InputError(
        "The posterior is sampled for one run at one temperature.",
        expected="records without run, mounting and temperature_c, or of one each",
        found=f"{runs} runs, {temperatures} temperatures",
        where=calibration.source or "calibration in memory",
        remedy="leave the posterior out, or identify one of them",
    )
