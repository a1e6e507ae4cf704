"""A record's residual and slopes at its bins, for a covariance by its own spectrum."""

from __future__ import annotations

from dataclasses import dataclass

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.response.response import ComplexArray


@dataclass(frozen=True, eq=False)
class RecordBins:
    """One record, N samples long, in units of the noise that it was weighted by.

    Attributes:
        residual: measured less network, shape (K,).
        jacobian: of the response with z, less what initial states could imitate, shape (P, K).
        used: shape (N,).
        counts: how often each bin counts in a sum over all, shape (K,).
        floor: lower limit of the residual's variance.
    """

    residual: ComplexArray
    jacobian: ComplexArray
    used: BoolArray
    counts: FloatArray
    floor: float

    @property
    def samples(self) -> int:
        """Number of samples."""
        return int(self.used.shape[0])

    @property
    def count(self) -> float:
        """Number of samples that are used."""
        return float(self.used.sum())
