"""Results of every kind of sensor, made by formula: no data, no identification."""

from __future__ import annotations

import numpy as np

from vibrident.data.records import REFERENCE_UNITS
from vibrident.physics.models import parse
from vibrident.result import Correlation, Curve, Fit, MeasuredCurve, Parameter, Result

GRAVITY = 9.80665
PAPER = {"sensitivity": 1.02 / GRAVITY, "natural_frequency": 652.1, "damping_ratio": 0.182}
COIL = {"generator_constant": 27.7, "natural_frequency": 4.5, "damping_ratio": 0.56}
MODE2 = {"mode2_frequency": 2300.0, "mode2_damping": 0.03, "mode2_gain": -0.02}
UNITS = {
    "sensitivity": "V/(m/s^2)",
    "generator_constant": "V/(m/s)",
    "natural_frequency": "Hz",
    "mode2_frequency": "Hz",
    "highpass_frequency": "Hz",
    "delay": "s",
    "boxcar_length": "s",
    "cubic_stiffness": "1/V^2",
}


def result(model, values, band=(10.0, 1000.0), quantity="acceleration", unit=None, relative=1e-3, **more):
    """A result of ``model`` with these values, u = ``relative``·|value|, and curves from the model itself."""
    parsed = parse(model)
    names = parsed.parameter_names
    parameters = {}
    for name in names:
        value, u = float(values[name]), relative * abs(values[name])
        unit_ = UNITS.get(name, "1")
        if quantity == "drive" and name == "sensitivity":
            unit_ = f"V/({unit})"
        parameters[name] = Parameter(value, unit_, u, (value - 1.96 * u, value + 1.96 * u))
    for derived in parsed.derived(values):
        value = float(derived.value(values))
        text = {"conversion_coefficient": "V/m"}.get(derived.name, derived.unit)
        parameters[derived.name] = Parameter(value, text, relative * abs(value), (None, None), derived=True)
    matrix = np.full((len(names), len(names)), 0.1) + 0.9 * np.eye(len(names))
    f = np.geomspace(*band, 25)
    stated = parsed.stated_quantity(quantity)
    s = parsed.frequency_response(values, f, stated)
    curve = (
        tuple(f.tolist()),
        tuple(np.abs(s).tolist()),
        tuple(np.rad2deg(np.angle(s)).tolist()),
        tuple((1e-3 * np.abs(s)).tolist()),
        (0.05,) * len(f),
    )
    fields = {
        "model": parsed.name,
        "estimator": "ml",
        "settings": {"coverage_factor": 1.99},
        "provenance": {"vibrident": "0.1.0", "time": "2025-11-13T10:00:00+00:00", "files": [], "seed": None},
        "parameters": parameters,
        "correlation": Correlation(names, tuple(tuple(row) for row in matrix.tolist())),
        "fit": Fit(0.001, 0.001, 1e-6, 0.9999, 100.0, 0.01, 1.02, 40, True),
        "response": Curve(*curve),
        "measured": MeasuredCurve(*curve, (0.01,) * len(f), (0.0,) * len(f), ('a, "b".csv',) * len(f)),
        "sensor": {"manufacturer": "Brüel & Søn", "type": 'MSV "3000"', "serial_number": "4711 */"},
        "reference": {
            "quantity": quantity,
            "unit": unit or {"acceleration": "m/s^2", "velocity": "m/s"}.get(quantity, "m"),
        },
        "sensitivity_per": {"quantity": stated, "unit": unit or REFERENCE_UNITS[stated]},
    }
    return Result(**{**fields, **more})


def paper(**more):
    return result("accelerometer", PAPER, **more)


#: name → (model, values, band); every core, add-on and sign, damping below, at and above the critical.
CASES = {
    "paper": ("accelerometer", PAPER, (10.0, 1000.0)),
    "inverted": ("accelerometer", {**PAPER, "sensitivity": -0.104}, (10.0, 1000.0)),
    "critical": ("accelerometer", {**PAPER, "damping_ratio": 1.0}, (10.0, 1000.0)),
    "overdamped": ("accelerometer", {**PAPER, "damping_ratio": 3.0}, (10.0, 1000.0)),
    "undamped": ("accelerometer", {**PAPER, "damping_ratio": 0.0}, (10.0, 500.0)),
    "piezo": (
        "accelerometer+highpass",
        {"sensitivity": 1e-3, "natural_frequency": 30e3, "damping_ratio": 0.02, "highpass_frequency": 0.2},
        (5.0, 15e3),
    ),
    "late": ("accelerometer+delay", {**PAPER, "delay": 1.24e-5}, (10.0, 1000.0)),
    "very late": ("accelerometer+delay", {**PAPER, "delay": 4.3e-4}, (10.0, 1000.0)),
    "mems": (
        "accelerometer+delay+boxcar",
        {**PAPER, "natural_frequency": 1400.0, "delay": 2.0e-4, "boxcar_length": 5e-4},
        (10.0, 1000.0),
    ),
    "two modes": ("accelerometer+mode2", {**PAPER, **MODE2}, (10.0, 2500.0)),
    "on a mounting": (
        "accelerometer+mounting:0.3+delay",
        {**PAPER, "mounting_frequency": 2600.0, "mounting_damping": 0.05, "delay": 1e-4},
        (10.0, 2000.0),
    ),
    "everything": (
        "accelerometer+mode2+highpass+boxcar+delay",
        {**PAPER, **MODE2, "highpass_frequency": 1.3, "boxcar_length": 1e-4, "delay": 3e-5},
        (10.0, 2000.0),
    ),
    "coil": ("velocity-pickup", COIL, (0.5, 200.0)),
    "coil inverted": (
        "velocity-pickup+highpass",
        {**COIL, "generator_constant": -28.8, "highpass_frequency": 0.1},
        (0.5, 200.0),
    ),
    "coil two modes": (
        "velocity-pickup+mode2+delay",
        {**COIL, "mode2_frequency": 160.0, "mode2_damping": 0.02, "mode2_gain": 0.003, "delay": 1e-3},
        (0.5, 200.0),
    ),
}


def case(name, **more):
    model, values, band = CASES[name]
    return result(model, values, band, **more)
