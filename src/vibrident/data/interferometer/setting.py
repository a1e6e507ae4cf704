"""Settings of an interferometer, and its signals, read block by block."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Kind = Literal["quadrature", "heterodyne"]


@dataclass(frozen=True)
class Interferometer:
    """Settings of a laser interferometer on the reference surface."""

    # ``quadrature``: two signals, cos and sin of the phase; ``heterodyne``: one signal on a carrier
    kind: Kind
    wavelength_m: float  # in the medium
    wavelength_relative_uncertainty: float = 0.0  # standard
    passes: int = 1  # times the beam goes to the target and back
    # nominal carrier of a heterodyne signal; the carrier is estimated near this value
    carrier_hz: float | None = None
    direction: int | None = None  # sign of the displacement for growing phase; None if unknown
    delay_s: float = 0.0  # the optical channel comes later than the response channel by this time
    delay_standard_uncertainty_s: float = 0.0

    @property
    def metres_per_radian(self) -> float:
        """Return the displacement per radian of phase, with its sign.

        phase = 4π · passes · displacement / wavelength.
        """
        return (self.direction or 1) * self.wavelength_m / (4.0 * math.pi * self.passes)


@dataclass(frozen=True)
class Gap:
    """Samples from ``start`` up to ``stop`` that are left out.

    ``jump``: whether the phase jumps there at sufficient amplitude.
    """

    start: int
    stop: int
    jump: bool


@dataclass(frozen=True, eq=False)
class SampledSignals:
    """Signals of one sampling rate and length that are read block by block."""

    samples: int  # of each
    rate_hz: float  # samples per second
    # start, stop → these samples, shape (signals, stop − start)
    block: Callable[[int, int], FloatArray]
    first_s: float = 0.0  # time of the first sample; above zero for filtered ones


def signals_in_memory(values: FloatArray, rate_hz: float, first_s: float = 0.0) -> SampledSignals:
    """Return signals that are in memory, from values of shape (signals, samples)."""
    return SampledSignals(
        values.shape[1],
        rate_hz,
        lambda start, stop: np.asarray(values[:, start:stop], dtype=float),
        first_s,
    )
