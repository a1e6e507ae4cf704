"""Quality of an interferometer's signals: kept with the record made from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from vibrident.data.interferometer.setting import FloatArray, Interferometer

if TYPE_CHECKING:
    from vibrident.data.interferometer.ellipse import Ellipse

OpticalCode = Literal["fringe_slip", "few_fringes", "ellipse_unstable", "clipped", "clock_suspect"]


@dataclass(frozen=True)
class OpticalFinding:
    """One doubt about the optical signals."""

    code: OpticalCode
    message: str


@dataclass(frozen=True, eq=False)
class OpticalSummary:
    """Of one record."""

    setting: Interferometer
    rate_hz: float  # of the optical signals
    samples: int  # of each
    factor: int  # optical samples for each of the displacement
    ellipse: Ellipse  # that the phase is from
    origin: str  # of the ellipse, in words
    changes: float  # relative change of the ellipse's shape within the record; 0 if none
    fringes: float  # range of the phase in turns
    path_fringes: float  # length of its path in turns
    fastest_rad: float  # largest change of phase from sample to sample
    gaps: int  # pieces left out …
    jumps: int  # … of these at sufficient amplitude …
    open_gaps: int  # … and of unknown turns
    left_out: float  # part of the displacement's samples that is left out
    counted: int  # half fringes by the signs of a signal; 0 where samples are too far apart
    by_phase: int  # the same by the phase
    phase_noise_rad: float  # standard deviation of the noise of one sample's phase
    points: FloatArray  # some samples of both signals, shape (2, n)
    excerpt_s: FloatArray  # a piece of the displacement: times …
    excerpt_m: FloatArray  # … and values, NaN where it is left out
    carrier_hz: float | None = None  # of a heterodyne signal, as found; None for others
    # order, amplitude and its u of the phase's cyclic error, rad
    cyclic: tuple[tuple[int, float, float], ...] = ()
    findings: tuple[OpticalFinding, ...] = ()  # doubts

    @property
    def noise_density_m(self) -> float:
        """Return the displacement noise for white phase noise, m/√Hz."""
        return (
            abs(self.setting.metres_per_radian)
            * self.phase_noise_rad
            * float(np.sqrt(2.0 / self.rate_hz))
        )

    def as_settings(self) -> dict[str, Any]:
        """As plain values, for a result."""
        first, second = self.ellipse.amplitudes
        u = np.sqrt(np.diag(self.ellipse.shape_covariance))
        found: dict[str, Any] = {
            "kind": self.setting.kind,
            "rate_hz": self.rate_hz,
            "samples": self.samples,
            "decimated_by": self.factor,
            "fringes": self.fringes,
            "path_fringes": self.path_fringes,
            "half_fringes_counted": self.counted,
            "half_fringes_by_phase": self.by_phase,
            "fastest_rad_per_sample": self.fastest_rad,
            "gaps": self.gaps,
            "jumps": self.jumps,
            "gaps_of_unknown_turns": self.open_gaps,
            "left_out": self.left_out,
            "phase_noise_rad": self.phase_noise_rad,
            "noise_density_m": self.noise_density_m,
            "cyclic_error_rad": {
                str(n): {"amplitude": size, "u": u_n} for n, size, u_n in self.cyclic
            },
        }
        if self.setting.kind == "heterodyne":
            return {**found, "carrier_hz": self.carrier_hz}
        found["ellipse"] = {
            "origin": self.origin,
            "centre": self.ellipse.centre.tolist(),
            "amplitudes": [first, second],
            "quadrature_error_rad": self.ellipse.quadrature_error_rad,
            "standard_uncertainties": dict(
                zip(("centre_1", "centre_2", "ratio", "quadrature"), u.tolist(), strict=True)
            ),
            "changes": self.changes,
        }
        return found
