"""Steady state of a spring with a cubic part, by harmonic balance (Krack & Gross 2019).

    V̈ + 2 δ ωn V̇ + ωn² (V + k3 V³) = K a

The tones of the motion lie on the lines of one period. V is found on four times as many points as
its lines need, by repeating V = H (K a − ωn² k3 V³), which converges where the bend is small
against the damping.
"""

from __future__ import annotations

import numpy as np

from bench.adversary.physics import TAU, Motion, Sensor

MAX_ITERATIONS = 400
TOLERANCE = 1e-13


def bent(
    motion: Motion, sensor: Sensor, spacing_hz: float, offset: float = 0.0
) -> tuple[Motion, float]:
    """Return the response as tones (with the delay of the sensor), and its mean.

    ``motion``: with all its tones on multiples of ``spacing_hz``; ``sensor``: accelerometer+cubic,
    with or without +delay; ``spacing_hz``: one over the period; ``offset``: constant acceleration,
    m/s².

    Raises:
        ArithmeticError: the bend is too large for this way.
    """
    lines = np.rint(motion.frequency_hz / spacing_hz).astype(int)
    points = 8 * int(2 ** np.ceil(np.log2(max(lines.max() + 1, 16))))
    push = np.zeros(points // 2 + 1, dtype=complex)
    np.add.at(push, lines, motion.amplitude * (0.5 * points))
    push[0] = offset * points
    frequency = np.arange(points // 2 + 1) * spacing_hz
    w = TAU * sensor.parameters["natural_frequency"]
    d = sensor.parameters["damping_ratio"]
    s = 1j * TAU * frequency
    mobility = w * w / (s * s + 2.0 * d * w * s + w * w)
    linear = mobility * sensor.gain * push
    cubic = sensor.parameters["cubic_stiffness"]
    value = np.fft.irfft(linear, points)
    for _ in range(MAX_ITERATIONS):
        after = np.fft.irfft(linear - mobility * np.fft.rfft(cubic * value**3), points)
        change = np.max(np.abs(after - value)) / np.max(np.abs(linear))
        value = after
        if not np.isfinite(change):
            break
        if np.max(np.abs(change)) * points < TOLERANCE * points:
            spectrum = (
                np.fft.rfft(value) * 2.0 / points * np.exp(-s * sensor.parameters.get("delay", 0.0))
            )
            return Motion(frequency[1:], spectrum[1:]), float(np.real(spectrum[0]) / 2.0)
    raise ArithmeticError("the bend is too large to be found by repetition")
