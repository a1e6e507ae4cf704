"""Response of a sensor with cubic stiffness: the nonlinear part, by Runge–Kutta.

With V = V_lin + W, V_lin the exact response of the linear sensor,

    Ẅ + 2 δ ωn Ẇ + ωn² W = −ωn² k3 (V_lin + W)³,

integrated by SciPy's DOP853 (Hairer, Nørsett & Wanner 1993, II.5) with a fixed step. V_lin is
smoother than the acceleration by two derivatives, so corners of a shock do no harm. Steps, method
and unknowns are independent of the network's.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import numpy as np
from scipy.integrate import DOP853

from vibrident.base.backend import jax, jnp, lax
from vibrident.data.records import FloatArray
from vibrident.physics.simulation.checks import require
from vibrident.physics.simulation.motion import SampleGrid

Linear = Callable[[SampleGrid], FloatArray]

#: Largest phase of the fastest motion in a step, rad.
MAX_STEP_PHASE_RAD = 0.15
#: Part to which the free motion decays before a steady state counts as reached.
MAX_FREE_MOTION = 1e-14

#: Stages of DOP853: instants in the step, and weights of the slopes before each stage and at the
#: end.
NODES = tuple(DOP853.C.tolist())
_A = tuple(tuple(row[:i]) for i, row in enumerate(DOP853.A.tolist()))
_B = tuple(DOP853.B.tolist())


def cubic_response(
    linear: Linear,
    parameters: Mapping[str, float],
    grid: SampleGrid,
    *,
    highest_hz: float,
    forever: bool,
    static_value: float | None,
) -> FloatArray:
    """Return the response V on a grid, shape (samples,).

    ``linear``: exact response of the linear sensor on any grid; ``grid``: instants; before t = 0
    the sensor is at rest, held, or in its steady motion; ``highest_hz``: of the motion;
    ``forever``: whether it has no beginning; ``static_value``: linear response to a value
    that is released at t = 0; None if absent.

    Raises:
        InputError: the softening spring becomes unstable, or an undamped sensor has no steady
            motion.
    """
    k3 = float(parameters["cubic_stiffness"])
    wn = 2.0 * math.pi * float(parameters["natural_frequency"])
    damping = float(parameters["damping_ratio"])
    static = _static(k3, static_value) if static_value is not None else 0.0
    begin_s = min(grid.start_s, 0.0) - _decay_time_s(wn, damping) if forever else 0.0
    after = grid if forever else grid.since(0.0)
    if not after.samples:
        return np.full(grid.samples, static)
    largest = max(float(np.max(np.abs(linear(after)))), abs(static))
    fastest = max(wn * math.sqrt(1.0 + 3.0 * abs(k3) * largest**2), 2.0 * math.pi * highest_hz)
    substeps = max(1, math.ceil(fastest * grid.interval_s / MAX_STEP_PHASE_RAD))
    first_s = after.start_s
    # Whole steps up to the first sample.
    lead = math.ceil((first_s - begin_s) * grid.rate_hz * substeps)
    state = np.array([static - static_value if static_value is not None else 0.0, 0.0])
    if lead:
        step = (first_s - begin_s) / lead
        state = _states(linear, state, begin_s, step, lead, (k3, wn, damping))[:, -1]
    fine = substeps * (after.samples - 1)
    nonlinear = state[:, None]
    if fine:
        nonlinear = _states(
            linear, state, first_s, grid.interval_s / substeps, fine, (k3, wn, damping)
        )[:, ::substeps]
    response = linear(SampleGrid(first_s, grid.rate_hz, after.samples)) + nonlinear[0]
    require(
        bool(np.all(np.isfinite(response))) and float(np.max(np.abs(response))) < 1e3 * largest,
        "The motion makes the softening spring unstable: the response diverges.",
        expected=f"|V| below {1.0 / math.sqrt(abs(k3)) if k3 else math.inf:.3g}, "
        "where the spring force is zero",
        found=f"k3 = {k3:g}, linear response {largest:.3g}",
        where="simulate, cubic_stiffness",
        remedy="lower the amplitude, or |cubic_stiffness|",
    )
    return np.concatenate([np.full(grid.samples - after.samples, static), response])


def _static(k3: float, linear: float) -> float:
    """Return V with V + k3 V³ = ``linear``, on the branch through zero."""
    coefficients = [k3, 0.0, 1.0, -linear] if k3 else [1.0, -linear]
    roots = np.asarray(np.roots(coefficients), dtype=np.complex128)
    real = roots.real[np.abs(roots.imag) <= 1e-9 * (1.0 + np.abs(roots))]
    near = real[1.0 + 3.0 * k3 * real**2 > 0.0]
    require(
        near.size > 0,
        "A softening spring does not hold this static value.",
        expected="a linear response below "
        f"{2.0 / math.sqrt(27.0 * abs(k3)) if k3 else math.inf:.3g}",
        found=f"{linear:.3g}",
        where="simulate, cubic_stiffness",
        remedy="lower the amplitude, or |cubic_stiffness|",
    )
    return float(near[np.argmin(np.abs(near))])


def _decay_time_s(wn: float, damping: float) -> float:
    """Return the time in which the free motion decays, s."""
    slowest = damping if damping < 1.0 else 1.0 / (damping + math.sqrt(damping * damping - 1.0))
    require(
        slowest > 0.0,
        "An undamped sensor has no steady motion of its own.",
        expected="a damping above 0, or the start from rest",
        found="damping 0",
        where="simulate",
        remedy="give the sensor some damping",
    )
    return -math.log(MAX_FREE_MOTION) / (slowest * wn)


def _states(
    linear: Linear,
    first: FloatArray,
    begin_s: float,
    step_s: float,
    steps: int,
    sensor: tuple[float, float, float],
) -> FloatArray:
    """Return W and Ẇ/ωn after every step, shape (2, steps + 1)."""
    rate = 1.0 / step_s
    drive = np.stack(
        [linear(SampleGrid(begin_s + fraction * step_s, rate, steps)) for fraction in NODES],
        axis=1,
    )
    states = _integrated(jnp.asarray(first), jnp.asarray(drive), step_s * sensor[1], *sensor)
    return np.asarray(states).T


@jax.jit
def _integrated(
    first: jax.Array, drive: jax.Array, angle: float, k3: float, wn: float, damping: float
) -> jax.Array:
    """Return the states after every step, shape (steps + 1, 2).

    Time is in units of 1/ωn; a step is ``angle``.
    """

    def slope(w: jax.Array, rate: jax.Array, linear: jax.Array) -> tuple[jax.Array, jax.Array]:
        response = linear + w
        return rate, -2.0 * damping * rate - w - k3 * response * response * response

    def step(
        state: tuple[jax.Array, jax.Array], v: jax.Array
    ) -> tuple[tuple[jax.Array, jax.Array], jax.Array]:
        slopes: list[tuple[jax.Array, jax.Array]] = []
        for row, linear in zip(_A, v, strict=True):
            at = [
                x
                + angle
                * sum(
                    (a * s[i] for a, s in zip(row, slopes, strict=True) if a), start=jnp.zeros(())
                )
                for i, x in enumerate(state)
            ]
            slopes.append(slope(at[0], at[1], linear))
        moved = [
            x + angle * sum(b * s[i] for b, s in zip(_B, slopes, strict=True) if b)
            for i, x in enumerate(state)
        ]
        return (moved[0], moved[1]), jnp.stack(moved)

    _, states = lax.scan(step, (first[0], first[1]), drive)
    return jnp.concatenate([first[None], states])
