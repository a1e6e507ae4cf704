"""Points of a response (a table, or the tones of sines) as the score tests look at them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.departures.candidate import Candidate
from vibrident.fit.departures.part import orthonormal
from vibrident.fit.departures.score import WITHIN, LinearFit, Sums
from vibrident.fit.information import inverse_where_shown
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.uncertainty.linearised import Linearised


@dataclass(frozen=True, eq=False)
class PointsPart:
    """The fit at its points, linearised.

    Attributes:
        linear: two rows a point, or one where there is no phase, in standard deviations.
        common: what systematic effects of unknown amount add to each row, in standard deviations, shape (K, m).
        record: name of the record of each point, shape (n,).
        response: amplitude of the response at each, where that is known, shape (n,).
        transfer: sensitivity of the model to acceleration over its gain, shape (n,).
        told: degrees of freedom behind the standard deviation of a point; infinite where it was stated.
        basis: orthonormal nuisance rows, shape (q, m).
    """

    linear: Linearised
    common: FloatArray
    record: tuple[str, ...]
    response: ComplexArray | None
    transfer: ComplexArray
    told: float
    basis: FloatArray

    @property
    def frequency_hz(self) -> FloatArray:
        """Of the points, shape (n,)."""
        return self.linear.frequency_hz[: len(self.record)]

    def beside(self, rows: FloatArray) -> PointsPart:
        """The same with more nuisance rows, in standard deviations, shape (q, m)."""
        return replace(self, basis=orthonormal(np.concatenate([self.basis, rows])))

    def _freed(self, rows: FloatArray) -> FloatArray:
        return rows - (rows @ self.basis.T) @ self.basis

    def fit(self, uncertainty: FloatArray) -> LinearFit:
        """The linearised fit; ``uncertainty``: of the coordinates as stated, shape (P,)."""
        rows, rest = self._freed(self.linear.matrix.T), self._freed(self.linear.rest)
        normal, gradient = rows @ rows.T, rows @ rest
        inverse = inverse_where_shown(normal)
        chi2 = max(float(rest @ rest - gradient @ inverse @ gradient), 0.0)
        freedom = float(max(len(rest) - len(uncertainty) - len(self.basis), 1))
        return LinearFit(inverse, normal, gradient, rows @ self.common.T, chi2, freedom, uncertainty, self.told)

    def place(self, words: str, changes: ComplexArray, record: str | None = None) -> tuple[Candidate, Sums]:
        """A departure by relative changes of the response at the points, shape (m, n)."""
        parts = np.concatenate([changes.real, changes.imag], axis=1)[:, : len(self.linear.rest)]
        rows = parts * self.linear.weight
        least, freed = WITHIN * np.einsum("ij,ij->i", rows, rows), self._freed(rows)
        gram, cross = freed @ freed.T, freed @ self.linear.matrix
        nothing = np.zeros((len(rows), self.linear.matrix.shape[1]))
        rounding = freed @ self.common.T
        sums = Sums(freed @ self.linear.rest, gram, gram, cross, cross, rounding, nothing, least, np.array(0.0))
        return Candidate(words, record=record, rows=rows), sums
