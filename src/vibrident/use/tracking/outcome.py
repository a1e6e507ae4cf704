"""Result of a session: the sensor at its end, for report, correction, export and history."""

from __future__ import annotations

import datetime
from dataclasses import replace

import numpy as np

from vibrident.base.version import __version__
from vibrident.data.records import is_motion
from vibrident.fit.problem import Coordinates
from vibrident.fit.uncertainty.budget import DATA, covered_kinds
from vibrident.fit.uncertainty.curve import curve
from vibrident.fit.uncertainty.parameters import (
    correlation,
    coverage_factor,
    fields_of_units,
    parameter_table,
)
from vibrident.physics.naming import in_words
from vibrident.result import TRACKED, Fit, MeasuredCurve, Result, ResultWarning
from vibrident.use.tracking.effects import SCATTER
from vibrident.use.tracking.session import TrackingSession

UNKNOWN_DEGREES_OF_FREEDOM = 1e9  # stands for a number that is not known


def tracked_result(result: Result, session: TrackingSession) -> Result:
    """Return the session's first result with the values, uncertainties and curve of its end."""
    tracker = session.tracker
    frequency_hz = result.response.frequency_hz
    learned = session.learned()
    model = tracker.network.model
    read = session.effects.added(learned)
    coordinates = Coordinates.at(
        model, read.values, (float(frequency_hz[0]), float(frequency_hz[-1]))
    )
    z = coordinates.first
    slopes = coordinates.slopes(z)
    covariance = read.covariance / np.outer(slopes, slopes)
    freedom = float(
        tracker.state.noise[1]
        or result.settings.get("effective_degrees_of_freedom")
        or UNKNOWN_DEGREES_OF_FREEDOM
    )
    drive = not is_motion(tracker.network.quantity)
    units = fields_of_units(
        result.response_unit, str(result.reference.get("unit")) if drive else "m/s^2", drive=drive
    )
    noise = tracker.noise or float("nan")
    nothing = float("nan")
    rows = session.effects.budget(learned, freedom)
    effects = [f"{row['source']} ({row['kind']})" for row in rows if row["kind"] != DATA]
    settings = {
        "start": result.estimator,
        "alarms": len(session.alarms),
        "samples": session.samples,
        "coverage_factor": coverage_factor(freedom),
        "effective_degrees_of_freedom": freedom,
        "uncertainty_budget": rows,
        "uncertainty_covers": "; ".join([SCATTER, *effects]),
    }
    return replace(
        result,
        estimator=TRACKED,
        settings=settings,
        provenance={
            "vibrident": __version__,
            "time": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            "files": [],
        },
        parameters=parameter_table(coordinates, z, covariance, freedom, units, {}),
        correlation=correlation(model, covariance),
        fit=Fit(
            noise,
            nothing,
            noise**2,
            nothing,
            nothing,
            nothing,
            None,
            int(tracker.state.noise[1]),
            True,
        ),
        response=curve(coordinates, z, covariance, tracker.network.quantity, frequency_hz),
        measured=MeasuredCurve.none(),
        warnings=_find_doubts(session),
        signals=(),
        training=None,
        weights={},
        certificate={},
        findings=(),
        uncertainty={"covers": covered_kinds({row["kind"] for row in rows})},
    )


def _find_doubts(session: TrackingSession) -> tuple[ResultWarning, ...]:
    noise = session.document()["reference_noise"]
    changing = session.tracker.changing
    if session.cause.code:
        text = (
            "Alarms have a cause that the model does not have, and the parameters follow it: "
            f"{session.cause.words}."
        )
        return (ResultWarning(session.cause.code, text),)
    if changing:
        text = (
            f"Something changed at {changing[0]:.12g} s, and too little motion followed to tell "
            "what: what it may have been has a u as if it were not known."
        )
        return (ResultWarning("regimes", text),)
    if not noise or noise["corrected"] or not noise["moves"]:
        return ()
    moved = ", ".join(
        f"the {in_words(name)} by {shift:.2g} {session.units[name]}"
        for name, shift in noise["moves"].items()
    )
    text = (
        f"The reference has white noise of {noise['value']:.2g} (rms, its unit): it moves {moved}, "
    )
    text += "which is not corrected, as the residual is not white noise of either channel alone."
    return (ResultWarning("reference_noise", text),)
