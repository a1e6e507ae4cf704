"""vibrident: from calibration records to a vibration sensor's dynamic model, with uncertainty.

    calibration = vibrident.read("calibration.toml")
    result = vibrident.identify(calibration, model="accelerometer+delay")
    result.save("result.json")

Names are loaded when they are first used, so that ``import vibrident`` is quick.
"""

from __future__ import annotations

from typing import Any

__version__ = "0.1.0"

_WHERE = {
    "Calibration": "vibrident.records",
    "Record": "vibrident.records",
    "ResponseTable": "vibrident.records",
    "Provenance": "vibrident.records",
    "Result": "vibrident.result",
    "IdentifiedSensor": "vibrident.sensor",
    "InputError": "vibrident.errors",
    "ModelError": "vibrident.errors",
    "NotConverged": "vibrident.errors",
    "VibridentError": "vibrident.errors",
    "read": "vibrident.io",
    "identify": "vibrident.identification",
    "identify_many": "vibrident.many",
    "identify_together": "vibrident.joint",
    "simulate": "vibrident.simulation",
    "predict": "vibrident.prediction",
    "correct": "vibrident.correction",
    "plan": "vibrident.planning",
    "Ipnn": "vibrident.estimators",
    "LeastSquares": "vibrident.estimators",
    "MaximumLikelihood": "vibrident.estimators",
}

__all__ = [*_WHERE, "__version__"]


def __getattr__(name: str) -> Any:
    if name in _WHERE:
        import importlib

        value = getattr(importlib.import_module(_WHERE[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(f"module 'vibrident' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
