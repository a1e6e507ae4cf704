"""Realistic results, made by formula: the paper's Table 2 sensor, a velocity pickup, a table, and degenerate ones."""

from __future__ import annotations

import functools
from dataclasses import replace

import numpy as np

from vibrident.data.records import STANDARD_GRAVITY, Calibration, Record, ResponseTable
from vibrident.physics.discretisation.weights import MEANING
from vibrident.result import (
    WARNING_CODES,
    Correlation,
    Curve,
    Fit,
    MeasuredCurve,
    Parameter,
    Result,
    ResultWarning,
    Signal,
    Training,
)

S0 = 1.020 / STANDARD_GRAVITY  # V/(m/s²)
NATURAL_HZ, DAMPING, DELAY_S = 652.0, 0.182, 12.4e-6
RATE_HZ = 51200
#: Of a sine, its excerpt shows five periods in at most so many samples: every result of a test is written and read.
MAX_EXCERPT_SAMPLES = 400
THIRD_OCTAVES = tuple(10 ** (n / 10) for n in range(10, 31))  # 10 Hz to 1 kHz, 21 of them
NAMES = tuple(f"record_{i + 1:02d}_{hz:.5g}Hz.csv" for i, hz in enumerate(THIRD_OCTAVES))
_VALUES = {
    "W1": [[0.0], [1.953125e-05]],
    "W2": [[1.71253e6, 33.447]],
    "W3": [[0.98412, 1.953125e-05], [-327.742, 0.97088]],
    "W4": [[-6.53e-4]],
}
WEIGHTS = {
    name: {"layer": layer, "meaning": meaning, "value": _VALUES[name]} for name, (layer, meaning) in MEANING.items()
}


def accelerometer(f, s0=S0, natural=NATURAL_HZ, damping=DAMPING, delay=DELAY_S):
    r = np.asarray(f) / natural
    return s0 / (1 - r**2 + 2j * damping * r) * np.exp(-2j * np.pi * np.asarray(f) * delay)


def velocity_pickup(f, g=27.7, natural=0.475, damping=0.71):
    r = np.asarray(f) / natural
    return -g * r**2 / (1 - r**2 + 2j * damping * r)


def _parameter(value, unit, u, **marks):
    interval = (None, None) if u is None else (value - 1.96 * u, value + 1.96 * u)
    return Parameter(float(value), unit, u, interval, **marks)


def _curve(f, s, u_relative):
    return Curve(
        tuple(f),
        tuple(abs(s)),
        tuple(np.rad2deg(np.angle(s))),
        tuple(u_relative * abs(s)),
        tuple(np.rad2deg(u_relative)),
    )


def _measured(f, model, u_relative, seed, records=None):
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=(2, len(f))) * u_relative
    s = model * (1 + noise[0]) * np.exp(1j * noise[1])
    return MeasuredCurve(
        tuple(f),
        tuple(abs(s)),
        tuple(np.rad2deg(np.angle(s))),
        tuple(u_relative * abs(s)),
        tuple(np.rad2deg(u_relative)),
        tuple(100 * (abs(model) / abs(s) - 1)),
        tuple(np.rad2deg(-noise[1])),
        tuple(records or ("frf.csv",) * len(f)),
    )


def excerpt(name, t, measured, predicted, unit="V", rmse=0.0, nrmse=0.0):
    """Of evenly spaced times."""
    residual = np.asarray(measured) - np.asarray(predicted)
    return Signal(name, float(t[0]), float(t[1] - t[0]), measured, residual, unit, rmse, nrmse)


@functools.cache
def _signals(seed):
    """Excerpts of table2: to round all their samples takes longer than all else of it."""
    rng = np.random.default_rng(seed)
    signals = []
    for name, hz in zip(NAMES, np.array(THIRD_OCTAVES), strict=True):
        samples = int(5 * RATE_HZ / hz)
        t = np.arange(0, samples, -(-samples // MAX_EXCERPT_SAMPLES)) / RATE_HZ
        y = np.real(accelerometer(hz) * STANDARD_GRAVITY * np.exp(2j * np.pi * hz * t))
        e = 0.004 * rng.normal(size=t.size) + 0.001 * np.sin(4 * np.pi * hz * t)
        rmse = float(np.sqrt(np.mean(e**2)))
        signals.append(excerpt(name, t, y + e, y, "V", rmse, rmse / float(np.std(y))))
    return tuple(signals)


def table2(seed=1, codes=()):
    """21 sine records of the Table 2 sensor with delay; clean unless codes are given."""
    f = np.array(THIRD_OCTAVES)
    dense = np.geomspace(5, 2000, 200)
    u_measured = 0.0025 * (1 + (f / 700) ** 2)
    steps = np.arange(9)
    parameters = {
        "sensitivity": _parameter(S0 * 1.0003, "V/(m/s^2)", 1.07e-4),
        "natural_frequency": _parameter(652.04, "Hz", 0.118),
        "damping_ratio": _parameter(0.18213, "1", 0.00021),
        "delay": _parameter(1.2382e-5, "s", 9.6e-8),
        "natural_angular_frequency": _parameter(4096.89, "rad/s", 0.74, derived=True),
        "resonance_frequency": _parameter(630.04, "Hz", 0.12, derived=True),
        "conversion_coefficient": _parameter(1.74568e6, "V/m", 1.9e3, derived=True),
    }
    return Result(
        model="accelerometer+delay",
        estimator="ipnn",
        settings={"discretization": "band-limited", "nodes": 4, "reason": "auto: recorded data", "time_s": 0.84},
        provenance={
            "versions": {"vibrident": "0.1.0", "jax": "0.10.1", "numpy": "2.3.0"},
            "files": [{"file": name, "sha256": f"{i:064x}"} for i, name in enumerate(NAMES[:3])],
            "seed": 0,
            "time": "2025-01-01T12:00:00Z",
        },
        parameters=parameters,
        correlation=Correlation(
            ("sensitivity", "natural_frequency", "damping_ratio", "delay"),
            ((1.0, 0.11, 0.52, 0.02), (0.11, 1.0, 0.08, -0.34), (0.52, 0.08, 1.0, 0.27), (0.02, -0.34, 0.27, 1.0)),
        ),
        fit=Fit(0.0041, 0.0033, 0.0041**2, 0.99998, 231.0, 0.00433, 1.07, 38, "lack_of_fit" not in codes),
        response=_curve(dense, accelerometer(dense), 0.001 * (1 + (dense / 900) ** 2)),
        measured=_measured(f, accelerometer(f), u_measured, seed, NAMES),
        warnings=tuple(ResultWarning(code, f"{code} was seen in record 3 (value 4.2, limit 1.0).") for code in codes),
        sensor={"manufacturer": "Brüel", "type": "MSV 3000", "serial_number": "4711"},
        reference={"quantity": "acceleration", "unit": "m/s^2"},
        sensitivity_per={"quantity": "acceleration", "unit": "m/s^2"},
        response_unit="V",
        signals=_signals(seed),
        training=Training(
            "gauss-newton",
            "converged",
            9,
            tuple(3.2 * 10.0 ** (-1.1 * steps) + 1.1e-3),
            {
                "sensitivity": tuple(S0 * (1 + 0.3 * 0.2**steps)),
                "natural_frequency": tuple(652 * (1 - 0.4 * 0.25**steps)),
                "damping_ratio": tuple(0.182 * (1 + 1.1 * 0.35**steps)),
                "delay": tuple(DELAY_S * (1 - 0.9 * 0.3**steps)),
            },
        ),
        weights=WEIGHTS,
        uncertainty={"covers": ["noise", "gain", "phase"]},
    )


def adam():
    """The same with 1500 steps of Adam."""
    n = np.arange(1500)
    trace = {
        "sensitivity": tuple(S0 * (1 + 0.2 * np.exp(-n / 150) * np.cos(n / 60))),
        "natural_frequency": tuple(652 * (1 - 0.2 * np.exp(-n / 300))),
        "damping_ratio": tuple(0.182 * (1 + 2.0 * np.exp(-n / 250))),
    }
    loss = tuple(0.3 * np.exp(-n / 120) + 2e-5 * (1 + 0.3 * np.sin(n / 7)))
    return replace(table2(), estimator="ipnn", training=Training("adam", "step limit", 1500, loss, trace))


def troubled():
    """Every contracted warning at once, a parameter at its bound and one not identifiable."""
    result = table2(codes=WARNING_CODES)
    parameters = {
        **result.parameters,
        "highpass_frequency": Parameter(0.0213, "Hz", None, (None, 0.31), identifiable=False),
        "cubic_stiffness": Parameter(-3.2e-9, "1/V^2", 4.1e-8, (None, None), identifiable=False),
    }
    return replace(result, parameters=parameters)


def table_only():
    """From a tabulated magnitude: no phase, no signals, no training, no weights; half the points without u."""
    f = np.array(THIRD_OCTAVES)
    full = table2(3)
    u = tuple(v if i % 2 else None for i, v in enumerate(full.measured.magnitude_uncertainty))
    nothing = (None,) * len(f)
    measured = replace(
        full.measured,
        phase_deg=nothing,
        phase_deg_uncertainty=nothing,
        deviation_phase_deg=nothing,
        magnitude_uncertainty=u,
        record=("frf.csv",) * len(f),
    )
    blank = (None,) * len(full.response.frequency_hz)
    response = replace(full.response, phase_deg=blank, phase_deg_uncertainty=blank)
    return replace(
        full,
        model="accelerometer",
        estimator="lsm",
        measured=measured,
        response=response,
        signals=(),
        training=None,
        weights={},
    )


def pickup():
    """A geophone-like velocity pickup, δ = 0.71, natural frequency 0.475 Hz, negative generator constant."""
    f = np.geomspace(0.05, 40, 30)
    dense = np.geomspace(0.02, 100, 150)
    full = table2(5)
    parameters = {
        "generator_constant": _parameter(-27.73, "V/(m/s)", 0.041),
        "natural_frequency": _parameter(0.47512, "Hz", 0.00031),
        "damping_ratio": _parameter(0.7104, "1", 0.0008),
        "natural_angular_frequency": _parameter(2.98527, "rad/s", 0.0019, derived=True),
    }
    return replace(
        full,
        model="velocity-pickup",
        estimator="ml",
        parameters=parameters,
        correlation=Correlation(tuple(parameters)[:3], tuple(tuple(row) for row in np.eye(3).tolist())),
        response=_curve(dense, velocity_pickup(dense), 0.0015 * np.ones_like(dense)),
        measured=_measured(f, velocity_pickup(f), 0.004 * np.ones_like(f), 5),
        sensor={"type": "GS-1", "serial_number": "$1 & $2 | 振动传感器 with a serial number of remarkable length"},
        reference={"quantity": "velocity", "unit": "m/s"},
        sensitivity_per={"quantity": "velocity", "unit": "m/s"},
        signals=(),
        training=None,
        weights={},
    )


def dense_points(points=4000):
    """Thousands of measured points, as from a sweep."""
    f = np.geomspace(10, 2000, points)
    result = table2(7)
    return replace(
        result,
        measured=_measured(f, accelerometer(f), 0.003 * np.ones_like(f), 7, ["sweep.wav"] * points),
        signals=(replace(result.signals[0], record="sweep.wav"),),
    )


def single_point():
    """One frequency, magnitude tiny, uncertainty larger than the value."""
    curve = Curve((159.15,), (1.2e-11,), (-178.0,), (None,), (None,))
    measured = MeasuredCurve((159.15,), (1.21e-11,), (179.0,), (2e-11,), (3.0,), (-0.83,), (-357.0,), ("a",))
    return replace(table2(), response=curve, measured=measured, signals=(), training=None, response_unit="C")


def nothing_measured():
    """No points, no signals, an empty curve, every number that may be None is None."""
    result = table2()
    parameters = {name: Parameter(p.value, p.unit, None, (None, None)) for name, p in result.parameters.items()}
    return replace(
        result,
        parameters=parameters,
        correlation=Correlation((), ()),
        fit=Fit(0.0, 0.0, 0.0, 1.0, float("inf"), 0.0, None, 0, True),
        response=Curve((), (), (), (), ()),
        measured=MeasuredCurve((), (), (), (), ()),
        sensor={},
        reference={},
        sensitivity_per={},
        signals=(),
        training=Training("none", "no iterations", 0, ()),
        weights={},
    )


def exact():
    """Noise-free: deviations at rounding level, huge magnitudes in counts, one signal without residual."""
    f = np.array(THIRD_OCTAVES[:6])
    s = 3e12 * accelerometer(f) / S0
    curve = _curve(f, s, np.zeros_like(f))
    measured = MeasuredCurve(
        curve.frequency_hz,
        curve.magnitude,
        curve.phase_deg,
        (None,) * 6,
        (None,) * 6,
        (1e-13, -2e-13, 0.0, 1e-13, 0.0, 2e-13),
        (0.0,) * 6,
        ("one",) * 6,
    )
    t = np.arange(40) / 1000
    signal = excerpt("one", t, np.sin(t), np.sin(t), "count")
    return replace(table2(), response=curve, measured=measured, signals=(signal,), response_unit="count")


def multisine():
    """Two long records that hold many frequencies each."""
    result = table2(9)
    t = np.arange(6000) / 51200
    signals = []
    for k, name in enumerate(("multisine_up.h5", "multisine_down.h5")):
        y = sum(
            np.real(accelerometer(hz) * 3 * np.exp(2j * np.pi * (hz * t + 0.37 * i * i + k)))
            for i, hz in enumerate(THIRD_OCTAVES)
        )
        e = 0.002 * np.random.default_rng(k).normal(size=t.size)
        signals.append(excerpt(name, t, y + e, y, "V", 0.002, 0.002 / float(np.std(y))))
    names = tuple(s.record for s in signals)
    measured = replace(result.measured, record=tuple(names[i % 2] for i in range(21)))
    return replace(result, signals=tuple(signals), measured=measured)


SAMPLES = {
    make.__name__: make
    for make in (
        table2,
        adam,
        troubled,
        table_only,
        pickup,
        dense_points,
        single_point,
        nothing_measured,
        exact,
        multisine,
    )
}


def calibration_records():
    """Eight sine records, one of them clipped, one with a short drop-out; one without stated frequency; one decay."""
    rng = np.random.default_rng(2)
    records = []
    for i, hz in enumerate((10.0, 31.5, 80.0, 160.0, 315.0, 500.0, 800.0, 1000.0)):
        t = np.arange(10240) / 51200
        a = 9.81 * np.cos(2 * np.pi * hz * t)
        y = np.real(accelerometer(hz) * 9.81 * np.exp(2j * np.pi * hz * t)) + 0.01 * rng.normal(size=t.size)
        valid = np.ones(t.size, dtype=bool)
        if i == 5:
            valid = np.abs(y) < 0.93 * np.abs(y).max()
            y = np.clip(y, -0.93 * np.abs(y).max(), 0.93 * np.abs(y).max())
        if i == 3:
            valid[4000:4040] = False
        stated = None if i == 2 else hz
        records.append(Record(f"shaker_{hz:g}.csv", a, y, 51200.0, "sine", stated, valid))
    return Calibration(
        records=tuple(records), model="accelerometer+delay", sensor={"type": "MSV 3000", "serial_number": "4711"}
    )


def calibration_mixed():
    """A shock with its response, and a free decay without reference."""
    t = np.arange(20000) / 51200
    shock = 500 * np.exp(-(((t - 0.02) / 0.0008) ** 2))
    ring = 40 * np.exp(-0.182 * 4096 * t) * np.sin(4030 * t)
    return Calibration(
        records=(
            Record("shock.wav", shock, np.convolve(shock, ring[:500])[: t.size] * 2e-4, 51200.0, "shock"),
            Record("decay.wav", None, 0.02 * np.exp(-60 * t) * np.cos(4000 * t), 51200.0, "decay"),
        ),
    )


def calibration_table(phase=True, uncertainty=True):
    """A tabulated response."""
    f = np.array(THIRD_OCTAVES)
    s = accelerometer(f)
    return Calibration(
        table=ResponseTable(
            f,
            abs(s),
            np.angle(s) if phase else None,
            0.004 * abs(s) if uncertainty else None,
            np.full(21, 0.01) if phase and uncertainty else None,
        ),
        sensor={"type": "MSV 3000"},
    )


CALIBRATIONS = {
    "records": calibration_records,
    "mixed": calibration_mixed,
    "table": calibration_table,
    "table_magnitude": lambda: calibration_table(phase=False),
    "table_bare": lambda: calibration_table(phase=False, uncertainty=False),
}
