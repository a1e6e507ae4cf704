"""Ten sensors as their makers would write them, and each sensor's equations of motion for a simulation.

A sensor is simulated from the matrices of its equations, ẋ = A x + B u, y = C x + D u, at sums of
sines, which they answer exactly; no formula of a model is in it, and nothing of the package.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vibrident import Model, ParameterSpec

TURN = 2 * np.pi


@dataclass(frozen=True)
class Sensor:
    """A model, true values, what drives it, and A, B, C, D (and a delay) of the true values."""

    model: Model
    values: dict[str, float]
    quantity: str
    unit: str
    top_hz: float  # highest frequency of the motion
    matrices: tuple[Any, Any, Any, float]
    late_s: float = 0.0


def oscillator(fn: float, damping: float) -> tuple[float, float]:
    """Stiffness and damping of a unit mass."""
    return (TURN * fn) ** 2, 2 * damping * TURN * fn


def convective() -> Sensor:
    model = Model(
        "convective",
        lambda s, sensitivity, cutoff: sensitivity / (1 + s / (TURN * cutoff)),
        [ParameterSpec("sensitivity", "V/(m/s^2)"), ParameterSpec("cutoff", "Hz")],
    )
    rate = TURN * 35.0
    return Sensor(
        model, {"sensitivity": 0.1, "cutoff": 35.0}, "acceleration", "", 400.0, ([[-rate]], [rate], [0.1], 0.0)
    )


def loudspeaker() -> Sensor:
    q_mechanical = np.sqrt(0.02 * 3000.0) / 1.1  # measured: a free decay with the coil open

    def cone(s, compliance, fs, q_electrical, coil_time):
        w = TURN * fs
        mechanics = 1 + s / (w * q_mechanical) + s**2 / w**2
        return compliance / ((1 + s * coil_time) * mechanics + s / (w * q_electrical))

    model = Model(
        "loudspeaker",
        cone,
        [
            ParameterSpec("compliance", "m/V"),
            ParameterSpec("fs", "Hz", start=50.0, bounds=(10.0, 300.0)),
            ParameterSpec("q_electrical", "1", start=0.5, bounds=(0.1, 5.0)),
            ParameterSpec("coil_time", "s", start=1e-4, bounds=(1e-5, 1e-3)),
        ],
    )
    force, resistance, inductance, mass, loss, stiffness = 6.0, 6.4, 1.5e-3, 0.02, 1.1, 3000.0
    w = np.sqrt(stiffness / mass)
    values = {
        "compliance": force / (resistance * stiffness),
        "fs": w / TURN,
        "q_electrical": w * mass * resistance / force**2,
        "coil_time": inductance / resistance,
    }
    a = [
        [0, 1, 0],
        [-stiffness / mass, -loss / mass, force / mass],
        [0, -force / inductance, -resistance / inductance],
    ]
    return Sensor(model, values, "drive", "V", 1000.0, (a, [0, 0, 1 / inductance], [1, 0, 0], 0.0))


def rlc() -> Sensor:
    resistor = 50.0
    model = Model(
        "rlc",
        lambda s, gain, coil, capacitor: gain * resistor / (resistor + s * coil + 1 / (s * capacitor)),
        [
            ParameterSpec("gain", "1"),
            ParameterSpec("coil", "H", start=1e-3),
            ParameterSpec("capacitor", "F", start=1e-6),
        ],
    )
    coil, capacitor, gain = 4.7e-3, 2.2e-7, 0.98
    a = [[0, 1 / capacitor], [-1 / coil, -resistor / coil]]
    values = {"gain": gain, "coil": coil, "capacitor": capacitor}
    return Sensor(model, values, "drive", "V", 15e3, (a, [0, 1 / coil], [0, gain * resistor], 0.0))


def geophone() -> Sensor:
    open_damping = 0.25  # measured: a free decay with the coil open

    def coil(s, constant, fn, coil_damping, coil_time):
        w = TURN * fn
        return constant * s / ((1 + s * coil_time) * (s**2 + 2 * open_damping * w * s + w**2) + s * coil_damping)

    model = Model(
        "geophone-coil",
        coil,
        [
            ParameterSpec("constant", "V/(m/s)"),
            ParameterSpec("fn", "Hz"),
            ParameterSpec("coil_damping", "1/s", start=30.0),
            ParameterSpec("coil_time", "s", start=1e-4),
        ],
    )
    mass, force, resistance, load, inductance = 0.011, 27.0, 395.0, 1000.0, 0.6
    stiffness, loss = oscillator(10.0, 0.25)
    total = resistance + load
    values = {
        "constant": force * load / total,
        "fn": 10.0,
        "coil_damping": force**2 / (mass * total),
        "coil_time": inductance / total,
    }
    a = [[0, 1, 0], [-stiffness, -loss, -force / mass], [0, force / inductance, -total / inductance]]
    return Sensor(model, values, "acceleration", "", 800.0, (a, [0, 1, 0], [0, 0, load], 0.0))


def mems() -> Sensor:
    def package(s, sensitivity, fn, damping, package_frequency, package_damping):
        w, p = TURN * fn, TURN * package_frequency
        mass = w**2 / (s**2 + 2 * damping * w * s + w**2)
        return sensitivity * mass * p**2 / (s**2 + 2 * package_damping * p * s + p**2)

    model = Model(
        "mems-package",
        package,
        [
            ParameterSpec("sensitivity", "V/(m/s^2)"),
            ParameterSpec("fn", "Hz", start=2000.0, bounds=(500.0, 4000.0)),
            ParameterSpec("damping", "1", start=0.5, bounds=(0.05, 3.0)),
            ParameterSpec("package_frequency", "Hz", start=8000.0, bounds=(4000.0, 20000.0)),
            ParameterSpec("package_damping", "1", start=0.02, bounds=(0.001, 0.2)),
        ],
    )
    values = {"sensitivity": 0.04, "fn": 2500.0, "damping": 0.7, "package_frequency": 7300.0, "package_damping": 0.01}
    (k, c), (kp, cp) = oscillator(2500.0, 0.7), oscillator(7300.0, 0.01)
    a = [[0, 1, 0, 0], [-kp, -cp, 0, 0], [0, 0, 0, 1], [kp, 0, -k, -c]]  # the package moves, and the mass in it
    return Sensor(model, values, "acceleration", "", 9000.0, (a, [0, 1, 0, 0], [0, 0, 0.04 * k, 0], 0.0))


def hydrophone() -> Sensor:
    def element(s, sensitivity, corner, fn, q):
        w = TURN * fn
        return sensitivity * s / (s + TURN * corner) / (1 + s / (q * w) + (s / w) ** 2)

    model = Model(
        "hydrophone",
        element,
        [
            ParameterSpec("sensitivity", "V/Pa"),
            ParameterSpec("corner", "Hz", start=10.0),
            ParameterSpec("fn", "Hz", start=5000.0),
            ParameterSpec("q", "1", start=5.0, bounds=(0.5, 100.0)),
        ],
    )
    values = {"sensitivity": 2e-4, "corner": 25.0, "fn": 7000.0, "q": 8.0}
    k, c = oscillator(7000.0, 1 / 16.0)
    rate = TURN * 25.0
    a = [[0, 1, 0], [-k, -c, 0], [k, 0, -rate]]  # the last state is what the leak takes away, over its rate
    return Sensor(model, values, "drive", "Pa", 9000.0, (a, [0, 1, 0], [2e-4 * k, 0, -2e-4 * rate], 0.0))


def force_sensor() -> Sensor:
    def element(s, sensitivity, fn, damping):
        loss = 2 * damping * s / (TURN * fn)
        return sensitivity * (1 + loss) / (1 + loss + (s / (TURN * fn)) ** 2)

    model = Model(
        "force-mass",
        element,
        [
            ParameterSpec("sensitivity", "V/N"),
            ParameterSpec("fn", "Hz"),
            ParameterSpec("damping", "1", start=0.01, bounds=(0.0, 1.0)),
        ],
    )
    k, c = oscillator(3100.0, 0.03)
    values = {"sensitivity": 5e-3, "fn": 3100.0, "damping": 0.03}
    return Sensor(model, values, "drive", "N", 5000.0, ([[0, 1], [-k, -c]], [0, 1], [5e-3 * k, 5e-3 * c], 0.0))


def pressure_line() -> Sensor:
    model = Model(
        "pressure-line",
        lambda s, gain, lag, travel: gain * np.exp(-s * travel) / (1 + s * lag),
        [
            ParameterSpec("gain", "V/Pa"),
            ParameterSpec("lag", "s", start=1e-3),
            ParameterSpec("travel", "s", start=5e-3, bounds=(0.0, 0.02)),
        ],
    )
    values = {"gain": 1e-3, "lag": 2e-3, "travel": 6.3e-3}
    return Sensor(model, values, "drive", "Pa", 300.0, ([[-500.0]], [500.0], [1e-3], 0.0), 6.3e-3)


def lvdt() -> Sensor:
    def demodulated(s, sensitivity, core, corner, q):
        w = TURN * corner
        return sensitivity / (1 + s * core) / (1 + s / (q * w) + (s / w) ** 2)

    model = Model(
        "lvdt",
        demodulated,
        [
            ParameterSpec("sensitivity", "V/m"),
            ParameterSpec("core", "s", start=3e-4),
            ParameterSpec("corner", "Hz", start=200.0, bounds=(50.0, 2000.0)),
            ParameterSpec("q", "1", start=0.7, bounds=(0.3, 3.0)),
        ],
    )
    values = {"sensitivity": 80.0, "core": 1e-3, "corner": 250.0, "q": 0.8}
    k, c = oscillator(250.0, 1 / 1.6)
    a = [[-1000.0, 0, 0], [0, 0, 1], [1000.0, -k, -c]]
    return Sensor(model, values, "drive", "m", 800.0, (a, [1.0, 0, 0], [0, 80.0 * k, 0], 0.0))


def helmholtz() -> Sensor:
    model = Model(
        "helmholtz",
        lambda s, gain, fn, q: gain / (1 + s / (q * TURN * fn) + (s / (TURN * fn)) ** 2),
        [
            ParameterSpec("gain", "1"),
            ParameterSpec("fn", "Hz"),
            ParameterSpec("q", "1", start=10.0, bounds=(1.0, 300.0)),
        ],
    )
    k, c = oscillator(217.0, 0.5 / 22.0)
    return Sensor(
        model,
        {"gain": 1.02, "fn": 217.0, "q": 22.0},
        "drive",
        "Pa",
        500.0,
        ([[0, 1], [-k, -c]], [0, 1], [1.02 * k, 0], 0.0),
    )


SENSORS = (
    convective,
    loudspeaker,
    rlc,
    geophone,
    mems,
    hydrophone,
    force_sensor,
    pressure_line,
    lvdt,
    helmholtz,
)


def response_at(sensor: Sensor, frequency_hz: np.ndarray) -> np.ndarray:
    """C (jω − A)⁻¹ B + D, late."""
    a, b, c, d = (np.array(matrix, dtype=float) for matrix in sensor.matrices)
    s = 2j * np.pi * frequency_hz
    inner = s[:, None, None] * np.eye(len(a)) - a
    states = np.linalg.solve(inner, np.broadcast_to(b[:, None], (s.size, len(a), 1)).astype(complex))
    return ((states[..., 0] @ c) + d) * np.exp(-s * sensor.late_s)


SAMPLES = 4096


def measured(sensor: Sensor, rng: np.random.Generator) -> dict[str, Any]:
    """A record of 200 tones of whole periods, with white noise in both channels."""
    rate = 2.8 * sensor.top_hz
    bins = np.unique(np.geomspace(3, sensor.top_hz / rate * SAMPLES, 200).astype(int))
    hz = bins * rate / SAMPLES
    turn = np.exp(2j * np.pi * np.outer(np.arange(SAMPLES) / rate, hz))
    amplitudes = np.exp(1j * rng.uniform(0.0, TURN, bins.size))
    reference = (turn @ amplitudes).real
    response = (turn @ (amplitudes * response_at(sensor, hz))).real
    noise = rng.standard_normal((2, SAMPLES))
    return {
        "reference": reference + 1e-3 * np.std(reference) * noise[0],
        "response": response + 2e-3 * np.std(response) * noise[1],
        "sampling_rate_hz": rate,
        "quantity": sensor.quantity,
        "reference_unit": sensor.unit,
        "excitation": "multisine",
    }
