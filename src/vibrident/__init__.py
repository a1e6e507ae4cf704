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

_WHERE = {
    "Calibration": "vibrident.data.records",
    "Record": "vibrident.data.records",
    "ResponseTable": "vibrident.data.records",
    "KnownResponse": "vibrident.data.known",
    "Provenance": "vibrident.data.records",
    "Result": "vibrident.result",
    "IdentifiedSensor": "vibrident.result.sensor",
    "InputError": "vibrident.base.errors",
    "ModelError": "vibrident.base.errors",
    "NotConverged": "vibrident.base.errors",
    "VibridentError": "vibrident.base.errors",
    "read": "vibrident.data.io",
    "Model": "vibrident.physics.models",
    "ParameterSpec": "vibrident.physics.models",
    "identify": "vibrident.use.identification",
    "identify_many": "vibrident.lab.many",
    "identify_together": "vibrident.fit.joint",
    "simulate": "vibrident.physics.simulation",
    "predict": "vibrident.use.prediction",
    "correct": "vibrident.use.correction",
    "plan": "vibrident.use.planning",
    "Ipnn": "vibrident.fit.estimators",
    "LeastSquares": "vibrident.paper.estimators.lsm",
    "MaximumLikelihood": "vibrident.fit.estimators",
}

#: What methods of a result, a sensor and a model call, and the optimiser of the paper.
bind(
    adam="vibrident.paper.optimiser:Adam",
    summary="vibrident.show.terminal:text",
    plot="vibrident.show.plots:draw",
    result_html="vibrident.show.notebook:result",
    known_response="vibrident.result.known:known_response",
    sensor_html="vibrident.show.notebook:sensor",
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
