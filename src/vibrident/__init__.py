"""vibrident: from calibration records to a vibration sensor's dynamic model, with uncertainty.

    calibration = vibrident.read("calibration.toml")
    result = vibrident.identify(calibration, model="accelerometer+delay")
    result.save("result.json")

Names are loaded when they are first used, so that ``import vibrident`` is quick.
"""

from __future__ import annotations

from typing import Any

from vibrident.base.binding import bind
from vibrident.base.version import __version__

# At once: importing the package of the same name later would put it in the place of the function.
from vibrident.export import export as export

#: Public name → the module that defines it.
_WHERE = {
    # data
    "read": "vibrident.data.io",
    "inspect": "vibrident.use.inspection",
    "simulate": "vibrident.physics.simulation",
    "with_noise": "vibrident.physics.simulation",
    "one_third_octave": "vibrident.physics.simulation",
    "Calibration": "vibrident.data.records",
    "Record": "vibrident.data.records",
    "ResponseTable": "vibrident.data.records",
    "Provenance": "vibrident.data.records",
    "KnownResponse": "vibrident.data.known",
    "Mounting": "vibrident.data.known",
    "SystematicEffect": "vibrident.data.effects",
    # models
    "Model": "vibrident.physics.models",
    "ParameterSpec": "vibrident.physics.models",
    "parse_model": "vibrident.physics.models",
    # identification
    "identify": "vibrident.use.identification",
    "identify_many": "vibrident.lab.many",
    "identify_together": "vibrident.fit.joint",
    "Ipnn": "vibrident.fit.estimators",
    "MaximumLikelihood": "vibrident.fit.estimators",
    "LeastSquares": "vibrident.paper.estimators.lsm",
    "Sampling": "vibrident.fit.uncertainty.posterior",
    "Result": "vibrident.result",
    "IdentifiedSensor": "vibrident.result.sensor",
    # uses of a result
    "predict": "vibrident.use.prediction",
    "correct": "vibrident.use.correction",
    "plan": "vibrident.use.planning",
    "Recording": "vibrident.use.planning",
    "predict_mounted": "vibrident.use.planning",
    "compare": "vibrident.use.methods",
    "track": "vibrident.use.tracking.following",
    "SensorTracker": "vibrident.use.tracking.following",
    "sensitivity_matrix": "vibrident.use.triaxial",
    "agreement": "vibrident.use.agreement",
    # documents and other programs
    "report": "vibrident.show.report",
    "check_certificate": "vibrident.show.issue",
    "verify": "vibrident.lab.signatures",
    "export": "vibrident.export",
    # many sensors, and their years
    "Fleet": "vibrident.lab.fleets",
    "History": "vibrident.lab.histories",
    # errors
    "VibridentError": "vibrident.base.errors",
    "InputError": "vibrident.base.errors",
    "ModelError": "vibrident.base.errors",
    "NotConverged": "vibrident.base.errors",
}

#: Functions that methods of a calibration, a result, a sensor and a model call, and the paper's
#: optimiser.
bind(
    adam="vibrident.paper.optimiser:Adam",
    summary="vibrident.show.terminal:text",
    plot="vibrident.show.plots:draw",
    plot_inspection="vibrident.show.plots:draw_inspection",
    result_html="vibrident.show.notebook:result",
    known_response="vibrident.result.known:known_response",
    sensor_html="vibrident.show.notebook:sensor",
    write_calibration="vibrident.data.io.writer:write_calibration",
    with_add_ons="vibrident.physics.models:with_add_ons",
    zeros_and_poles="vibrident.export.approximation:system",
)

__all__ = [*_WHERE, "__version__"]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name in _WHERE:
        import importlib

        value = getattr(importlib.import_module(_WHERE[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'vibrident' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
