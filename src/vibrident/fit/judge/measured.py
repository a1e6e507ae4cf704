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

    They are per the sensor's own quantity, whatever the reference measured. The uncertainty of a
    point includes systematic effects, which are common to all points; that of its deviation
    includes only what the parameters cannot follow of them.
    """
    points = fitted.judgement.adequacy
    linear = fitted.linear
    order = np.argsort(points.frequency_hz, kind="stable")
    frequency = points.frequency_hz[order]
    measured = points.measured[order]
    noise = points.relative_deviation[order]
    phase_noise = noise if points.phase_deviation is None else points.phase_deviation[order]
    shape = patterns(fitted.effects, linear, points.frequency_hz)
    gain, phase = (
        np.sqrt(np.sum(values**2, axis=1))[order] for values in (np.real(shape), np.imag(shape))
    )
    deviation_u = deviation_uncertainty(linear, shape, fitted.judgement.scatter or 1.0)
    deviation_u = [
        values[order] for values in np.split(deviation_u, 2 if linear.is_phase.any() else 1)
    ]
    ratio = fitted.response(frequency) / measured
    has_phase = bool(np.any(np.imag(measured) != 0.0))
    quantity = fitted.evidence.quantity
    stated_per = fitted.evidence.model.stated_quantity(quantity)
    measured = measured * conversion(frequency, quantity, stated_per)
    magnitude = np.abs(measured)

    def known_u(uncertainty: FloatArray, noise: FloatArray) -> FloatArray:
        """Return the uncertainty, NaN where the data do not determine it."""
        return np.where(
            np.isfinite(uncertainty) & (noise < MAX_RELATIVE_UNCERTAINTY), uncertainty, np.nan
        )

    def angle(radians: FloatArray) -> FloatArray:
        return np.rad2deg(radians) if has_phase else np.full(len(order), np.nan)

    return MeasuredCurve(
        frequency_hz=frequency,
        magnitude=magnitude,
        phase_deg=angle(np.angle(measured)),
        magnitude_uncertainty=known_u(magnitude * np.hypot(noise, gain), noise),
        phase_deg_uncertainty=known_u(angle(np.hypot(phase_noise, phase)), phase_noise),
        deviation_percent=100.0 * (np.abs(ratio) - 1.0),
        deviation_phase_deg=angle(np.angle(ratio)),
        record=tuple(points.record[i] for i in order),
        magnitude_noise=known_u(magnitude * noise, noise),
        phase_deg_noise=known_u(angle(phase_noise), phase_noise),
        deviation_uncertainty_percent=known_u(100.0 * deviation_u[0], noise),
        deviation_phase_uncertainty_deg=known_u(angle(deviation_u[-1]), phase_noise),
    )


def sums_of_signals(fitted: Fitted) -> FloatArray:
    """Return n, Σ |e|, Σ e² of measured minus predicted response, and Σ y² about its mean, (4,)."""
    sums = np.zeros(4)
    for record, series in zip(fitted.evidence.records, fitted.judgement.predicted, strict=True):
        used = record.mask & np.isfinite(series)
        response = record.response[used]
        sums += _sums(
            response - series[used], response - response.mean() if used.any() else response
        )
    return sums


def sums_of_table(fitted: Fitted) -> FloatArray:
    """Return sums as those of :func:`sums_of_signals` over a table's points, shape (4,)."""
    adequacy = fitted.judgement.adequacy
    problem = fitted.evidence.first_look
    assert problem is not None
    measured = adequacy.measured
    model = fitted.response(adequacy.frequency_hz)
    residual = measured - model if problem.has_phase else np.abs(measured) - np.abs(model)
    return _sums(np.abs(residual), np.abs(measured - measured.mean()))


def _sums(residual: FloatArray, response: FloatArray) -> FloatArray:
    """Return n, Σ |residual| and the sums of squares of residual and response, shape (4,).

    ``response``: about its mean.
    """
    return np.array(
        [residual.size, np.sum(np.abs(residual)), residual @ residual, response @ response]
    )


def metrics(sums: FloatArray, fitted: Fitted) -> Fit:
    """Return the metrics of a fit from sums as those of :func:`sums_of_signals`."""
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
