"""State of a result only what may be stated to a customer: every document begins here.

- No U of the model lies below that of the measured values, as a model averages them.
- A model that the data reject states nothing: the measured values stand alone.
- A phase is stated where it was measured, where the certificate asks for it, and where the source
  of its uncertainty is stated; a report, which certifies nothing, states a measured phase all the
  same.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.uncertainty.floor import raised
from vibrident.physics.naming import described
from vibrident.result import Correlation, Curve, Result
from vibrident.show.coverage import unstated
from vibrident.show.curves import column
from vibrident.show.formulas import Words
from vibrident.show.language import ENGLISH, Translator

SOURCE = "U of the measured values"
RAISED = "raised_to_measured"
REJECTED = "rejected_model"  # in the settings of what is certified


def certified(result: Result) -> Result:
    """Return what may be certified of a result."""
    statable = result if result.is_tracked else _certify_model(result)
    return statable if states_phase(result) else _without_phase(statable)


def raised_to_measured(result: Result) -> Result:
    """Return a result with no U of its model below that of its measured values.

    Every document for a customer states it so, signed or not; a tracked result stays as it is.
    """
    if result.is_tracked or not result.has_gain:
        return result
    raised_result = raised(
        result,
        lambda f: _measured_u(result, "magnitude", f),
        lambda f: _measured_u(result, "phase_deg", f),
        SOURCE,
    )
    if raised_result == result:
        return result
    settings = {**raised_result.settings, RAISED: True}
    rows = result.settings.get("uncertainty_budget") or ()
    if rows and all("contributions" in row for row in rows):
        added = raised_result.settings["uncertainty_budget"][len(rows) :]
        settings["uncertainty_budget"] = [*rows, *({**row, "kind": "data"} for row in added)]
    elif "uncertainty_budget" in result.settings:
        settings["uncertainty_budget"] = rows
    else:
        settings.pop("uncertainty_budget", None)
    return replace(raised_result, settings=settings)


def describe_raised(result: Result, translate: Translator = ENGLISH) -> tuple[Words, ...]:
    """Return which U of a result are raised: to the laboratory's capability, to the measured."""
    settings = result.settings
    entries = ("cmc", settings.get("cmc")), ("raised", settings.get(RAISED))
    return tuple(translate("text", key) for key, applies in entries if applies)


def states_phase(result: Result) -> bool:
    """Return whether the document of a result states phases."""
    phase_wanted = "phase" in (result.certificate.get("quantities") or ("phase",))
    measured = result.response if result.is_tracked else result.measured
    if not phase_wanted or not np.isfinite(measured.phase_deg).any():
        return False
    lacking = unstated(result)
    return "phase" not in lacking or "gain" in lacking


def stated_parameters(result: Result) -> Result:
    """Return a result without the parameters that its phase alone tells, if it has no phase."""
    if any(np.isfinite(curve.phase_deg).any() for curve in (result.response, result.measured)):
        return result
    parameters = {
        name: parameter
        for name, parameter in result.parameters.items()
        if getattr(described(name), "kind", "") != "time"
    }
    indices = [i for i, name in enumerate(result.correlation.names) if name in parameters]
    names = tuple(result.correlation.names[i] for i in indices)
    matrix = tuple(tuple(result.correlation.matrix[i][j] for j in indices) for i in indices)
    return replace(result, parameters=parameters, correlation=Correlation(names, matrix))


def _certify_model(result: Result) -> Result:
    if not result.fit.adequate:
        settings = {
            key: setting for key, setting in result.settings.items() if key != "temperature"
        }
        return replace(
            result,
            parameters={},
            correlation=Correlation((), ()),
            response=Curve.none(),
            settings={**settings, REJECTED: True},
        )
    return raised_to_measured(result)


def _measured_u(result: Result, quantity: str, frequency_hz: FloatArray) -> FloatArray:
    """Return the measured u, relative or in rad, interpolated over ln f between neighbours."""
    points = result.measured
    u = column(points, f"{quantity}_uncertainty")
    u = np.deg2rad(u) if quantity == "phase_deg" else u / np.abs(points.magnitude)
    usable = np.flatnonzero(np.isfinite(u) & (points.frequency_hz > 0.0))
    if not usable.size or not len(frequency_hz):
        return np.zeros(len(frequency_hz))
    order = usable[np.argsort(points.frequency_hz[usable], kind="stable")]
    return np.interp(np.log(frequency_hz), np.log(points.frequency_hz[order]), u[order])


def _without_phase(result: Result) -> Result:
    def blank(curve: Curve) -> dict[str, FloatArray]:
        nothing = np.full(curve.frequency_hz.size, np.nan)
        return {"phase_deg": nothing, "phase_deg_uncertainty": nothing}

    return replace(
        result,
        response=replace(result.response, **blank(result.response)),
        measured=replace(result.measured, **blank(result.measured)),
    )
