"""Small results of sensors with a name, a date and a stated budget, as a laboratory's calibrations give them."""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np

from vibrident.base.nominal import Nominal
from vibrident.result import Correlation, Curve, Fit, MeasuredCurve, Parameter, Result
from vibrident.show.points import sensitivity_at

FREQUENCIES_HZ = tuple(10 ** (n / 10) for n in (13, 16, 19, 22, 25))
REFERENCE = "calibration of the reference"


def calibrated(
    sensitivity: float = 0.1,
    date: str | None = "2020-01-01",
    *,
    serial: str = "4711",
    noise: float = 0.001,
    shared: dict[str, float] | None = None,
    certificate: dict | None = None,
    sensor: dict | None = None,
    data: str = "",
) -> Result:
    """An accelerometer's calibration: relative ``noise``, and relative gains in common by source (``shared``)."""
    gains = {REFERENCE: 0.005} if shared is None else shared
    u = float(np.hypot(noise, np.linalg.norm(list(gains.values()) or [0.0])))
    f = np.array(FREQUENCIES_HZ)
    s = sensitivity / (1 - (f / 5000) ** 2)
    curve = (tuple(f), tuple(s), (0.0,) * 5, tuple(u * s), (0.05,) * 5)
    rows = [
        {"source": source, "type": "B", "kind": "gain", "standard_uncertainty": size, "unit": "1",
         "degrees_of_freedom": None, "contributions": {"sensitivity": size * sensitivity}}
        for source, size in gains.items()
    ]  # fmt: skip
    stated = {"date_of_calibration": date} if date else {}
    return Result(
        model="accelerometer",
        estimator="ml",
        settings={"uncertainty_budget": rows},
        provenance={"files": [{"file": "a.csv", "sha256": hashlib.sha256(data.encode()).hexdigest()}] if data else []},
        parameters={
            "sensitivity": Parameter(sensitivity, "V/(m/s^2)", u * sensitivity, (None, None)),
            "natural_frequency": Parameter(5000.0, "Hz", 20.0, (None, None)),
        },
        correlation=Correlation(("sensitivity", "natural_frequency"), ((1.0, 0.0), (0.0, 1.0))),
        fit=Fit(1e-3, 1e-3, 1e-6, 1.0, 1e3, 1e-3, 1.0, 8, True),
        response=Curve(*curve),
        measured=MeasuredCurve(*curve, (0.0,) * 5, (0.0,) * 5, ("a",) * 5),
        sensor={"manufacturer": "maker", "type": "type A", "serial_number": serial} | (sensor or {}),
        reference={"quantity": "acceleration", "unit": "m/s^2"},
        certificate=stated | (certificate or {}),
    )


def at_reference(result: Result) -> float:
    """The sensitivity at the reference frequency."""
    point = sensitivity_at(result, Nominal(160.0, 10**2.2))
    assert point is not None
    return point.magnitude


#: What a certificate of these must state.
STATED = {
    "laboratory": "L",
    "laboratory_address": "A",
    "place": "laboratory",
    "customer": "C",
    "customer_address": "B",
    "procedure": "ISO 16063-11",
    "traceability": "to the SI",
    "temperature_c": 23.0,
    "country": "DE",
}


def certifiable(data: str = "one", serial: str = "4711", **more) -> Result:
    """Return a calibration with all that its certificate states but number, date of issue and approver."""
    calibration = calibrated(data=data, serial=serial, certificate={**STATED, **more})
    damping = {"damping_ratio": Parameter(0.01, "1", 0.001, (None, None))}
    covers = {"covers": ["noise", "gain", "phase"]}
    return replace(calibration, parameters={**calibration.parameters, **damping}, uncertainty=covers)
