"""Motion of the base: instants, sums of tones, the interface of excitations, sums of motions."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from vibrident.data.records import Excitation, FloatArray
from vibrident.physics.models.slopes import ComplexArray

#: Distance within which an instant is a sample, in samples.
MAX_COINCIDENCE_SAMPLES = 1e-9
#: Tones evaluated at once, which bounds the memory.
BLOCK_TONES = 4096
#: Least number of harmonics of a fundamental that are summed by FFT where it fits the grid.
MIN_FFT_TONES = 64
#: Longest FFT, samples.
MAX_FFT_SAMPLES = 2**24


@dataclass(frozen=True)
class SampleGrid:
    """Instants start_s + k/rate_hz, k = 0 … samples − 1."""

    start_s: float
    rate_hz: float
    samples: int

    @property
    def interval_s(self) -> float:
        """Return the time between instants, s."""
        return 1.0 / self.rate_hz

    @property
    def times_s(self) -> FloatArray:
        """Return the instants, s, shape (samples,)."""
        return self.start_s + np.arange(self.samples) / self.rate_hz

    def first_from(self, time_s: float) -> int:
        """Return the index of the first instant at or after ``time_s``, at most ``samples``."""
        index = math.ceil((time_s - self.start_s) * self.rate_hz - MAX_COINCIDENCE_SAMPLES)
        return min(max(index, 0), self.samples)

    def since(self, time_s: float) -> SampleGrid:
        """Return the instants at or after ``time_s``, counted from ``time_s``."""
        first = self.first_from(time_s)
        start = self.start_s + first / self.rate_hz - time_s
        return SampleGrid(max(start, 0.0), self.rate_hz, self.samples - first)


@dataclass(frozen=True, eq=False)
class Tones:
    """Sum of tones a(t) = Re Σ_m p_m e^{j 2π f_m t}.

    Attributes:
        frequency_hz: f_m, shape (tones,), positive.
        phasor: p_m, complex, shape (tones,), in the unit of the signal (peak, not rms).
        fundamental_hz: the frequency of which all f_m are distinct whole multiples, if any; else
            None.
    """

    frequency_hz: FloatArray
    phasor: ComplexArray
    fundamental_hz: float | None = None

    def scaled_by(self, factor: ComplexArray) -> Tones:
        """Return the tones with phasors multiplied by ``factor``, shape (tones,).

        So a linear system answers them.
        """
        return replace(self, phasor=self.phasor * factor)

    def at(self, time_s: FloatArray) -> FloatArray:
        """Return the values at any instants, s; the result has the shape of ``time_s``."""
        instants = np.asarray(time_s, dtype=float)
        flat = instants.ravel()
        value = np.zeros(flat.shape)
        for block in _blocks(flat.size, max(1, 2**20 // max(1, self.frequency_hz.size))):
            value[block] = (_turn(np.outer(flat[block], self.frequency_hz)) @ self.phasor).real
        return value.reshape(instants.shape)

    def on(self, grid: SampleGrid) -> FloatArray:
        """Return the values on a grid, shape (samples,).

        By FFT if the tones' period is a whole number of samples.
        """
        period = self._period_samples(grid.rate_hz)
        return self._by_blocks(grid) if period is None else self._by_fft(grid, period)

    def _period_samples(self, rate_hz: float) -> int | None:
        if self.fundamental_hz is None or self.frequency_hz.size < MIN_FFT_TONES:
            return None
        period = rate_hz / self.fundamental_hz
        samples = round(period)
        fits = abs(period - samples) < 1e-9 * period and samples <= MAX_FFT_SAMPLES
        return (
            samples if fits and np.max(self.frequency_hz) < 0.5 * rate_hz * (1.0 - 1e-9) else None
        )

    def _by_fft(self, grid: SampleGrid, period: int) -> FloatArray:
        assert self.fundamental_hz is not None  # it has a period
        harmonic = np.rint(self.frequency_hz / self.fundamental_hz).astype(int)
        spectrum = np.zeros(period // 2 + 1, dtype=complex)
        spectrum[harmonic] = 0.5 * self.phasor * _turn(self.frequency_hz * grid.start_s)
        return np.resize(np.fft.irfft(spectrum, period, norm="forward"), grid.samples)

    def _by_blocks(self, grid: SampleGrid) -> FloatArray:
        """Sum the tones on a grid by two short lists of turns and one product.

        e^{jω(t0 + (b B + i) h)} = e^{jω(t0 + b B h)} e^{jω i h}.
        """
        inner = max(1, math.isqrt(grid.samples))
        outer = -(-grid.samples // inner)
        fine = np.arange(inner) / grid.rate_hz
        coarse = grid.start_s + np.arange(outer) * inner / grid.rate_hz
        value = np.zeros((outer, inner))
        for block in _blocks(self.frequency_hz.size, BLOCK_TONES):
            frequency = self.frequency_hz[block]
            at_blocks = _turn(np.outer(coarse, frequency)) * self.phasor[block]
            within = _turn(np.outer(frequency, fine))
            value += at_blocks.real @ within.real - at_blocks.imag @ within.imag
        return value.ravel()[: grid.samples]


def _turn(cycles: FloatArray) -> ComplexArray:
    """Return e^{j 2π cycles}, reduced to a fraction of a cycle first."""
    return np.exp(2j * np.pi * (cycles - np.rint(cycles)))


def _blocks(total: int, length: int) -> list[slice]:
    return [slice(start, min(start + length, total)) for start in range(0, total, length)]


class Motion(Protocol):
    """An acceleration that is known at every instant; anything with these members can be simulated.

    ``breaks_s`` are the instants between which the acceleration is smooth; a motion that is not a
    sum of tones is zero before t = 0. ``highest_hz`` is the highest frequency that the sampling
    must resolve; 0 for none.
    """

    @property
    def kind(self) -> Excitation:
        """Return the name of the excitation in the record."""
        ...

    @property
    def words(self) -> str:
        """Return the description for a record's history."""
        ...

    @property
    def highest_hz(self) -> float:
        """Return the highest frequency, Hz."""
        ...

    @property
    def breaks_s(self) -> tuple[float, ...]:
        """Return the instants at which the acceleration or one of its derivatives jumps, s."""
        ...

    def value(self, time_s: FloatArray) -> FloatArray:
        """Return the acceleration in m/s² at any instants (s), in their shape."""
        ...


class DescribedMotion:
    """Motion that is described by a template of its fields."""

    template: str

    @property
    def words(self) -> str:
        """Return the description for a record's history."""
        return self.template.format(self)


class Tonal(ABC):
    """Motion that is a sum of tones without beginning, t < 0 included.

    A sensor has a steady response to it.
    """

    breaks_s: tuple[float, ...] = ()

    @property
    @abstractmethod
    def tones(self) -> Tones:
        """Return the tones, acceleration in m/s²."""

    @property
    def highest_hz(self) -> float:
        """Return the highest frequency, Hz."""
        return float(np.max(self.tones.frequency_hz))

    def value(self, time_s: FloatArray) -> FloatArray:
        """Return the acceleration in m/s² at any instants (s), in their shape."""
        return self.tones.at(time_s)


@dataclass(frozen=True)
class Superposition:
    """The sum of several motions; ``kind`` is the first one's."""

    terms: tuple[Motion, ...]

    @property
    def kind(self) -> Excitation:
        """Return the kind of the first part."""
        return self.terms[0].kind

    @property
    def words(self) -> str:
        """Return all parts in words."""
        return "; ".join(term.words for term in self.terms)

    @property
    def highest_hz(self) -> float:
        """Return the highest frequency of all parts, Hz."""
        return max(term.highest_hz for term in self.terms)

    @property
    def breaks_s(self) -> tuple[float, ...]:
        """Return the breaks of all parts, s."""
        return tuple(sorted(instant for term in self.terms for instant in term.breaks_s))

    def value(self, time_s: FloatArray) -> FloatArray:
        """Return the acceleration in m/s² at any instants (s), in their shape."""
        return np.sum([term.value(time_s) for term in self.terms], axis=0)


def acceleration_on(motion: Motion, grid: SampleGrid) -> FloatArray:
    """Return the acceleration in m/s² on a grid, shape (samples,).

    It is ``value`` at its instants, by FFT where that is faster.
    """
    if isinstance(motion, Superposition):
        return np.sum([acceleration_on(term, grid) for term in motion.terms], axis=0)
    return motion.tones.on(grid) if isinstance(motion, Tonal) else motion.value(grid.times_s)
