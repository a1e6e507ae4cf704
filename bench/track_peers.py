"""The tracker beside RecursiveLS and an extended Kalman filter, on the same state space.

The same records and inputs of the cell for all; the tracker's start values for the Kalman filter,
which is told the true noise, and for the linearised network. MATLAB cannot be run here.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from tests.support.random_record import RATE_HZ, TRUTH
from tests.support.tracked import ACCELEROMETER, fed, record, tracker

from bench.against import ENVIRONMENTS, ask
from bench.figures import Figure, Options, Section, steps
from vibrident.data.records import FloatArray
from vibrident.use.tracking.network import LinearisedCell, SensorNetwork

RUNS = 60
SAMPLES = 8000
NOISE = 0.01
START_U = 0.05
#: Samples by which the sensor has forgotten its state: columns of it make RecursiveLS lose its
#: digits.
SETTLED = 400
NAMES = tuple(TRUTH)
PEERS = {
    "statsmodels": {
        "arx": "RecursiveLS on past responses",
        "linearised": "RecursiveLS on the linearised network",
    },
    "filterpy": {"ekf": "extended Kalman filter, told the true noise"},
}


def measure(options: Options) -> Section:
    """Error, coverage and time a sample."""
    runs = 3 if options.quick else RUNS
    network = SensorNetwork.from_start_values(ACCELEROMETER, TRUTH, "acceleration", 1.0 / RATE_HZ)
    truth = np.array(list(TRUTH.values()))
    rows = []
    begin = 0.0
    steps_taken = 0
    ours: list[tuple[FloatArray, FloatArray]] = []
    for seed in steps("trackers", range(runs)):
        rng = np.random.default_rng(seed)
        u, y = record("random", SAMPLES, rng, NOISE)
        tracker_ = tracker(rng, u=START_U)
        start = tracker_.state.point[network.nuisances :] * tracker_.network.scale
        first = network.first
        count = len(u) - network.taps + 1
        inputs = network.inputs(u, count)
        response = y[-first : count - first]
        out, _ = LinearisedCell.at_point(tracker_.network, np.ones(3)).run(
            tracker_.state.cell, inputs
        )
        columns = np.insert(out[:, 1 + network.order :], 0, 1.0, axis=1)  # the offset's
        noise = NOISE * np.std(y) / np.hypot(1.0, NOISE)
        more = response - out[:, 0]
        rows.append((inputs, response, columns[SETTLED:], more[SETTLED:], start, noise))
        begin -= time.process_time()
        estimate = fed(tracker_, u, y).read()
        begin += time.process_time()
        steps_taken += len(y)
        ours.append((_array(estimate.values), _array(estimate.uncertainty)))
    labels = ("inputs", "response", "columns", "more", "start", "noise")
    arrays: dict[str, Any] = {
        name: np.array(array) for name, array in zip(labels, zip(*rows, strict=True), strict=True)
    }
    arrays |= {"interval_s": 1.0 / RATE_HZ, "relative_u": START_U}
    values, u = (np.array(array) for array in zip(*ours, strict=True))
    size = np.sqrt(np.mean((values - truth) ** 2, axis=0))
    figures = [_covered("vibrident track", values, u, truth)]
    microseconds = {"vibrident": begin / steps_taken * 1e6}
    versions = {}
    for name, words in PEERS.items():
        python = ENVIRONMENTS / name / "bin" / "python"
        if not python.exists():
            figures.append(
                Figure(name, {}, note="left out: no environment; `make bench-peers` makes it")
            )
            continue
        answer = ask(python, f"{name}_peer.py", arrays)
        versions[name] = answer["versions"]
        for kind, what in words.items():
            values = np.array(answer[kind]["values"])
            u = np.array(answer[kind]["uncertainties"])
            error = np.sqrt(np.mean((values - truth) ** 2, axis=0)) / size
            figures.append(Figure(f"{name}, {what}: rms error over ours", _named(error)))
            figures.append(_covered(f"{name}, {what}", values, u, truth))
            microseconds[f"{name}, {kind}"] = answer[kind]["seconds"] * 1e6
    times = " · ".join(microseconds)
    figures.append(Figure("microseconds a sample, in Python", microseconds, "plain", note=times))
    title = f"Trackers: random motion, 1 % noise, {SAMPLES} samples; {' · '.join(NAMES)}"
    remarks = (
        "All get the same inputs of the network's cell, and the state space is that of the cell; "
        "start values off by 2 %. Regressed on past responses, RecursiveLS minimises the error of "
        "an equation whose columns hold the response's noise; linearised, it stays at the start "
        "values' slopes. Intervals are values ± 1.96 u. MATLAB's recursiveOE is documented to "
        "give polynomial coefficients of an output-error model; it cannot be run here.",
    )
    return Section(
        "track_peers", title, tuple(figures), {"runs": runs, "versions": versions}, remarks
    )


def _array(values: Any) -> FloatArray:
    return np.array([values[name] for name in NAMES])


def _named(values: FloatArray) -> dict[str, float]:
    return dict(zip(NAMES, values.tolist(), strict=True))


def _covered(name: str, values: FloatArray, u: FloatArray, truth: FloatArray) -> Figure:
    held = np.mean(np.abs(values - truth) < 1.96 * u, axis=0)
    return Figure(f"{name}: coverage of 95 % intervals", _named(held), "percent")
