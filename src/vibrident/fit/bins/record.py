"""Residual and slopes of a record at its bins, for a covariance from the record's spectrum."""

from __future__ import annotations

from dataclasses import dataclass

from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.response.response import ComplexArray


@dataclass(frozen=True, eq=False)
class RecordBins:
    """Bins of one record of N samples, in units of the noise that weighted it.

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
        """Return the number of samples."""
        return int(self.used.shape[0])

    @property
    def count(self) -> float:
        """Return the number of samples that are used."""
        return float(self.used.sum())
