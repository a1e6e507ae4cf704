"""Cross-validation: prediction of measurements that a model was not fitted to.

The records (or the rows of a table) are split into folds; each fold is predicted by the model
fitted to the others (Stone 1974). A model with too little physics predicts badly, and so does one
with more parameters than the data carry.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vibrident.base.errors import VibridentError
from vibrident.base.memory import in_one_thread
from vibrident.data.records import BoolArray, Calibration, FloatArray
from vibrident.fit.estimators import AUTO, Estimator
from vibrident.fit.optimise import Progress, silent
from vibrident.fit.response.response import ComplexArray
from vibrident.physics.models import parse
from vibrident.result import MeasuredCurve, Result
from vibrident.use.identification import identify

FOLDS = 5
MIN_FOLDED = 4  # records or rows that are split into folds


@dataclass(frozen=True)
class CrossValidation:
    """Deviations of a cross-validation."""

    deviation_percent: float  # rms of |model/measured − 1| at the points left out, %
    # the same in standard uncertainties of the measurement, about 1 for a right model; None if they
    # are not known
    deviation_in_u: float | None
    folds: int  # number of fits


@in_one_thread
def cross_validate(
    calibration: Calibration,
    result: Result,
    estimator: str | Estimator = AUTO,
    *,
    folds: int = FOLDS,
    progress: Progress = silent,
) -> CrossValidation | None:
    """Fit the result's model to all but one fold in turn, and predict the fold left out.

    Args:
        calibration: of which the result is.
        result: of all data; its measured points are predicted.
        estimator: as for :func:`vibrident.identify`.
        folds: largest number of fits.
        progress: called after each iteration of the optimiser.

    Returns:
        The score; None if there are too few records or rows, or a fold cannot be fitted.
    """
    owners = _index_of_points(calibration, result.measured)
    count = calibration.table.points if calibration.table is not None else len(calibration.records)
    dealt = min(folds, count)
    if count < MIN_FOLDED:
        return None
    turn: ComplexArray = np.exp(1j * np.deg2rad(np.nan_to_num(result.measured.phase_deg)))
    measured = result.measured.magnitude * turn
    predicted = np.full(len(measured), np.nan, dtype=complex)
    frequency = result.measured.frequency_hz
    model = parse(result.model)
    for fold in range(dealt):
        out = np.arange(count) % dealt == fold
        try:
            training_part = identify(
                _subset(calibration, ~out), result.model, estimator, progress=progress
            )
        except VibridentError:
            return None
        values = {name: training_part.parameters[name].value for name in model.parameter_names}
        test_rows = out[owners]
        predicted[test_rows] = model.frequency_response(
            values, frequency[test_rows], calibration.quantity
        )
    has_phase = bool(np.isfinite(result.measured.phase_deg[0]))
    off = (
        np.abs(predicted / measured - 1.0)
        if has_phase
        else np.abs(np.abs(predicted) / np.abs(measured) - 1.0)
    )
    percent = 100.0 * float(np.sqrt(np.mean(off**2)))
    return CrossValidation(percent, _rms_in_u(off, result.measured, has_phase), dealt)


def _index_of_points(calibration: Calibration, measured: MeasuredCurve) -> np.ndarray:
    """Return the index of the record, or row, that each measured point belongs to."""
    if calibration.table is not None:
        return np.argsort(calibration.table.frequency_hz, kind="stable")
    index = {record.name: i for i, record in enumerate(calibration.records)}
    return np.array([index[name] for name in measured.record])


def _subset(calibration: Calibration, keep: BoolArray) -> Calibration:
    if calibration.table is not None:
        columns = {
            name: values[keep]
            for name, values in vars(calibration.table).items()
            if isinstance(values, np.ndarray)
        }
        return replace(calibration, table=replace(calibration.table, **columns))
    return replace(
        calibration,
        records=tuple(r for r, is_kept in zip(calibration.records, keep, strict=True) if is_kept),
    )


def _rms_in_u(off: FloatArray, measured: MeasuredCurve, has_phase: bool) -> float | None:
    if np.isnan(measured.magnitude_uncertainty).any():
        return None
    relative = measured.magnitude_uncertainty / measured.magnitude
    quantities = 2.0 if has_phase else 1.0
    return float(np.sqrt(np.mean((off / relative) ** 2) / quantities))
