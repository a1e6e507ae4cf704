"""Sensors and motions in continuous time, exactly: sums of tones, and free motion from the poles.

Nothing here is taken from the package: every formula is written again from the sensor's
differential equation, so that a mistake in one is not hidden by the same mistake in the other.

A motion is a sum of tones, acceleration Re Σ A e^{jωt}. A linear sensor answers each tone by its
transfer function, and its free motion is a sum of e^{pt} over its poles. Samples of both are exact
to rounding; all tones lie below half the sampling rate, but for what a nonlinear sensor adds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import polynomial as poly
from numpy.typing import NDArray

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

#: How often acceleration was integrated to give the quantity of the reference.
INTEGRATIONS = {"acceleration": 0, "drive": 0, "velocity": 1, "displacement": 2}
TAU = 2.0 * np.pi


@dataclass(frozen=True)
class Sensor:
    """A sensor by the name of its model and its parameters (the names and units of a result)."""

    model: str
    parameters: Mapping[str, float]

    @property
    def parts(self) -> tuple[str, ...]:
        """Core and add-ons."""
        return tuple(self.model.split("+"))

    @property
    def gain(self) -> float:
        """Sensitivity, or generator constant."""
        return self.parameters[
            "generator_constant" if self.parts[0] == "velocity-pickup" else "sensitivity"
        ]

    def fraction(self) -> tuple[Real, Real]:
        """Return numerator and denominator in s, ascending, without delay and average."""
        p = self.parameters
        w = TAU * p["natural_frequency"]
        d = p["damping_ratio"]
        top = np.array([0.0, 1.0]) if self.parts[0] == "velocity-pickup" else np.array([w * w])
        below = np.array([w * w, 2.0 * d * w, 1.0])
        if "mode2" in self.parts:
            w2 = TAU * p["mode2_frequency"]
            d2 = p["mode2_damping"]
            second = np.array([w2 * w2, 2.0 * d2 * w2, 1.0])
            top = poly.polyadd(poly.polymul(top, second), p["mode2_gain"] * w2 * w2 * below)
            below = poly.polymul(below, second)
        if "highpass" in self.parts:
            top = poly.polymul(top, [0.0, 1.0])
            below = poly.polymul(below, [TAU * p["highpass_frequency"], 1.0])
        return self.gain * top, below

    def transfer(self, frequency_hz: Real) -> Complex:
        """Return the response per acceleration at each frequency, for e^{+jωt}."""
        p = self.parameters
        s = 1j * TAU * np.asarray(frequency_hz, dtype=float)
        w = TAU * p["natural_frequency"]
        d = p["damping_ratio"]
        core = (s if self.parts[0] == "velocity-pickup" else w * w) / (
            s * s + 2.0 * d * w * s + w * w
        )
        if "mode2" in self.parts:
            w2 = TAU * p["mode2_frequency"]
            d2 = p["mode2_damping"]
            core = core + p["mode2_gain"] * w2 * w2 / (s * s + 2.0 * d2 * w2 * s + w2 * w2)
        if "highpass" in self.parts:
            core = core * s / (s + TAU * p["highpass_frequency"])
        if "boxcar" in self.parts:
            length = p["boxcar_length"]
            core = core * np.exp(-0.5 * s * length) * np.sinc(np.imag(s) * length / TAU)
        return self.gain * core * np.exp(-s * p.get("delay", 0.0))

    def poles(self) -> Complex:
        """Return the poles of free motion, rad/s."""
        return np.asarray(poly.polyroots(self.fraction()[1]), dtype=complex)

    def from_rest(self, frequency_hz: Real, amplitude: Complex) -> Complex:
        """Return the weights of e^{pt} that a motion from rest at t = 0 adds to the steady one."""
        top, below = self.fraction()
        roots = self.poles()
        residues = poly.polyval(roots, top) / poly.polyval(roots, poly.polyder(below))
        s = 1j * TAU * np.asarray(frequency_hz)
        return -np.array(
            [np.sum(amplitude * r / (s - root)) for root, r in zip(roots, residues, strict=True)]
        )

    def free(self, weights: Complex, time_s: Real) -> Real:
        """Re Σ weight e^{pt}."""
        return np.real(
            sum(c * np.exp(p * time_s) for c, p in zip(weights, self.poles(), strict=True))
        )


@dataclass(frozen=True)
class Motion:
    """Acceleration as tones: frequency (tones,), Hz, and complex amplitude (tones,), m/s²."""

    frequency_hz: Real
    amplitude: Complex

    def acceleration(self, time_s: Real) -> Real:
        """Return the values at these times."""
        return tones(self.frequency_hz, self.amplitude, time_s)

    def reference(self, time_s: Real, quantity: str) -> Real:
        """Return what a reference of this quantity reads at these times."""
        s = 1j * TAU * self.frequency_hz
        return tones(self.frequency_hz, self.amplitude / s ** INTEGRATIONS[quantity], time_s)

    def response(self, sensor: Sensor, time_s: Real) -> Real:
        """Return what the sensor answers in the steady state."""
        return tones(self.frequency_hz, self.amplitude * sensor.transfer(self.frequency_hz), time_s)

    def scaled(self, factor: float) -> Motion:
        """Return the same motion, larger."""
        return Motion(self.frequency_hz, factor * self.amplitude)

    def later(self, time_s: float) -> Motion:
        """Return the same motion as a record sees it that begins this much later."""
        turns = np.mod(self.frequency_hz * time_s, 1.0)
        return Motion(self.frequency_hz, self.amplitude * np.exp(1j * TAU * turns))


def tones(frequency_hz: Real, amplitude: Complex, time_s: Real) -> Real:
    """Re Σ A e^{jωt}, in pieces that fit the memory."""
    total = np.zeros(time_s.shape)
    grid = _grid(frequency_hz, time_s)
    if grid is not None:
        lines, period = grid
        spectrum = np.zeros(period, dtype=complex)
        np.add.at(spectrum, lines % period, amplitude)
        return np.real(np.fft.ifft(spectrum))[: time_s.size] * period
    for f, a in zip(frequency_hz, amplitude, strict=True):
        total += np.abs(a) * np.cos(TAU * np.mod(f * time_s, 1.0) + np.angle(a))
    return total


def _grid(frequency_hz: Real, time_s: Real) -> tuple[NDArray[np.int64], int] | None:
    """Return lines and period in samples of many tones on the lines of one period.

    None where they are not, or where times are not on samples from 0.
    """
    if frequency_hz.size < 100 or time_s[0] != 0.0:
        return None
    spacing = float(np.min(np.diff(frequency_hz)))
    step = float(time_s[1])
    lines = np.rint(frequency_hz / spacing).astype(np.int64)
    period = round(1.0 / (spacing * step))
    even = (
        np.allclose(lines * spacing, frequency_hz, rtol=1e-9)
        and abs(period * spacing * step - 1.0) < 1e-9
    )
    return (lines, period) if even and time_s.size <= period else None
