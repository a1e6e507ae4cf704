"""Classical Runge–Kutta method (Kutta 1901) at a fixed step.

The paper simulates the sensor so (section 4). All records advance together; the excitation is taken
at its exact values at the begin, middle and end of every step.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from vibrident.base.errors import ModelError
from vibrident.data.records import FloatArray
from vibrident.physics.models import SensorModel
from vibrident.physics.simulation.checks import require, require_usable
from vibrident.physics.simulation.excitation import Decay
from vibrident.physics.simulation.linear import LinearSystem
from vibrident.physics.simulation.motion import Motion, SampleGrid, acceleration_on
from vibrident.physics.simulation.truth import Start, initial_state

Derivative = Callable[[FloatArray, FloatArray], FloatArray]


def rk4_response(
    model: SensorModel,
    parameters: Mapping[str, float],
    motions: Sequence[Motion],
    *,
    sampling_rates_hz: Sequence[float],
    samples: int,
    start: Start = "rest",
    substeps: int = 1,
) -> FloatArray:
    """Return the response of a sensor to many motions, by RK4, shape (records, samples).

    ``parameters``: name to value, SI units, frequencies in Hz; ``motions``: acceleration of the
    base, one a record, with ``sampling_rates_hz``; ``samples``: of every record; ``start``: as for
    ``exact_response``; ``substeps``: steps a sample.

    Raises:
        InputError: the method diverges at this step, or ``substeps`` is below 1.
        ModelError: the sensor is not linear.
    """
    require_usable(substeps >= 1, "substeps", substeps, "a whole number from 1", "simulate")
    if not (model.is_linear and model.has_network):
        raise ModelError(
            "Runge–Kutta of fourth order simulates linear sensors that are rational up to a delay.",
            expected="method 'exact' for this model",
            found=f"method 'rk4' with {model.name!r}",
            where="simulate",
            remedy="leave the method at its default",
        )
    system = LinearSystem.from_rational(model.rational(parameters))
    delay = float(model.delay_s(parameters))
    grids = [SampleGrid(-delay, rate, samples) for rate in sampling_rates_hz]
    for rate in set(sampling_rates_hz):
        _refuse_divergence(system, 1.0 / (rate * substeps))
    runs = [
        _begin(system, motion, grid, start, substeps)
        for motion, grid in zip(motions, grids, strict=True)
    ]
    fine = 2 * substeps * (samples - 1) + 1
    drive = np.stack(
        [
            acceleration_on(motion, SampleGrid(run.origin_s, 2 * substeps * grid.rate_hz, fine))
            for motion, grid, run in zip(motions, grids, runs, strict=True)
        ]
    )
    step = np.array([1.0 / (substeps * rate) for rate in sampling_rates_hz])
    first = np.stack([run.state for run in runs], axis=1)
    states = classical_rk4(_derivative(system), first, drive, step)[:, ::substeps]
    response = np.tensordot(system.c, states, axes=1).T + system.d * drive[:, :: 2 * substeps]
    late = [np.full(run.held_samples, run.static) for run in runs]
    return np.stack(
        [
            np.concatenate([before, row])[:samples]
            for before, row in zip(late, response, strict=True)
        ]
    )


class _Run(NamedTuple):
    """Begin of a record's integration: first instant, the state there, the samples before it."""

    origin_s: float
    state: FloatArray
    static: float
    held_samples: int


def _begin(
    system: LinearSystem, motion: Motion, grid: SampleGrid, start: Start, substeps: int
) -> _Run:
    """Integrate from the instant where the state is known to the first sample after it.

    The steps are at most the usual one.
    """
    known_s = min(grid.start_s, 0.0) if start == "steady" and not isinstance(motion, Decay) else 0.0
    state = initial_state(system, motion, known_s, start)
    static = float(system.c @ state)
    way = grid.since(known_s).start_s
    steps = math.ceil(way * grid.rate_hz * substeps)
    if steps:
        drive = acceleration_on(motion, SampleGrid(known_s, 2 * steps / way, 2 * steps + 1))
        state = classical_rk4(
            _derivative(system), state[:, None], drive[None], np.array([way / steps])
        )[:, -1, 0]
    return _Run(known_s + way, state, static, grid.first_from(known_s))


def classical_rk4(
    derivative: Derivative, first: FloatArray, drive: FloatArray, step_s: FloatArray
) -> FloatArray:
    """Return the states after every step, shape (n, steps + 1, records).

    ``derivative``: (state (n, records), drive (records,)) → dstate/dt (n, records); ``first``:
    initial states, shape (n, records); ``drive``: input at the begin, middle and end of every step,
    shape (records, 2 · steps + 1); ``step_s``: step of every record, s, shape (records,).
    """
    steps = (drive.shape[1] - 1) // 2
    states = np.empty((first.shape[0], steps + 1, first.shape[1]))
    states[:, 0] = state = first
    inputs = np.ascontiguousarray(drive.T)
    half = 0.5 * step_s
    sixth = step_s / 6.0
    for k in range(steps):
        begin = inputs[2 * k]
        middle = inputs[2 * k + 1]
        end = inputs[2 * k + 2]
        k1 = derivative(state, begin)
        k2 = derivative(state + half * k1, middle)
        k3 = derivative(state + half * k2, middle)
        k4 = derivative(state + step_s * k3, end)
        state = state + sixth * (k1 + 2.0 * (k2 + k3) + k4)
        states[:, k + 1] = state
    return states


def _derivative(system: LinearSystem) -> Derivative:
    """Return the derivative of a system's states."""
    a = system.a
    b = system.b[:, None]
    return lambda state, drive: a @ state + b * drive


def _refuse_divergence(system: LinearSystem, step_s: float) -> None:
    """Raise InputError where the method diverges at a step."""
    z = np.linalg.eigvals(system.a) * step_s
    growth = float(np.max(np.abs(1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0))))))
    require(
        growth <= 1.0 + 1e-9,
        "Runge–Kutta diverges at this step.",
        expected="a growth factor of at most 1 a step",
        found=f"{growth:.3g} at a step of {step_s:.3g} s",
        where="simulate, method 'rk4'",
        remedy="raise substeps or sampling_rate_hz, or use method 'exact'",
    )
