"""The interferometer's setting, and the source of its signals, block by block."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Kind = Literal["quadrature", "heterodyne"]


@dataclass(frozen=True)
class Interferometer:
    """A laser interferometer on the reference surface."""

    kind: Kind  # ``quadrature``: two signals, cos and sin of the phase; ``heterodyne``: one signal on a carrier
    wavelength_m: float  # in the medium
    wavelength_relative_uncertainty: float = 0.0  # relative standard uncertainty of it
    passes: int = 1  # times the beam goes to the target and back
    carrier_hz: float | None = None  # nominal carrier of a heterodyne signal; estimated near this value
    direction: int | None = None  # sign of the displacement for growing phase; None if unknown
    delay_s: float = 0.0  # the optical channel comes later than the response channel by this time
    delay_standard_uncertainty_s: float = 0.0  # of that

    @property
    def metres_per_radian(self) -> float:
        """Displacement for one radian of phase, with its sign: phase = 4π · passes · x / wavelength."""
        return (self.direction or 1) * self.wavelength_m / (4.0 * math.pi * self.passes)


class Signals(Protocol):
    """Signals that are read block by block; all of one sampling rate and length."""

    @property
    def samples(self) -> int:
        """Number of samples of each."""
        ...

    @property
    def rate_hz(self) -> float:
        """Samples per second."""
        ...

    def block(self, start: int, stop: int) -> FloatArray:
        """Samples from ``start`` up to ``stop``, shape (signals, stop − start)."""
        ...


@dataclass(frozen=True, eq=False)
class Held:
    """Signals in memory, shape (signals, samples)."""

    values: FloatArray
    rate_hz: float

    @property
    def samples(self) -> int:
        """Number of samples of each."""
        return int(self.values.shape[1])

    def block(self, start: int, stop: int) -> FloatArray:
        """Samples from ``start`` up to ``stop``, shape (signals, stop − start)."""
        return np.asarray(self.values[:, start:stop], dtype=float)
