"""Motion of the base: the interface of every excitation, and their sum."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from vibrident.records import Excitation, FloatArray
from vibrident.simulation.grid import SampleGrid
from vibrident.simulation.tones import Tones


class Motion(Protocol):
    """An acceleration that is known at every instant; anything with these members can be simulated.

    ``breaks_s`` are the instants between which the acceleration is smooth; a motion that is not a sum of tones is zero
    before t = 0. ``highest_hz`` is the highest frequency that the sampling must resolve; 0 for none.
    """

    @property
    def kind(self) -> Excitation:
        """Name of the excitation in the record."""
        ...

    @property
    def words(self) -> str:
        """Description for a record's history."""
        ...

    @property
    def highest_hz(self) -> float:
        """Highest frequency, Hz."""
        ...

    @property
    def breaks_s(self) -> tuple[float, ...]:
        """Instants at which the acceleration or one of its derivatives jumps, s."""
        ...

    def value(self, time_s: FloatArray) -> FloatArray:
        """Acceleration in m/s² at any instants (s), in their shape."""
        ...


class Tonal(ABC):
    """A motion that is a sum of tones, without beginning (t < 0 included); it has a steady response."""

    breaks_s: tuple[float, ...] = ()

    @property
    @abstractmethod
    def tones(self) -> Tones:
        """The tones, acceleration in m/s²."""

    @property
    def highest_hz(self) -> float:
        """Highest frequency, Hz."""
        return float(np.max(self.tones.frequency_hz))

    def value(self, time_s: FloatArray) -> FloatArray:
        """Acceleration in m/s² at any instants (s), in their shape."""
        return self.tones.at(time_s)


@dataclass(frozen=True)
class Superposition:
    """The sum of several motions; ``kind`` is the first one's."""

    parts: tuple[Motion, ...]

    @property
    def kind(self) -> Excitation:
        """Kind of the first part."""
        return self.parts[0].kind

    @property
    def words(self) -> str:
        """All parts in words."""
        return "; ".join(part.words for part in self.parts)

    @property
    def highest_hz(self) -> float:
        """Highest frequency of all parts, Hz."""
        return max(part.highest_hz for part in self.parts)

    @property
    def breaks_s(self) -> tuple[float, ...]:
        """Breaks of all parts, s."""
        return tuple(sorted(instant for part in self.parts for instant in part.breaks_s))

    def value(self, time_s: FloatArray) -> FloatArray:
        """Acceleration in m/s² at any instants (s), in their shape."""
        return np.sum([part.value(time_s) for part in self.parts], axis=0)


def acceleration_on(motion: Motion, grid: SampleGrid) -> FloatArray:
    """Acceleration in m/s² on a grid, shape (samples,): ``value`` at its instants, by FFT where that is faster."""
    if isinstance(motion, Superposition):
        return np.sum([acceleration_on(part, grid) for part in motion.parts], axis=0)
    return motion.tones.on(grid) if isinstance(motion, Tonal) else motion.value(grid.times_s)
