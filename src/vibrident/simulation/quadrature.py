"""States under an acceleration that is known by its values: Gauss–Legendre quadrature with exact exponentials.

    x(t + h) = e^{A h} x(t) + ∫₀^h e^{A (h − τ)} b a(t + τ) dτ

The integral of every step is refined until the response no longer changes. Steps that hold a break of the
acceleration are split there, so that every integrand is smooth.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.polynomial import legendre

from vibrident.errors import InputError
from vibrident.records import FloatArray
from vibrident.simulation.grid import SampleGrid
from vibrident.simulation.linear import LinearSystem, accumulate, exponential
from vibrident.simulation.motion import Motion

TOLERANCE = 1e-12  # change of the response, relative to its largest value, at which refinement stops
_NODES = (6, 9, 14, 21, 32, 48)  # nodes a panel, tried in turn
_PANEL_RATE = 8.0  # largest |λ| times panel length, λ the sensor's fastest pole


def driven_states(system: LinearSystem, motion: Motion, grid: SampleGrid) -> FloatArray:
    """States from rest at t = 0 under ``motion``, at the instants of a grid that starts at or after 0; (n, samples).

    Raises:
        InputError: the acceleration is too rough between samples for the quadrature to settle.
    """
    if not grid.samples:
        return np.zeros((system.order, 0))
    last_s = grid.start_s + grid.samples * grid.interval_s
    # An instant t is known to ε t, a phase at the fastest rate therefore to ω ε t: no refinement beats that.
    fastest = max(2.0 * math.pi * motion.highest_hz, system.fastest)
    tolerance = TOLERANCE + 4.0 * fastest * last_s * float(np.finfo(float).eps)
    previous = _states(system, motion, grid, _NODES[0])
    change = math.inf
    for nodes in _NODES[1:]:
        states = _states(system, motion, grid, nodes)
        largest = float(np.max(np.abs(system.c @ states)))
        change = float(np.max(np.abs(system.c @ (states - previous)))) / (largest or 1.0)
        if change <= tolerance:
            return states
        previous = states
    raise InputError(
        "The excitation is too rough between samples for an exact response.",
        expected=f"a change below {tolerance:.1e} of the largest response on refinement",
        found=f"{change:.1e} with {_NODES[-1]} nodes a step",
        where=f"excitation {motion.words!r}",
        remedy="raise the sampling rate, or list the instants where the excitation is not smooth in breaks_s",
    )


def _states(system: LinearSystem, motion: Motion, grid: SampleGrid, nodes: int) -> FloatArray:
    times = grid.times_s
    steps = np.zeros((system.order, grid.samples))
    steps[:, 0] = _integral(system, motion, 0.0, grid.start_s, nodes)
    offsets, vectors = _rule(system, grid.interval_s, nodes)
    for offset, vector in zip(offsets, vectors.T, strict=True):
        steps[:, 1:] += vector[:, None] * motion.value(times[:-1] + offset)
    for instant in motion.breaks_s:
        k = grid.first_from(instant)  # a step that holds several breaks is split at all of them, each time
        if 0 < k < grid.samples:
            steps[:, k] = _integral(system, motion, times[k - 1], times[k], nodes)
    return accumulate(system.a, grid.interval_s, steps)


def _integral(system: LinearSystem, motion: Motion, begin_s: float, end_s: float, nodes: int) -> FloatArray:
    """∫ e^{A (end − τ)} b a(τ) dτ from begin to end, split at the breaks; shape (n,)."""
    inside = sorted(instant for instant in motion.breaks_s if begin_s < instant < end_s)
    edges = [begin_s, *inside, end_s]
    state = np.zeros(system.order)
    for left, right in itertools.pairwise(edges):
        offsets, vectors = _rule(system, right - left, nodes)
        state = exponential(system.a, right - left) @ state + vectors @ motion.value(left + offsets)
    return state


def _rule(system: LinearSystem, length_s: float, nodes: int) -> tuple[FloatArray, FloatArray]:
    """Offsets into the step, shape (m,), and weight vectors w e^{A (h − offset)} b, shape (n, m)."""
    panels = max(1, math.ceil(system.fastest * length_s / _PANEL_RATE))
    x, w = legendre.leggauss(nodes)
    offsets = ((np.arange(panels)[:, None] + 0.5 * (x + 1.0)) * (length_s / panels)).ravel()
    weights = np.tile(0.5 * w * length_s / panels, panels)
    vectors = [exponential(system.a, float(length_s - offset)) @ system.b for offset in offsets]
    return offsets, weights * np.array(vectors).T
