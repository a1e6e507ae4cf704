"""Simulated sensors, by name."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from vibrident.base.errors import ModelError, unknown
from vibrident.data.records import STANDARD_GRAVITY
from vibrident.physics.models import parse
from vibrident.physics.simulation.checks import (
    require_finite,
    require_not_negative,
    require_positive,
)


@dataclass(frozen=True)
class Sensor:
    """Sensor model with true parameters, and how it would usually be calibrated.

    Attributes:
        name: short name.
        title: what it is.
        model: name of the sensor model, such as "accelerometer+delay".
        parameters: name to true value, SI units, frequencies in Hz.
        band_hz: lowest and highest one-third-octave frequency of its calibration.
        sampling_rate_hz: samples per second.
        amplitude: of the excitation, m/s².
        response_unit: unit of the response.

    Raises:
        ModelError: the parameters are not those of the model.
        InputError: a value cannot be used.
    """

    name: str
    title: str
    model: str
    parameters: Mapping[str, float]
    band_hz: tuple[float, float] = (10.0, 1000.0)
    sampling_rate_hz: float = 51200.0
    amplitude: float = STANDARD_GRAVITY
    response_unit: str = "V"

    def __post_init__(self) -> None:
        where = f"sensor {self.name!r}"
        expected = parse(self.model).parameters
        if set(self.parameters) != {spec.name for spec in expected}:
            raise ModelError(
                "The parameters are not those of the model.",
                expected=", ".join(spec.name for spec in expected),
                found=", ".join(self.parameters) or "none",
                where=where,
                remedy=f"give every parameter of {self.model!r}, and no other",
            )
        for spec in expected:
            value = float(self.parameters[spec.name])
            require_finite(where, **{spec.name: value})
            if spec.kind == "log":
                require_positive(where, **{spec.name: value})
            if spec.kind == "positive":
                require_not_negative(where, **{spec.name: value})
        values = {spec.name: float(self.parameters[spec.name]) for spec in expected}
        object.__setattr__(self, "parameters", MappingProxyType(values))


def _paper(name: str, sign: float, title: str) -> Sensor:
    """Return the sensor of the paper's Table 2.

    f0 630 Hz, 1020 mV/g, δ 0.182; ωn = ωr/√(1 − 2 δ²) (eq. 3).
    """
    damping = 0.182
    parameters = {
        "sensitivity": sign * 1.02 / STANDARD_GRAVITY,
        "natural_frequency": 630.0 / math.sqrt(1.0 - 2.0 * damping**2),
        "damping_ratio": damping,
    }
    return Sensor(name, title, "accelerometer", parameters)


def _paper_with_add_on(name: str, title: str, add_on: str, more: Mapping[str, float]) -> Sensor:
    """Return the paper's sensor with an add-on."""
    return Sensor(
        name, title, f"accelerometer+{add_on}", {**_paper(name, 1.0, "").parameters, **more}
    )


#: Third harmonic k3 A²/4 of 1 % at the amplitude A = 1.02 V of 1 g.
_CUBIC = {"cubic_stiffness": 0.04 / 1.02**2}
_TWO_MODES = {"mode2_frequency": 300.0, "mode2_damping": 0.02, "mode2_gain": 0.01}
_PIEZO = {"sensitivity": 1e-3, "natural_frequency": 30e3, "damping_ratio": 0.02}
_GEOPHONE = {"generator_constant": 28.8, "natural_frequency": 4.5, "damping_ratio": 0.56}
_SEISMOMETER = {"generator_constant": 200.0, "natural_frequency": 1.0, "damping_ratio": 0.7}

SENSORS: Mapping[str, Sensor] = MappingProxyType(
    {
        sensor.name: sensor
        for sensor in (
            _paper("paper", 1.0, "accelerometer of Table 2, 630 Hz, 1020 mV/g"),
            _paper("table2", 1.0, "accelerometer of Table 2, 630 Hz, 1020 mV/g"),
            _paper("inverted", -1.0, "accelerometer of Table 2, its leads exchanged"),
            _paper_with_add_on(
                "cubic", "accelerometer of Table 2, a hardening spring", "cubic", _CUBIC
            ),
            _paper_with_add_on(
                "two-mode",
                "accelerometer of Table 2, on a mount that sways at 300 Hz",
                "mode2",
                _TWO_MODES,
            ),
            Sensor(
                "piezo",
                "piezoelectric accelerometer, 30 kHz",
                "accelerometer",
                _PIEZO,
                (20.0, 20e3),
                102400.0,
                50.0,
            ),
            Sensor(
                "geophone",
                "geophone, 4.5 Hz",
                "velocity-pickup",
                _GEOPHONE,
                (1.0, 200.0),
                2000.0,
                1.0,
            ),
            Sensor(
                "seismometer",
                "seismometer, 1 Hz",
                "velocity-pickup",
                _SEISMOMETER,
                (0.1, 40.0),
                200.0,
                0.01,
            ),
        )
    }
)


def sensor_named(name: str) -> Sensor:
    """Return the sensor of that name."""
    if name in SENSORS:
        return SENSORS[name]
    otherwise = "choose from the list, or give (model, parameters)"
    raise unknown(f"The sensor {name!r} is not known.", name, SENSORS, "simulate", otherwise)
