"""Noise of the reference, from the part of the residual that has passed the sensor, what it does, and values without.

White noise of variance b in the reference, seen through a sensor H, and white noise of variance a in the response give
a residual of the spectrum a + b |H|². Both are estimated from its autocovariance, weighted by Bartlett's (1946) for
that spectrum. An output-error fit is then off by

    I⁻¹ N b Re⟨H* ∂H |A|²⟩ / σ²,

I the information, N rows, A the whitening, σ² the whitened variance, ⟨⟩ the mean over frequency (Stoica & Söderström
1982).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.physics.models.slopes import response_and_slopes
from vibrident.use.tracking import information
from vibrident.use.tracking.detection import FURTHER
from vibrident.use.tracking.state import CERTAIN, Estimate
from vibrident.use.tracking.tracker import Tracker

POINTS = 512  # frequencies of the means


@dataclass(frozen=True, eq=False)
class ReferenceNoise:
    """White noise of the reference."""

    variance: float  # b, in squared reference units
    u: float  # its standard uncertainty
    shift: FloatArray  # what b does to the parameters, in the model's order and their units, shape (P,)
    chance: float  # of a residual as far from white noise of both channels as this

    @property
    def certain(self) -> bool:
        """Whether it is there."""
        return self.variance > CERTAIN * self.u

    @property
    def corrects(self) -> bool:
        """Whether values can be corrected for it: it is there, and the residual is of such noise."""
        return self.certain and self.chance > FURTHER

    def corrected(self, read: Estimate) -> Estimate:
        """Values without its shift, the uncertainty of that included."""
        spread = np.outer(self.shift, self.shift) * (self.u / self.variance) ** 2
        covariance = read.covariance + spread
        values = np.array(list(read.values.values())) - self.shift
        return replace(
            read,
            values=dict(zip(read.values, values.tolist(), strict=True)),
            uncertainty=dict(zip(read.values, np.sqrt(np.diag(covariance)).tolist(), strict=True)),
            covariance=covariance,
        )


def reference_noise(tracker: Tracker) -> ReferenceNoise | None:
    """Of what was seen since the last alarm; None where nothing was."""
    s, net = tracker.state, tracker.network
    from scipy.stats import chi2  # slow to load

    rows, k = s.lags[0], net.nuisances
    if not (rows > 0.0 and s.noise[1] > 0.0):
        return None
    r = s.lags[2:] / rows
    turns = np.asarray((np.arange(POINTS) + 0.5) / (2.0 * POINTS), dtype=float)
    values = dict(zip(net.model.parameter_names, s.point[k:] * net.scale, strict=True))
    h, slopes = response_and_slopes(net.model, values, turns / net.interval_s, net.quantity)
    waves = np.cos(2.0 * np.pi * np.outer(np.arange(len(r)), turns))
    design = np.column_stack([waves.mean(axis=1), waves @ np.abs(h) ** 2 / POINTS])
    found = np.linalg.lstsq(design / np.linalg.norm(design, axis=0), r, rcond=None)[0] / np.linalg.norm(design, axis=0)
    for _ in range(2):
        spectrum = np.maximum(found, 0.0) @ np.stack([np.ones(POINTS), np.abs(h) ** 2])
        weight = np.linalg.inv((waves * spectrum**2) @ waves.T * 2.0 / POINTS / rows)
        covariance = np.linalg.inv(design.T @ weight @ design)
        found = covariance @ design.T @ weight @ r
    whitened = np.abs(1.0 + np.exp(-2j * np.pi * np.outer(turns, np.arange(1, len(r)))) @ s.whitening) ** 2
    pull = np.mean((np.conj(slopes) * h).real * whitened, axis=1) * net.scale * s.noise[1] ** 2 / s.noise[0]
    shift = -information.covariance(s.known, k) @ pull * found[1] * net.scale
    left = r - design @ found
    chance = float(chi2.sf(left @ weight @ left, len(r) - 2))
    return ReferenceNoise(float(found[1]), float(np.sqrt(covariance[1, 1])), shift, chance)
