"""The end of a session as a Result: the sensor as it is now, for report, correction, export and history."""

from __future__ import annotations

import datetime
from dataclasses import replace

import numpy as np

from vibrident.base.version import __version__
from vibrident.data.records import FloatArray
from vibrident.physics.models import Derived
from vibrident.result import Correlation, Curve, Fit, MeasuredCurve, Parameter, Result
from vibrident.use.tracking.session import Session

#: The name of the estimator, by which a history knows such an entry.
TRACKED = "tracked"
COVERAGE = 1.96  # normal quantile of a 95 % interval
STEP = 1e-6  # of a derived quantity's numerical slope, in standard uncertainties


def tracked_result(result: Result, session: Session) -> Result:
    """The result that the session began with, with the values, uncertainties and curve of its end."""
    read, net = session.tracker.read(), session.tracker.network
    names, values = net.model.parameter_names, dict(read.values)
    u = np.sqrt(np.diag(read.covariance))
    parameters = {
        name: _stated(result.parameters[name], values[name], float(each)) for name, each in zip(names, u, strict=True)
    }
    for quantity in net.model.derived(values):
        if quantity.name in result.parameters:
            known = result.parameters[quantity.name]
            parameters[quantity.name] = _stated(known, *_derived(quantity, values, read.covariance))
    correlation = read.covariance / np.outer(u, u)
    noise = session.tracker.noise or float("nan")
    nothing = float("nan")
    fit = Fit(noise, nothing, noise**2, nothing, nothing, nothing, None, int(session.tracker.state.noise[1]), True)
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    changed = replace(
        result,
        estimator=TRACKED,
        settings={"start": result.estimator, "alarms": len(session.alarms), "samples": session.samples},
        provenance={"vibrident": __version__, "time": now, "files": []},
        parameters=parameters,
        correlation=Correlation(names, tuple(tuple(row) for row in correlation.tolist())),
        fit=fit,
        measured=MeasuredCurve.none(),
        warnings=(),
        signals=(),
        training=None,
        weights={},
        certificate={},
        findings=(),
    )
    return replace(changed, response=_curve(changed, result.response.frequency_hz))


def _stated(known: Parameter, value: float, u: float) -> Parameter:
    return replace(known, value=value, standard_uncertainty=u, interval_95=(value - COVERAGE * u, value + COVERAGE * u))


def _derived(quantity: Derived, values: dict[str, float], covariance: FloatArray) -> tuple[float, float]:
    """Value and u by the law of propagation."""
    slopes = []
    for name, each in zip(values, np.sqrt(np.diag(covariance)), strict=True):
        step = STEP * float(each)
        ahead, behind = ({**values, name: values[name] + sign * step} for sign in (1.0, -1.0))
        slopes.append((float(quantity.value(ahead)) - float(quantity.value(behind))) / (2.0 * step))
    return float(quantity.value(values)), float(np.sqrt(np.array(slopes) @ covariance @ np.array(slopes)))


def _curve(result: Result, frequency_hz: FloatArray) -> Curve:
    sensor = result.to_sensor()
    quantity = sensor.quantity if sensor.quantity == "drive" else result.quantity
    found = sensor.frequency_response(frequency_hz, quantity)  # type: ignore[arg-type]
    relative, phase = sensor.uncertainty(frequency_hz, quantity)  # type: ignore[arg-type]
    size = np.abs(found)
    return Curve(frequency_hz, size, np.rad2deg(np.unwrap(np.angle(found))), relative * size, np.rad2deg(phase))
