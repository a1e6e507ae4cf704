"""Noise of a fit from the spectra of its residuals, as the result states it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vibrident.data.records import FloatArray


@dataclass(frozen=True, eq=False)
class SpectralNoise:
    """Noise from the spectra of the residuals.

    Attributes:
        reference: standard deviation of the noise of each record's reference channel itself, SI
            unit of the reference, zero if it is not significant, shape (records,); empty where it
            does not affect the estimate.
        doubt: fraction of z's standard deviation due to such noise where motion leaves no line
            free, 0 … 1, shape (p,); empty likewise.
        hum_hz: tones of each record's response that do not come from the motion.
        pulls: effect of such noise of each of these records on z, shape (k, p).
    """

    reference: FloatArray
    doubt: FloatArray
    hum_hz: tuple[tuple[float, ...], ...]
    pulls: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    def as_settings(self, names: Sequence[str]) -> dict[str, Any]:
        """Return the entries of a result; ``names`` are those of the parameters."""
        settings: dict[str, Any] = {}
        if self.doubt.size:
            settings["reference_noise_doubt"] = dict(zip(names, self.doubt.tolist(), strict=True))
        if (self.reference > 0.0).any():
            settings["reference_noise"] = self.reference.tolist()
        if any(self.hum_hz):
            settings["hum_hz"] = [list(tones) for tones in self.hum_hz]
        return settings


def doubtful(pulls: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the fraction of the standard deviations due to independent pulls, shape (p,).

    Args:
        pulls: shape (k, p).
        covariance: shape (p, p).
    """
    return np.sqrt(np.sum(pulls**2, axis=0) / np.maximum(np.diag(covariance), 1e-300))
