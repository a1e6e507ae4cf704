"""The data beside the fit: its points, and the metrics of measured minus predicted response."""

from __future__ import annotations

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.judge.attempts import Fitted
from vibrident.fit.uncertainty.budget import deviation_uncertainty, patterns
from vibrident.fit.uncertainty.parameters import MAX_RELATIVE_UNCERTAINTY
from vibrident.physics.models.quantities import conversion
from vibrident.result import Fit, MeasuredCurve


def measured_curve(fitted: Fitted) -> MeasuredCurve:
    """Return the data's points with their deviation from the model, in order of frequency.

    They are per the sensor's own quantity, whatever the reference measured.
    Systematic effects, common to all points, are in the uncertainty of each point, but in that of its deviation only as
    far as the parameters cannot follow them.
    """
    points = fitted.judgement.adequacy
    linear = fitted.linear
    order = np.argsort(points.frequency_hz, kind="stable")
    frequency = points.frequency_hz[order]
    measured = points.measured[order]
    noise = points.relative_deviation[order]
    turn = noise if points.phase_deviation is None else points.phase_deviation[order]
    shape = patterns(fitted.effects, linear, points.frequency_hz)
    gain, phase = (
        np.sqrt(np.sum(part**2, axis=1))[order] for part in (np.real(shape), np.imag(shape))
    )
    off = deviation_uncertainty(linear, shape, fitted.judgement.scatter or 1.0)
    off = [part[order] for part in np.split(off, 2 if linear.is_phase.any() else 1)]
    ratio = _model_at(fitted, frequency) / measured
    has_phase = bool(np.any(np.imag(measured) != 0.0))
    quantity = fitted.evidence.quantity
    stated_per = fitted.evidence.model.stated_quantity(quantity)
    measured = measured * conversion(frequency, quantity, stated_per)
    size = np.abs(measured)

    def stated(uncertainty: FloatArray, noise: FloatArray) -> FloatArray:
        """NaN where nothing tells it."""
        return np.where(
            np.isfinite(uncertainty) & (noise < MAX_RELATIVE_UNCERTAINTY), uncertainty, np.nan
        )

    def angle(radians: FloatArray) -> FloatArray:
        return np.rad2deg(radians) if has_phase else np.full(len(order), np.nan)

    return MeasuredCurve(
        frequency_hz=frequency,
        magnitude=size,
        phase_deg=angle(np.angle(measured)),
        magnitude_uncertainty=stated(size * np.hypot(noise, gain), noise),
        phase_deg_uncertainty=stated(angle(np.hypot(turn, phase)), turn),
        deviation_percent=100.0 * (np.abs(ratio) - 1.0),
        deviation_phase_deg=angle(np.angle(ratio)),
        record=tuple(points.record[i] for i in order),
        magnitude_noise=stated(size * noise, noise),
        phase_deg_noise=stated(angle(turn), turn),
        deviation_uncertainty_percent=stated(100.0 * off[0], noise),
        deviation_phase_uncertainty_deg=stated(angle(off[-1]), turn),
    )


def _model_at(fitted: Fitted, frequency_hz: FloatArray) -> np.ndarray:
    """Complex sensitivity of the model, shape (n,)."""
    return fitted.evidence.model.frequency_response(
        fitted.values, frequency_hz, fitted.evidence.quantity
    )


def fit_of_signals(fitted: Fitted) -> Fit:
    """Metrics of measured minus predicted response over all records."""
    sums = np.zeros(4)
    for record, series in zip(fitted.evidence.records, fitted.judgement.predicted, strict=True):
        used = record.mask & np.isfinite(series)
        response = record.response[used]
        sums += _sums(
            response - series[used], response - response.mean() if used.any() else response
        )
    return _metrics(sums, fitted)


def fit_of_table(fitted: Fitted) -> Fit:
    """Metrics of measured minus model response over a table's points."""
    adequacy = fitted.judgement.adequacy
    problem = fitted.evidence.first_look
    assert problem is not None
    measured = adequacy.measured
    model = _model_at(fitted, adequacy.frequency_hz)
    residual = measured - model if problem.has_phase else np.abs(measured) - np.abs(model)
    return _metrics(_sums(np.abs(residual), np.abs(measured - measured.mean())), fitted)


def _sums(residual: FloatArray, response: FloatArray) -> FloatArray:
    """Number of points, Σ |residual|, and the squares of residual and response about its mean."""
    return np.array(
        [residual.size, np.sum(np.abs(residual)), residual @ residual, response @ response]
    )


def _metrics(sums: FloatArray, fitted: Fitted) -> Fit:
    adequacy = fitted.judgement.adequacy
    shares = fitted.judgement.shares
    mae, mse, variance = (sums[1:] / (sums[0] or float("nan"))).tolist()
    rmse = float(np.sqrt(mse))
    ratio = rmse / np.sqrt(variance) if variance > 0 else float("nan")
    return Fit(
        rmse=rmse,
        mae=mae,
        mse=mse,
        r2=float(1.0 - ratio**2),
        rpd=float(1.0 / ratio) if ratio > 0 else float("inf"),
        nrmse=float(ratio),
        chi2_reduced=adequacy.chi2_reduced,
        degrees_of_freedom=adequacy.degrees_of_freedom,
        adequate=adequacy.adequate,
        explained=shares.explained,
        coherent=shares.coherent,
    )
