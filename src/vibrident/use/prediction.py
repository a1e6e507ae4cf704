"""Predict the response of records that were not fitted, and compare it with the measured one.

The network runs with the result's parameters, discretisation and learned residual, if there is one.
Initial state and offset belong to a record: they are fitted to its response, which leaves n − 3
degrees of freedom of n samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vibrident.base.brief import brief
from vibrident.base.errors import InputError
from vibrident.base.fields import Fields
from vibrident.base.memory import in_one_thread
from vibrident.data.io import GivenCalibration, as_calibration
from vibrident.data.records import MOTIONS, BoolArray, Calibration, FloatArray, Record, is_motion
from vibrident.data.screening import ScreeningFinding, screen
from vibrident.fit.problem import Coordinates, network_of
from vibrident.fit.response.deconvolution import chain_of, deconvolved
from vibrident.physics.discretisation import method
from vibrident.result import Result
from vibrident.result.loading import GivenResult, as_result

UNBOUNDED_HZ = (1e-9, 1e12)  # coordinates bound a search by a band; here nothing is searched


@dataclass(frozen=True, eq=False)
class Prediction:
    """A record with its predicted response."""

    record: Record  # as screened: clipped samples are marked invalid
    # shape (samples,), response unit; NaN where it cannot be made (at the ends, the band-limited
    # interpolation of the reference lacks neighbours)
    predicted: FloatArray

    __repr__ = brief

    @property
    def compared(self) -> BoolArray:
        """Return the samples with a valid measured and a predicted response, shape (samples,)."""
        return self.record.mask & np.isfinite(self.predicted)

    @property
    def residual(self) -> FloatArray:
        """Return the measured minus the predicted response at the samples compared."""
        return self.record.response[self.compared] - self.predicted[self.compared]

    @property
    def rmse(self) -> float | None:
        """Return the rms of the residual, response unit, or None if nothing can be compared."""
        return root_mean_square(self.residual)

    @property
    def nrmse(self) -> float | None:
        """Return ``rmse`` over the standard deviation of the measured response, or None."""
        if self.rmse is None:
            return None
        deviation = float(np.std(self.record.response[self.compared]))
        return self.rmse / deviation if deviation else None


@dataclass(frozen=True, eq=False)
class Predictions:
    """Predictions for a calibration's records."""

    predictions: tuple[Prediction, ...]  # one a record, in order, without those left out
    findings: tuple[ScreeningFinding, ...]  # of the data; they name records that are left out
    discretisation: str  # of the network

    __repr__ = brief

    @property
    def rmse(self) -> float | None:
        """Return the rms of the residuals of all records together."""
        return root_mean_square(np.concatenate([p.residual for p in self.predictions]))


@in_one_thread
def predict(result: GivenResult, calibration: GivenCalibration) -> Predictions:
    """Predict the response of a calibration's records.

    Args:
        result: of an identification, or the path of its ``result.json``; its model, estimated
            parameters and learned residual are used.
        calibration: records of the same kind of sensor, or the path of a calibration file, whose
            model is not used.

    Raises:
        InputError: the calibration is a table, its units are not the result's, or its records
            cannot be used.

    Examples:
        >>> import vibrident
        >>> hz = [100, 300, 650, 1000]
        >>> calibration = vibrident.simulate(frequencies_hz=hz, samples=2000, response_noise=1e-3)
        >>> result = vibrident.identify(calibration)
        >>> sweep = vibrident.simulate("paper", "sweep", samples=4000, response_noise=1e-3, seed=2)
        >>> prediction = vibrident.predict(result, sweep).predictions[0]
        >>> f"{prediction.nrmse:.1%} of the response"
        '0.1% of the response'
    """
    result = as_result(result)
    calibration = as_calibration(calibration)
    sensor = result.to_sensor("a prediction")
    model = sensor.model
    values = dict(sensor.values)
    _check_units(result, calibration)
    records, findings = screen(calibration.records, calibration.units)
    if (chain := chain_of(calibration)) is not None:
        records = tuple(deconvolved(record, chain) for record in records)
    name = str(result.settings.get("discretisation") or "bandlimited")
    if result.settings.get("residual_network"):  # which is JAX's
        from vibrident.fit.estimators.residual_network import saved_model

        model, learned = saved_model(model, result.settings)
        values |= learned
    problem = network_of(records, model, method(name), calibration.quantity, values)
    coordinates = Coordinates.at(model, values, UNBOUNDED_HZ)
    responses = problem.predict(coordinates, coordinates.first)
    predictions = tuple(map(Prediction, records, responses))
    return Predictions(predictions, findings, name)


def root_mean_square(values: FloatArray) -> float | None:
    """Return √mean(v²), or None for no values."""
    return float(np.sqrt(np.mean(values**2))) if values.size else None


def prediction_document(predictions: Predictions, files: Sequence[str], unit: str) -> Fields:
    """Return the plain values of ``prediction.json``.

    Args:
        predictions: of :func:`predict`.
        files: name of each prediction's file.
        unit: of the response.
    """
    rows = [
        {
            "name": p.record.name,
            "file": file,
            "rmse": p.rmse,
            "nrmse": p.nrmse,
            "samples": p.record.samples,
            "samples_compared": int(np.sum(p.compared)),
            "samples_without_prediction": int(np.sum(~np.isfinite(p.predicted))),
        }
        for p, file in zip(predictions.predictions, files, strict=True)
    ]
    return {
        "records": rows,
        "rmse": predictions.rmse,
        "unit": unit,
        "discretisation": predictions.discretisation,
        "fitted_per_record": ["initial state", "offset"],
        "findings": [{"code": f.code, "message": f.message} for f in predictions.findings],
    }


def _check_units(result: Result, calibration: Calibration) -> None:
    calibration.require_response(
        result.response_unit, "A table has no motion to predict a response to."
    )
    expected = result.quantity
    quantities = (calibration.quantity, expected)
    if calibration.quantity != expected and not all(map(is_motion, quantities)):
        raise InputError(
            "The reference is of another kind than the result's.",
            expected=" | ".join(MOTIONS) if is_motion(expected) else f'quantity = "{expected}"',
            found=f'quantity = "{calibration.quantity}"',
            where=f"{calibration.source or 'calibration in memory'}, [reference]",
            remedy="predict with a result from the same kind of reference",
        )
