"""Sensor in discrete time: its cell by first-order hold, and its second-order sections.

First-order hold is the best single step of the network that needs no future sample: with straight
lines between the samples (Franklin, Powell & Workman 1998, sec. 6.3),

    x_k = Φ x_{k−1} + Γ0 a_{k−1} + Γ1 a_k,   y_k = C x_k + D a_k,

which is the paper's cell with the inputs (a_{k−1}, a_k): W3 = Φ, W1 = (Γ0, Γ1), W2 = C, W4 = (0,
D). Stored is Φ − 1, computed without cancellation: for a sensor that is slow relative to the
sampling rate, a float cannot hold Φ.

For the same reason sections are kept in δ = z − 1 (Middleton & Goodwin 1990): poles as e^{pT} − 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.export.poles_zeros import PolesZeros
from vibrident.export.sensor import ExportedSensor
from vibrident.physics.models.state_space import realise


@dataclass(frozen=True, eq=False)
class HoldCell:
    """Step of the network by first-order hold."""

    growth: np.ndarray  # Φ − 1, shape (n, n)
    before: np.ndarray  # Γ0, shape (n,), for the previous sample
    now: np.ndarray  # Γ1, shape (n,), for the present sample
    output: np.ndarray  # C, shape (n,), read from the new state
    feedthrough: float  # D
    interval_s: float  # sampling interval

    def response(self, frequency_hz: FloatArray) -> np.ndarray:
        """Return the response to e^{jωt} sampled, at its samples."""
        z = np.exp(2j * np.pi * np.asarray(frequency_hz) * self.interval_s)[:, None]
        shift = (z - 1.0)[:, :, None] * np.eye(len(self.now)) - self.growth
        state = np.linalg.solve(shift, (self.before + z * self.now)[..., None])[..., 0]
        return state @ self.output + self.feedthrough


def hold_cell(sensor: ExportedSensor, interval_s: float) -> HoldCell:
    """Return the rational part of the sensor by first-order hold, in scaled companion states."""
    from scipy.linalg import expm

    system = realise(sensor.model.rational(sensor.values, sensor.quantity))
    a = system.a
    n = system.order
    step = np.zeros((n + 2, n + 2))
    step[:n, :n] = a * interval_s
    step[:n, n] = system.b * interval_s
    step[n, n + 1] = 1.0
    exponential = np.asarray(expm(step))
    ramp = exponential[:n, n + 1]
    twice = np.zeros((2 * n, 2 * n))
    twice[:n, :n] = twice[:n, n:] = a * interval_s
    growth = np.asarray(expm(twice))[:n, n:]  # φ1(AT) AT = e^{AT} − 1
    direct = float(system.d[0]) if system.d else 0.0  # a sensor differentiates no acceleration
    return HoldCell(growth, exponential[:n, n] - ramp, ramp, system.c, direct, interval_s)


@dataclass(frozen=True, eq=False)
class SecondOrderSections:
    """Second-order sections (β0 δ² + β1 δ + β2)/(δ² + α1 δ + α2), with δ = z − 1.

    A row holds β0 β1 β2 α1 α2.
    """

    rows: np.ndarray
    interval_s: float

    def response(self, frequency_hz: FloatArray) -> np.ndarray:
        """Return the response to e^{jωt} sampled, at its samples."""
        delta = np.expm1(2j * np.pi * np.asarray(frequency_hz) * self.interval_s)
        value = np.ones(delta.shape, complex)
        for b0, b1, b2, a1, a2 in self.rows:
            value = value * ((b0 * delta + b1) * delta + b2) / ((delta + a1) * delta + a2)
        return value

    def cmsis(self) -> np.ndarray:
        """Return the sections in z, as CMSIS-DSP orders them, shape (sections, 5).

        A row holds b0 b1 b2 −a1 −a2.
        """
        b0, b1, b2, a1, a2 = self.rows.T
        return np.stack([b0, b1 - 2 * b0, b0 - b1 + b2, 2.0 - a1, a1 - a2 - 1.0], axis=1)

    @property
    def largest_pole(self) -> float:
        """Return the largest |z| of a pole."""
        return max(float(np.max(np.abs(1.0 + np.roots([1.0, a1, a2])))) for *_, a1, a2 in self.rows)


def map_sections(
    system: PolesZeros, interval_s: float, filling: np.ndarray, at_hz: float
) -> SecondOrderSections:
    """Return sections with a system's poles and zeros mapped by e^{sT}.

    Their magnitude is the system's at one frequency.

    ``system``: at most as many zeros as poles; ``filling``: zeros in z for each zero at infinity;
    ``at_hz``: where the magnitude is exact; the sign is the system's.
    """
    zeros = np.concatenate(
        [np.expm1(system.zeros * interval_s), np.asarray(filling, complex) - 1.0]
    )
    poles = np.expm1(system.poles * interval_s)
    if len(poles) % 2:
        zeros = np.append(zeros, -1.0)  # z/z
        poles = np.append(poles, -1.0)
    pairs = _pairs(zeros)
    rows = []
    for pole in sorted(
        _pairs(poles), key=lambda pair: float(np.min(np.abs(pair)))
    ):  # each with the nearest zeros
        near = min(pairs, key=lambda pair: abs(np.mean(pair) - np.mean(pole)))
        pairs = [pair for pair in pairs if pair is not near]
        rows.append([*np.poly(near).real, *np.poly(pole).real[1:]])
    sections = SecondOrderSections(np.array(rows), interval_s)
    at = np.array([at_hz])
    gain = float(np.abs(system.response(at) / sections.response(at))[0])
    sections.rows[0, :3] *= np.copysign(gain, system.gain)
    return sections


def _pairs(roots: np.ndarray) -> list[np.ndarray]:
    """Group the roots in pairs: conjugates together, real ones by size."""
    upper = sorted((r for r in roots if r.imag > 1e-14 * abs(r)), key=abs)
    real = sorted((r.real for r in roots if abs(r.imag) <= 1e-14 * abs(r)), key=abs)
    pairs = [np.array([r, np.conj(r)]) for r in upper]
    return pairs + [np.array(real[k : k + 2], complex) for k in range(0, len(real), 2)]
