"""Sensors and their exact motion, written in NumPy apart from the package, and the network's recursion step by step."""

import functools

import numpy as np

from vibrident.base.backend import jax
from vibrident.physics.discretisation import Weights, method
from vibrident.physics.models import parse
from vibrident.physics.models.state_space import realise

PAPER = {"sensitivity": 0.104, "natural_frequency": 652.0, "damping_ratio": 0.182}


def accelerometer(natural_frequency, damping_ratio, sensitivity=1.0):
    return {"sensitivity": sensitivity, "natural_frequency": natural_frequency, "damping_ratio": damping_ratio}


def matrices(p):
    """The accelerometer of eq. (4) in the states V, V̇/ωn, as the package's scaled states are; A, B, C."""
    wn = 2 * np.pi * p["natural_frequency"]
    a = wn * np.array([[0.0, 1.0], [-1.0, -2 * p["damping_ratio"]]])
    return a, np.array([0.0, wn * p["sensitivity"]]), np.array([1.0, 0.0])


def system_of(p, name="accelerometer", quantity="acceleration"):
    return realise(parse(name).rational(p, quantity))


@functools.partial(jax.jit, static_argnames=("name", "model", "quantity", "terms", "whole_steps"))
def _compiled(p, ts, fraction, name, model, quantity, terms, whole_steps):
    system = realise(parse(model).rational(p, quantity))
    return method(name).weights(system, ts, 0.0 if whole_steps else fraction, terms)


def weights_of(name, p, ts, fraction, terms, model="accelerometer", quantity="acceleration"):
    """The method's weights for a sensor, compiled once for all parameters, as NumPy arrays."""
    whole_steps = fraction == 0.0
    return Weights(*(np.asarray(w) for w in _compiled(p, ts, fraction, name, model, quantity, terms, whole_steps)))


def recursion(weights, coefficients, state, offset=0.0):
    """x ← Φ x + Γ c, y = C x + D c + offset, in plain NumPy; coefficients (steps, q) → (steps,)."""
    phi, gamma, c, d = (np.asarray(w) for w in weights)
    outputs = np.empty(len(coefficients))
    for k, inputs in enumerate(coefficients):
        outputs[k] = c @ state + d @ inputs + offset
        state = phi @ state + gamma @ inputs
    return outputs


def tone_state(system, frequency, time):
    """Steady state at an instant under an input cos(2π f t), in the states of ``system``."""
    a, b = np.asarray(system.a), np.asarray(system.b)
    phasor = np.linalg.solve(2j * np.pi * frequency * np.eye(len(b)) - a, b.astype(complex))
    return np.real(phasor * np.exp(2j * np.pi * frequency * time))


def without_free_response(weights, error):
    """What of ``error``, shape (steps,), no initial state can imitate: the network finds its initial state itself."""
    phi, _, c, _ = (np.asarray(w) for w in weights)
    free, power = np.empty((len(error), len(c))), np.eye(len(c))
    for k in range(len(error)):
        free[k] = c @ power
        power = phi @ power
    return error - free @ np.linalg.lstsq(free, error, rcond=1e-12)[0]
