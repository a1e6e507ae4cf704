"""Sums of tones: values at any instant, and fast on a grid of equally spaced instants."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vibrident.records import FloatArray
from vibrident.simulation.grid import SampleGrid

ComplexArray = NDArray[np.complex128]

_BLOCK = 4096  # tones evaluated at once; bounds the memory
_FFT_FROM = 64  # from this many tones on, harmonics of a fundamental that fits the grid are summed by FFT
_LONGEST_FFT = 2**24


@dataclass(frozen=True, eq=False)
class Tones:
    """a(t) = Re Σ_m p_m e^{j 2π f_m t}."""

    frequency_hz: FloatArray  # f_m, shape (tones,), positive
    phasor: ComplexArray  # p_m, complex, shape (tones,), in the unit of the signal (peak, not rms)
    # the frequency of which all f_m are distinct whole multiples, if any; else None
    fundamental_hz: float | None = None

    def scaled_by(self, factor: ComplexArray) -> Tones:
        """The same tones with phasors multiplied by ``factor``, shape (tones,): the output of a linear system."""
        return replace(self, phasor=self.phasor * factor)

    def at(self, time_s: FloatArray) -> FloatArray:
        """Values at any instants, s; the result has the shape of ``time_s``."""
        instants = np.asarray(time_s, dtype=float)
        flat = instants.ravel()
        value = np.zeros(flat.shape)
        for part in _blocks(flat.size, max(1, 2**20 // max(1, self.frequency_hz.size))):
            value[part] = (_turn(np.outer(flat[part], self.frequency_hz)) @ self.phasor).real
        return value.reshape(instants.shape)

    def on(self, grid: SampleGrid) -> FloatArray:
        """Values on a grid, shape (samples,): by FFT if the tones' period is a whole number of samples."""
        period = self._period_samples(grid.rate_hz)
        return self._by_blocks(grid) if period is None else self._by_fft(grid, period)

    def _period_samples(self, rate_hz: float) -> int | None:
        if self.fundamental_hz is None or self.frequency_hz.size < _FFT_FROM:
            return None
        period = rate_hz / self.fundamental_hz
        whole = round(period)
        fits = abs(period - whole) < 1e-9 * period and whole <= _LONGEST_FFT
        return whole if fits and np.max(self.frequency_hz) < 0.5 * rate_hz * (1.0 - 1e-9) else None

    def _by_fft(self, grid: SampleGrid, period: int) -> FloatArray:
        assert self.fundamental_hz is not None  # it has a period
        harmonic = np.rint(self.frequency_hz / self.fundamental_hz).astype(int)
        spectrum = np.zeros(period // 2 + 1, dtype=complex)
        spectrum[harmonic] = 0.5 * self.phasor * _turn(self.frequency_hz * grid.start_s)
        return np.resize(np.fft.irfft(spectrum, period, norm="forward"), grid.samples)

    def _by_blocks(self, grid: SampleGrid) -> FloatArray:
        """e^{jω(t0 + (b B + i) h)} = e^{jω(t0 + b B h)} e^{jω i h}: two short lists of turns and one product."""
        inner = max(1, math.isqrt(grid.samples))
        outer = -(-grid.samples // inner)
        fine = np.arange(inner) / grid.rate_hz
        coarse = grid.start_s + np.arange(outer) * inner / grid.rate_hz
        value = np.zeros((outer, inner))
        for part in _blocks(self.frequency_hz.size, _BLOCK):
            frequency = self.frequency_hz[part]
            left = _turn(np.outer(coarse, frequency)) * self.phasor[part]
            right = _turn(np.outer(frequency, fine))
            value += left.real @ right.real - left.imag @ right.imag
        return value.ravel()[: grid.samples]


def _turn(cycles: FloatArray) -> ComplexArray:
    """e^{j 2π cycles}, reduced to a fraction of a cycle first."""
    return np.exp(2j * np.pi * (cycles - np.rint(cycles)))


def _blocks(total: int, length: int) -> list[slice]:
    return [slice(start, min(start + length, total)) for start in range(0, total, length)]
