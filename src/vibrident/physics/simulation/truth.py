"""Exact response of a sensor, and exact motion that the reference measures, at sample times.

Sums of tones: steady response through the frequency response, plus the free motion that satisfies
the initial condition. Half-sine shock: sensor and sine generator together are one autonomous linear
system, solved by its exponential. Everything else: quadrature to 1e-12
(:mod:`vibrident.physics.simulation.linear`). Cubic stiffness: its part of the response, integrated
(:mod:`vibrident.physics.simulation.cubic`). An average over a window: the difference of the
response's integral at the window's ends.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np

from vibrident.data.records import FloatArray, Quantity
from vibrident.physics.models import SensorModel
from vibrident.physics.models.base import DERIVATIVES, Rational
from vibrident.physics.simulation.checks import require
from vibrident.physics.simulation.excitation import Decay, HalfSineShock
from vibrident.physics.simulation.linear import LinearSystem, driven_states, exponential, propagate
from vibrident.physics.simulation.motion import (
    Motion,
    SampleGrid,
    Superposition,
    Tonal,
    acceleration_on,
)

#: ``rest``: mass and base at rest until t = 0. ``steady``: tones without beginning. Shocks, sweeps
#: and decays begin at or after t = 0; for them the two are the same.
Start = Literal["rest", "steady"]


def exact_response(
    model: SensorModel,
    parameters: Mapping[str, float],
    motion: Motion,
    *,
    sampling_rate_hz: float,
    samples: int,
    start: Start = "rest",
) -> FloatArray:
    """Return the response of the sensor at t = k / sampling_rate_hz, shape (samples,).

    A delay τ gives the response of t − τ; before the start that is zero (``rest``), the tones'
    earlier part (``steady``) or the held value (``Decay``).

    ``parameters``: name to value, SI units, frequencies in Hz; ``motion``: acceleration of the
    base; ``start``: state of the sensor at t = 0.

    Raises:
        ModelError: the response would contain derivatives of the acceleration.
        InputError: an undamped sensor is excited at its natural frequency, or the motion is too
            rough.
    """
    require(
        model.core.factor is None,
        "A response that is no ratio of polynomials cannot be simulated.",
        expected="a model of a ratio of polynomials in s",
        found=repr(model.name),
        where="simulate",
        remedy="simulate it by sums of sines",
    )
    grid = SampleGrid(-float(model.delay_s(parameters)), sampling_rate_hz, samples)
    if not model.has_network:
        return _averaged(model, parameters, motion, grid, start)
    system = LinearSystem.from_rational(model.rational(parameters))
    if not model.is_linear:
        from vibrident.physics.simulation.cubic import cubic_response  # loads JAX

        return cubic_response(
            lambda instants: system_response(system, motion, instants, start),
            parameters,
            grid,
            highest_hz=motion.highest_hz,
            forever=start == "steady" and _has_tones(motion),
            # The response to a static value that is released at t = 0.
            static_value=float(system.c @ system.static_state(motion.amplitude))
            if isinstance(motion, Decay)
            else None,
        )
    return system_response(system, motion, grid, start)


def _averaged(
    model: SensorModel,
    parameters: Mapping[str, float],
    motion: Motion,
    grid: SampleGrid,
    start: Start,
) -> FloatArray:
    """Return the mean of the response over the window that ends at each instant (``boxcar``)."""
    require(
        not isinstance(motion, Decay) and model.is_linear,
        "A boxcar needs a linear core, and motion that begins at or after t = 0.",
        expected="an excitation other than 'decay', and a model without 'cubic'",
        found=f"{motion.kind!r} with {model.name!r}",
        where="simulate",
        remedy="leave the boxcar or the decay out",
    )
    (window,) = model.windows
    length = float(parameters[window])
    rational = model.rational(parameters)
    integral = LinearSystem.from_rational(
        replace(rational, denominator=(0.0, *rational.denominator))
    )
    early = replace(grid, start_s=grid.start_s - length)
    end, begin = (system_response(integral, motion, instants, start) for instants in (grid, early))
    return (end - begin) / length


def _has_tones(motion: Motion) -> bool:
    return isinstance(motion, Tonal) or any(
        _has_tones(term) for term in getattr(motion, "terms", ())
    )


def exact_reference(
    motion: Motion, quantity: Quantity, *, sampling_rate_hz: float, samples: int
) -> FloatArray:
    """Return the output of an ideal reference at t = k / sampling_rate_hz, shape (samples,).

    It is in SI units of ``quantity``.

    Velocity and displacement of tones are the steady ones (no constant, no trend); of anything else
    they are integrated from rest at t = 0. A drive is the acceleration.
    """
    return _integrated(motion, DERIVATIVES[quantity], SampleGrid(0.0, sampling_rate_hz, samples))


def displacement_on(motion: Motion, grid: SampleGrid) -> FloatArray:
    """Return the displacement on a grid, m, shape (samples,); see :func:`exact_reference`."""
    return _integrated(motion, 2, grid)


def system_response(
    system: LinearSystem, motion: Motion, grid: SampleGrid, start: Start
) -> FloatArray:
    """Return the output of a linear system on a grid, shape (samples,); see ``exact_response``."""
    if isinstance(motion, Superposition):
        tonal = [term for term in motion.terms if isinstance(term, Tonal)]
        transients = [term for term in motion.terms if not isinstance(term, Tonal)]
        total = _tonal_response(system, tonal, grid, start)
        return np.sum(
            [total, *(system_response(system, term, grid, start) for term in transients)], axis=0
        )
    if isinstance(motion, Tonal):
        return _tonal_response(system, [motion], grid, start)
    if isinstance(motion, Decay):
        static_state = system.static_state(motion.amplitude)
        free = system.c @ propagate(system.a, static_state, grid.since(0.0))
        return np.concatenate([np.full(grid.first_from(0.0), system.c @ static_state), free])
    if isinstance(motion, HalfSineShock):
        states = _shock_states(system, motion, grid)
    else:
        before = np.zeros((system.order, grid.first_from(0.0)))
        states = np.concatenate([before, driven_states(system, motion, grid.since(0.0))], axis=1)
    direct = system.d * motion.value(grid.times_s) if system.d else 0.0
    return system.c @ states + direct


def _tonal_response(
    system: LinearSystem, tonal: Sequence[Tonal], grid: SampleGrid, start: Start
) -> FloatArray:
    """Return the steady response to tones.

    From rest there is also the free motion that makes the state zero at t = 0.
    """
    steady = np.zeros(grid.samples)
    missing = np.zeros(system.order)
    for tones in (term.tones for term in tonal):
        states = system.tone_states(tones.frequency_hz)
        response = np.sum(system.c[:, None] * states, axis=0) + system.d
        steady += tones.scaled_by(response).on(grid)
        missing -= np.sum(states * tones.phasor, axis=1).real
    if start == "steady":
        return steady
    first = grid.first_from(0.0)
    free = system.c @ propagate(system.a, missing, grid.since(0.0))
    return np.concatenate([np.zeros(first), steady[first:] + free])


def initial_state(system: LinearSystem, motion: Motion, time_s: float, start: Start) -> FloatArray:
    """Return the state at an instant at or before t = 0, shape (n,).

    It is zero, except for tones without beginning (``steady``) and for a decay, which is held
    until t = 0.
    """
    if isinstance(motion, Superposition):
        return np.sum([initial_state(system, term, time_s, start) for term in motion.terms], axis=0)
    if isinstance(motion, Tonal) and start == "steady":
        tones = motion.tones
        phasor = tones.phasor * np.exp(2j * np.pi * tones.frequency_hz * time_s)
        return (system.tone_states(tones.frequency_hz) @ phasor).real
    return (
        system.static_state(motion.amplitude)
        if isinstance(motion, Decay)
        else np.zeros(system.order)
    )


def _shock_states(system: LinearSystem, shock: HalfSineShock, grid: SampleGrid) -> FloatArray:
    """Return the states before, during and after the pulse, shape (n, samples).

    During the pulse the input is peak · s with ṡ = ω c, ċ = −ω s: n + 2 states and no input.
    """
    n = system.order
    omega = np.pi / shock.duration_s
    joint = np.zeros((n + 2, n + 2))
    joint[:n, :n] = system.a
    joint[:n, n] = system.b * shock.peak
    joint[n, n + 1] = omega
    joint[n + 1, n] = -omega
    begin = np.zeros(n + 2)
    begin[-1] = 1.0
    after = grid.since(shock.start_s + shock.duration_s)
    pulse = grid.since(shock.start_s)
    during = SampleGrid(pulse.start_s, grid.rate_hz, pulse.samples - after.samples)
    end = (exponential(joint, shock.duration_s) @ begin)[:n]
    return np.concatenate(
        [
            np.zeros((n, grid.samples - pulse.samples)),
            propagate(joint, begin, during)[:n],
            propagate(system.a, end, after),
        ],
        axis=1,
    )


def _integrated(motion: Motion, times: int, grid: SampleGrid) -> FloatArray:
    if times == 0:
        return acceleration_on(motion, grid)
    if isinstance(motion, Superposition):
        return np.sum([_integrated(term, times, grid) for term in motion.terms], axis=0)
    if isinstance(motion, Tonal):
        once = np.asarray(1.0 / (2j * np.pi * motion.tones.frequency_hz), dtype=np.complex128)
        return motion.tones.scaled_by(once if times == 1 else once * once).on(grid)
    if isinstance(motion, Decay):
        return np.zeros(grid.samples)
    integrator = LinearSystem.from_rational(Rational(1.0, (1.0,), (0.0,) * times + (1.0,), 1.0))
    return system_response(integrator, motion, grid, "rest")
