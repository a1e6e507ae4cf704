"""The noise that a fit found, as its result states it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vibrident.data.records import FloatArray


@dataclass(frozen=True, eq=False)
class SpectralNoise:
    """Noise by the spectra of the residuals.

    Attributes:
        reference: standard deviation of the noise of each record's reference channel itself, SI unit of the reference,
            zero if it is not significant, shape (records,); empty where it says nothing of the estimate.
        doubt: part of z's standard deviation for such noise where motion leaves no line free, 0 … 1, shape (p,); empty
            likewise.
        hum_hz: tones of each record's response that do not come from the motion.
        pulls: what such noise of each of these records does to z, shape (k, p).
    """

    reference: FloatArray
    doubt: FloatArray
    hum_hz: tuple[tuple[float, ...], ...]
    pulls: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    def as_settings(self, names: Sequence[str]) -> dict[str, Any]:
        """For a result; ``names``: of the parameters."""
        found: dict[str, Any] = {}
        if self.doubt.size:
            found["reference_noise_doubt"] = dict(zip(names, self.doubt.tolist(), strict=True))
        if (self.reference > 0.0).any():
            found["reference_noise"] = self.reference.tolist()
        if any(self.hum_hz):
            found["hum_hz"] = [list(tones) for tones in self.hum_hz]
        return found


def doubtful(pulls: FloatArray, covariance: FloatArray) -> FloatArray:
    """Part of the standard deviations that independent pulls, shape (k, p), make up, shape (p,)."""
    return np.sqrt(np.sum(pulls**2, axis=0) / np.maximum(np.diag(covariance), 1e-300))
