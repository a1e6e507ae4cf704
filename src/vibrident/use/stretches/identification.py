"""Fit long records stretch by stretch, here or by workers, and sum the fits to a result.

Memory is that of one stretch, whatever the length of the records. The first stretch finds start
values; the others begin at its estimate.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vibrident.base.cluster import Cluster
from vibrident.base.errors import InputError, VibridentError
from vibrident.data.io.long_records import LongRecords, RecordsInFiles
from vibrident.data.records import Calibration
from vibrident.fit.estimators import AUTO, Estimator
from vibrident.fit.estimators.kinds.ipnn import Ipnn
from vibrident.fit.identification import fit
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.judge.document import Uncertainty
from vibrident.fit.optimise import Progress, silent
from vibrident.physics.models import model_of
from vibrident.result import Result
from vibrident.use.stretches.pooled import pooled_result
from vibrident.use.stretches.store import EstimateStore
from vibrident.use.stretches.stretch import (
    STRETCH_SAMPLES,
    FitOrder,
    RefusedStretch,
    Stretch,
    StretchFit,
    StretchOutcome,
    cut_into,
    fit_stretch,
)

#: Periods of the slowest motion of the sensor, and of its time constants, that a stretch holds at
#: least: the unknown states at both ends then cost less than 5 % of an uncertainty.
MIN_PERIODS = 20.0
#: Share of the stretches that must be of use.
MIN_USED = 0.5


@dataclass(frozen=True)
class Sharing:
    """Workers of the stretches, and the folder of their fits.

    Attributes:
        scheduler: ``local``, address or file of a Dask scheduler; None: this process.
        work: folder of the fits, from which an interrupted identification continues; None: none.
    """

    scheduler: str | None = None
    work: str | os.PathLike[str] | None = None


@dataclass(frozen=True)
class FitChoices:
    """Model, estimator and settings of a fit, as of :func:`vibrident.identify`.

    Attributes:
        model: name of the sensor model; None: the calibration's.
        estimator: a name, or an estimator.
        band_hz: that the fit takes.
        uncertainty: what the uncertainties cover.
        progress: called after each stretch, and after each iteration of the first.
    """

    model: str | None
    estimator: str | Estimator
    band_hz: tuple[float, float] | None
    uncertainty: Uncertainty
    progress: Progress = silent


def identify_long(records: LongRecords, choices: FitChoices, sharing: Sharing) -> Result | None:
    """Return the result of long records, or None where they are to be fitted as a whole.

    That is so where another estimator is asked for than the network at bins, where the model is not
    linear, and where the sensor is so slow that no stretch holds enough of its motion.

    Raises:
        InputError: the data cannot be used, or the scheduler.
        ModelError: model and data do not fit together.
        NotConverged: no start leads to a finite fit.
    """
    if not _is_network_at_bins(choices.estimator):
        return None
    samples = STRETCH_SAMPLES
    while samples < sum(records.lengths):
        stretches = cut_into(records.lengths, samples)
        first, number = _first_fit(records, stretches, choices)
        if first is None:
            return None
        if _are_long_enough(first, samples):
            return _identify_stretches(records, stretches, (number, first), choices, sharing)
        samples *= 2
    return None


def _is_network_at_bins(estimator: str | Estimator) -> bool:
    """Return whether an estimator is the network at bins."""
    if isinstance(estimator, str):
        return estimator in (AUTO, Ipnn.name)
    return type(estimator) is Ipnn and not estimator.trainer.in_time


def _first_fit(
    records: LongRecords, stretches: Sequence[Stretch], choices: FitChoices
) -> tuple[Fitted | None, int]:
    """Return the fit of the first stretch that can be used, and its number.

    None where the model is not linear.

    Raises:
        VibridentError: the first half of the stretches cannot be used; the error of the first.
    """
    reason: VibridentError | None = None
    for number, stretch in enumerate(stretches[: len(stretches) // 2 + 1]):
        try:
            calibration = records.calibration(stretch).within(choices.band_hz)
            if not model_of(calibration, choices.model).is_linear:
                return None, number
            first = fit(
                calibration,
                choices.model,
                choices.estimator,
                uncertainty=choices.uncertainty,
                progress=choices.progress,
            )
        except VibridentError as error:
            reason = reason or error
            continue
        return first if first.estimate.in_noise is not None else None, number
    assert reason is not None
    raise reason


def _are_long_enough(first: Fitted, samples: int) -> bool:
    """Return whether stretches are long against the slowest motion of the sensor."""
    poles = first.evidence.model.poles(first.values)
    rate_hz = max(record.sampling_rate_hz for record in first.evidence.records)
    if not poles.size:
        return True
    decay = np.maximum(np.abs(poles.real), np.finfo(float).tiny)
    slowest_s = float(np.max(np.maximum(2.0 * np.pi / np.abs(poles), 1.0 / decay)))
    return samples >= MIN_PERIODS * slowest_s * rate_hz


def _identify_stretches(
    records: LongRecords,
    stretches: list[Stretch],
    first: tuple[int, Fitted],
    choices: FitChoices,
    sharing: Sharing,
) -> Result:
    """Return the result of stretches, one of which has been fitted."""
    number, fitted = first
    order = FitOrder(choices.model, fitted.estimator, choices.band_hz, fitted.values)
    store = None
    if sharing.work is not None:
        store = EstimateStore(Path(sharing.work), records.digest(), order, stretches)
    fitted_before: dict[int, StretchOutcome] = {
        number: StretchFit.from_fit(stretches[number], fitted)
    }
    fits: list[StretchOutcome] = []
    for outcome in _fits(records, stretches, fitted_before, order, store, sharing.scheduler):
        fits.append(outcome)
        _report_fitted(choices.progress, len(fits), len(stretches))
    refused = [outcome for outcome in fits if isinstance(outcome, RefusedStretch)]
    if len(fits) - len(refused) < MIN_USED * len(fits):
        raise _unusable_error(refused, len(fits))
    return pooled_result(fitted, fits, choices.uncertainty)


def _report_fitted(progress: Progress, done: int, count: int) -> None:
    """Report how many stretches are fitted; a plain function is called as by an optimiser."""
    share = getattr(progress, "share", None)
    if share is None:
        progress(done, count, float("nan"))
    else:
        share(f"{done} of {count} stretches of the records", done, count)


def _fits(
    records: LongRecords,
    stretches: Sequence[Stretch],
    outcomes: Mapping[int, StretchOutcome],
    order: FitOrder,
    store: EstimateStore | None,
    scheduler: str | None,
) -> Iterator[StretchOutcome]:
    """Yield the fit of each stretch in order; those that are known or kept are not fitted again."""
    if store is not None:
        stored = ((number, store.load(number)) for number in range(len(stretches)))
        outcomes = {number: fit for number, fit in stored if fit is not None} | dict(outcomes)
    missing = [number for number in range(len(stretches)) if number not in outcomes]
    with contextlib.ExitStack() as stack:
        computed: Iterator[StretchOutcome]
        if scheduler is None or not missing:
            computed = (fit_stretch(records, stretches[n], order) for n in missing)
        else:
            cluster = stack.enter_context(
                Cluster(scheduler, f"⟦identify.scheduler = {scheduler!r}⟧")
            )
            calls = ((_stretch_input(records, stretches[n]), stretches[n], order) for n in missing)
            computed = cluster.results(fit_stretch, calls)
        for number in range(len(stretches)):
            if number in outcomes:
                yield outcomes[number]
                continue
            fitted = next(computed)
            if store is not None:
                store.save(number, fitted)
            yield fitted


def _stretch_input(records: LongRecords, stretch: Stretch) -> LongRecords | Calibration:
    """Return what a worker needs for a stretch: where it reads the files, or the samples."""
    return records if isinstance(records, RecordsInFiles) else records.calibration(stretch)


def _unusable_error(refused: Sequence[RefusedStretch], count: int) -> InputError:
    """Return the error of records of which too little can be used."""
    return InputError(
        "Most of the records cannot be used.",
        expected=f"at least {100 * MIN_USED:.0f} % of {count} stretches",
        found=f"{len(refused)} that cannot; the first: {refused[0].reason}",
        where="records",
        remedy="leave these times out with start_s and stop_s",
    )
