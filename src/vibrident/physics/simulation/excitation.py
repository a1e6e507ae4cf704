"""Excitations: acceleration of the base as a function of continuous time, in m/s².

Nothing here knows a sampling rate; the truth is computed from the continuous signal, and sampling
comes last.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from vibrident.data.records import Excitation, FloatArray
from vibrident.physics.simulation.checks import (
    require,
    require_choice,
    require_finite,
    require_not_negative,
    require_positive,
    require_usable,
)
from vibrident.physics.simulation.motion import DescribedMotion, Tonal, Tones


@dataclass(frozen=True)
class Sine(DescribedMotion, Tonal):
    """Sine a(t) = amplitude · cos(2π f t + phase).

    Attributes:
        frequency_hz: f, Hz.
        amplitude: peak, m/s².
        phase_rad: phase at t = 0; −π/2 starts from zero.

    Raises:
        InputError: the frequency is not positive, or a number is not finite.
    """

    frequency_hz: float
    amplitude: float
    phase_rad: float = 0.0
    kind: Excitation = "sine"
    template = "sine of {0.frequency_hz:.9g} Hz, {0.amplitude:.9g} m/s²"

    def __post_init__(self) -> None:
        require_positive("Sine", frequency_hz=self.frequency_hz)
        require_finite("Sine", amplitude=self.amplitude, phase_rad=self.phase_rad)

    @cached_property
    def tones(self) -> Tones:
        """Return the tone."""
        return Tones(
            np.array([self.frequency_hz]), np.array([self.amplitude * np.exp(1j * self.phase_rad)])
        )


@dataclass(frozen=True)
class Multisine(Tonal):
    """Multisine a(t) = Σ_m amplitude_m · cos(2π f_m t + phase_m), of any frequencies.

    Attributes:
        frequencies_hz: f_m, Hz, any spacing.
        amplitudes: peak of each tone, m/s².
        phases_rad: phase of each tone at t = 0; see ``random_phases``.

    Raises:
        InputError: the three differ in length, are empty, or hold a number that cannot be used.
    """

    frequencies_hz: tuple[float, ...]
    amplitudes: tuple[float, ...]
    phases_rad: tuple[float, ...]
    kind: Excitation = "multisine"

    def __post_init__(self) -> None:
        for name in ("frequencies_hz", "amplitudes", "phases_rad"):
            object.__setattr__(self, name, tuple(float(value) for value in getattr(self, name)))
        lengths = [len(self.frequencies_hz), len(self.amplitudes), len(self.phases_rad)]
        require(
            lengths[0] > 0 and len(set(lengths)) == 1,
            "The tones of a multisine do not fit together.",
            expected="one frequency, amplitude and phase a tone, at least one tone",
            found=f"{lengths[0]} frequencies, {lengths[1]} amplitudes, {lengths[2]} phases",
            where="Multisine",
            remedy="give all three the same length",
        )
        for f, a, p in zip(self.frequencies_hz, self.amplitudes, self.phases_rad, strict=True):
            require_positive("Multisine", frequency_hz=f)
            require_finite("Multisine", amplitude=a, phase_rad=p)

    @property
    def words(self) -> str:
        """Return the description for a record's history."""
        low = min(self.frequencies_hz)
        high = max(self.frequencies_hz)
        return f"multisine of {len(self.frequencies_hz)} tones, {low:.9g} to {high:.9g} Hz"

    @cached_property
    def tones(self) -> Tones:
        """Return the tones as given."""
        return Tones(
            np.array(self.frequencies_hz),
            np.array(self.amplitudes) * np.exp(1j * np.array(self.phases_rad)),
        )


def random_phases(count: int, rng: np.random.Generator) -> tuple[float, ...]:
    """Return ``count`` phases (rad), uniform in [0, 2π)."""
    return tuple(float(value) for value in rng.uniform(0.0, 2.0 * np.pi, count))


@dataclass(frozen=True)
class Sweep(DescribedMotion):
    """Sweep a(t) = amplitude · w(t) · sin φ(t) for 0 ≤ t ≤ duration, zero elsewhere.

    φ̇/2π runs from ``start_hz`` to ``stop_hz``. The ramp w(x) = x − sin(2πx)/2π over ``taper`` of
    the duration at either end has two continuous derivatives, so little power lies outside the
    band.

    Attributes:
        start_hz: frequency at t = 0.
        stop_hz: frequency at the end; may be below start_hz.
        duration_s: length, s.
        amplitude: peak, m/s².
        law: ``linear`` in time, or ``log``: the same time for every octave.
        taper: ramp at either end as a fraction of the duration, 0 to 0.5.

    Raises:
        InputError: a number cannot be used, or the law is unknown.
    """

    start_hz: float
    stop_hz: float
    duration_s: float
    amplitude: float
    law: Literal["linear", "log"] = "linear"
    taper: float = 0.05
    kind: Excitation = "sweep"
    template = "{0.law} sweep from {0.start_hz:.9g} to {0.stop_hz:.9g} Hz in {0.duration_s:.9g} s"

    def __post_init__(self) -> None:
        require_positive(
            "Sweep", start_hz=self.start_hz, stop_hz=self.stop_hz, duration_s=self.duration_s
        )
        require_finite("Sweep", amplitude=self.amplitude)
        require_choice("The law of the sweep", self.law, ("linear", "log"))
        usable = 0.0 <= self.taper <= 0.5
        require_usable(
            usable, "taper", self.taper, "a fraction of the duration from 0 to 0.5", "Sweep"
        )

    @property
    def highest_hz(self) -> float:
        """Return the highest frequency, Hz."""
        return max(self.start_hz, self.stop_hz)

    @property
    def breaks_s(self) -> tuple[float, ...]:
        """Return begin and end of the ramps, s."""
        ramp = self.taper * self.duration_s
        inner = (
            (ramp, self.duration_s - ramp)
            if 0.0 < self.taper < 0.5
            else (ramp,) * (self.taper > 0.0)
        )
        return (0.0, *inner, self.duration_s)

    def cycles(self, time_s: FloatArray) -> FloatArray:
        """Return φ/2π at instants within the sweep, s."""
        ratio = self.stop_hz / self.start_hz
        if self.law == "linear" or abs(np.log(ratio)) < 1e-9:
            return time_s * (
                self.start_hz + 0.5 * (self.stop_hz - self.start_hz) * time_s / self.duration_s
            )
        octaves = np.log(ratio)
        return (
            self.start_hz * self.duration_s / octaves * np.expm1(octaves * time_s / self.duration_s)
        )

    def value(self, time_s: FloatArray) -> FloatArray:
        """Return the acceleration in m/s² at any instants (s), in their shape."""
        time = np.asarray(time_s, dtype=float)
        inside = (time >= 0.0) & (time <= self.duration_s)
        cycles = self.cycles(np.where(inside, time, 0.0))
        envelope = np.where(inside, self.amplitude, 0.0)
        if self.taper > 0.0:
            from_edge = np.minimum(time, self.duration_s - time) / (self.taper * self.duration_s)
            x = np.clip(from_edge, 0.0, 1.0)
            envelope = envelope * (x - np.sin(2.0 * np.pi * x) / (2.0 * np.pi))
        return envelope * np.sin(2.0 * np.pi * (cycles - np.rint(cycles)))


@dataclass(frozen=True)
class BandLimitedRandom(DescribedMotion, Tonal):
    """Flat random vibration between two frequencies, nearly Gaussian.

    It is many equal tones with random phases, which sit at every multiple of 1/period_s in the
    band, so the rms over one period is exactly ``rms`` and the signal has no power at all outside
    the band.

    Attributes:
        low_hz: lowest frequency, Hz.
        high_hz: highest frequency, Hz.
        rms: m/s².
        seed: of the phases.
        period_s: after which the signal repeats; take it longer than the record to avoid
            repetition.

    Raises:
        InputError: a number cannot be used, or the band holds no multiple of 1/period_s.
    """

    low_hz: float
    high_hz: float
    rms: float
    seed: int
    period_s: float
    kind: Excitation = "random"
    template = "random, {0.low_hz:.9g} to {0.high_hz:.9g} Hz, {0.rms:.9g} m/s² rms, seed {0.seed}"

    def __post_init__(self) -> None:
        where = "BandLimitedRandom"
        require_not_negative(where, low_hz=self.low_hz, rms=self.rms)
        require_positive(where, high_hz=self.high_hz, period_s=self.period_s)
        first, last = self._harmonics
        require(
            first <= last,
            "The band of the random excitation holds no tone.",
            expected=f"a multiple of 1/period_s = {1.0 / self.period_s:g} Hz "
            "between low_hz and high_hz",
            found=f"{self.low_hz:g} to {self.high_hz:g} Hz",
            where=where,
            remedy="widen the band, or take a longer period_s",
        )

    @property
    def _harmonics(self) -> tuple[int, int]:
        first = int(np.ceil(self.low_hz * self.period_s * (1.0 - 1e-12)))
        return max(first, 1), int(np.floor(self.high_hz * self.period_s * (1.0 + 1e-12)))

    @cached_property
    def tones(self) -> Tones:
        """Return the multiples of 1/period_s with equal amplitudes and random phases."""
        first, last = self._harmonics
        frequency = np.arange(first, last + 1) / self.period_s
        phase = np.random.default_rng(self.seed).uniform(0.0, 2.0 * np.pi, frequency.size)
        amplitude = self.rms * np.sqrt(2.0 / frequency.size)
        return Tones(frequency, amplitude * np.exp(1j * phase), 1.0 / self.period_s)


@dataclass(frozen=True)
class HalfSineShock(DescribedMotion):
    """Half-sine shock a(t) = peak · sin(π (t − start)/duration) (ISO 16063-13).

    It is zero before the start and after the duration.

    Attributes:
        peak: m/s².
        duration_s: width of the pulse at its foot, s.
        start_s: begin of the pulse, s, not negative.
    """

    peak: float
    duration_s: float
    start_s: float = 0.0
    kind: Excitation = "shock"
    highest_hz: float = 0.0
    template = "half-sine shock of {0.peak:.9g} m/s², {0.duration_s:.9g} s, at {0.start_s:.9g} s"

    def __post_init__(self) -> None:
        require_finite("HalfSineShock", peak=self.peak)
        require_positive("HalfSineShock", duration_s=self.duration_s)
        require_not_negative("HalfSineShock", start_s=self.start_s)

    @property
    def breaks_s(self) -> tuple[float, ...]:
        """Return begin and end of the pulse, s."""
        return (self.start_s, self.start_s + self.duration_s)

    def value(self, time_s: FloatArray) -> FloatArray:
        """Return the acceleration in m/s² at any instants (s), in their shape."""
        x = (np.asarray(time_s, dtype=float) - self.start_s) / self.duration_s
        return np.where(
            (x >= 0.0) & (x <= 1.0), self.peak * np.sin(np.pi * np.clip(x, 0.0, 1.0)), 0.0
        )


@dataclass(frozen=True)
class Decay(DescribedMotion):
    """Free decay: the base rests, and the mass is held off its position and released at t = 0.

    The initial state is the static one under a constant acceleration ``amplitude``. (A geophone's
    coil lifted by a current and released is this experiment.)

    Attributes:
        amplitude: the static acceleration with the same displacement of the mass, m/s².
    """

    amplitude: float
    kind: Excitation = "decay"
    highest_hz: float = 0.0
    breaks_s: tuple[float, ...] = ()
    template = "free decay, released from the static state under {0.amplitude:.9g} m/s²"

    def __post_init__(self) -> None:
        require_finite("Decay", amplitude=self.amplitude)

    def value(self, time_s: FloatArray) -> FloatArray:
        """Return zero: the base rests."""
        return np.zeros(np.shape(time_s))
