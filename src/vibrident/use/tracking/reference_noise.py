"""White noise of the reference: its variance, its effect on the parameters, and its correction.

White noise of variance b in the reference, seen through a sensor H, and white noise of variance a
in the response give a residual of the spectrum a + b |H|². Both are estimated from its
autocovariance, weighted by Bartlett's (1946) for that spectrum. An output-error fit is then off by

    I⁻¹ N b Re⟨H* ∂H |A|²⟩ / σ²,

I the information, N rows, A the whitening, σ² the whitened variance, ⟨⟩ the mean over frequency
(Stoica & Söderström 1982).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.physics.models.slopes import response_and_slopes
from vibrident.use.tracking import information
from vibrident.use.tracking.detection import FURTHER_CHANGE_CHANCE
from vibrident.use.tracking.state import CERTAIN_IN_U, TrackedEstimate
from vibrident.use.tracking.tracker import Tracker

FREQUENCY_POINTS = 512  # frequencies of the means


@dataclass(frozen=True, eq=False)
class ReferenceNoise:
    """White noise of the reference."""

    variance: float  # b, in squared reference units
    u: float  # its standard uncertainty
    shift: FloatArray  # of the parameters by b, in the model's order and their units, shape (P,)
    chance: float  # of a residual as far from white noise of both channels as this one

    @property
    def certain(self) -> bool:
        """Return whether the noise is significant."""
        return self.variance > CERTAIN_IN_U * self.u

    @property
    def corrects(self) -> bool:
        """Return whether values can be corrected for it.

        They can where it is significant and white noise of both channels explains the residual.
        """
        return self.certain and self.chance > FURTHER_CHANGE_CHANCE

    def corrected(self, read: TrackedEstimate) -> TrackedEstimate:
        """Return an estimate without the noise's shift, whose uncertainty is included."""
        spread = np.outer(self.shift, self.shift) * (self.u / self.variance) ** 2
        covariance = read.covariance + spread
        values = np.array(list(read.values.values())) - self.shift
        return replace(
            read,
            values=dict(zip(read.values, values.tolist(), strict=True)),
            uncertainty=dict(zip(read.values, np.sqrt(np.diag(covariance)).tolist(), strict=True)),
            covariance=covariance,
        )


def estimate_reference_noise(tracker: Tracker) -> ReferenceNoise | None:
    """Estimate the noise since the last alarm, or return None if nothing was seen."""
    s = tracker.state
    net = tracker.network
    from scipy.stats import chi2  # slow to load

    rows = s.lags[0]
    k = net.nuisances
    if not (rows > 0.0 and s.noise[1] > 0.0):
        return None
    r = s.lags[2:] / rows
    turns = np.asarray((np.arange(FREQUENCY_POINTS) + 0.5) / (2.0 * FREQUENCY_POINTS), dtype=float)
    values = dict(zip(net.model.parameter_names, s.point[k:] * net.scale, strict=True))
    h, slopes = response_and_slopes(net.model, values, turns / net.interval_s, net.quantity)
    waves = np.cos(2.0 * np.pi * np.outer(np.arange(len(r)), turns))
    design = np.column_stack([waves.mean(axis=1), waves @ np.abs(h) ** 2 / FREQUENCY_POINTS])
    variances = np.linalg.lstsq(design / np.linalg.norm(design, axis=0), r, rcond=None)[
        0
    ] / np.linalg.norm(design, axis=0)
    for _ in range(2):
        spectrum = np.maximum(variances, 0.0) @ np.stack(
            [np.ones(FREQUENCY_POINTS), np.abs(h) ** 2]
        )
        weight = np.linalg.inv((waves * spectrum**2) @ waves.T * 2.0 / FREQUENCY_POINTS / rows)
        covariance = np.linalg.inv(design.T @ weight @ design)
        variances = covariance @ design.T @ weight @ r
    whitened = (
        np.abs(1.0 + np.exp(-2j * np.pi * np.outer(turns, np.arange(1, len(r)))) @ s.whitening) ** 2
    )
    pull = (
        np.mean((np.conj(slopes) * h).real * whitened, axis=1)
        * net.scale
        * s.noise[1] ** 2
        / s.noise[0]
    )
    shift = -information.covariance(s.root, k) @ pull * variances[1] * net.scale
    misfit = r - design @ variances
    chance = float(chi2.sf(misfit @ weight @ misfit, len(r) - 2))
    return ReferenceNoise(float(variances[1]), float(np.sqrt(covariance[1, 1])), shift, chance)
