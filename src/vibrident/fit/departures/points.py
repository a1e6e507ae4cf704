"""Points of a response (a table, or the tones of sines) as the score tests look at them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vibrident.data.records import FloatArray
from vibrident.fit.departures.rows import ROUNDING
from vibrident.fit.departures.score import MIN_UNFOLLOWED, LinearFit
from vibrident.fit.departures.sums import ExactSums
from vibrident.fit.information import inverse_where_shown
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.uncertainty.linearised import Linearised


@dataclass(frozen=True, eq=False)
class Point:
    """A place of a departure among points.

    Attributes:
        words: what it is there.
        changes: relative changes of the response at the points, shape (m, n).
        record: name of the record; None of all.
    """

    words: str
    changes: ComplexArray
    record: str | None = None


@dataclass(frozen=True, eq=False)
class PointsPart:
    """The fit at its points, linearised.

    Attributes:
        linear: two rows a point, or one where there is no phase, in standard deviations.
        common: what systematic effects of unknown amount add to each row, in standard deviations,
            shape (K, m).
        record: name of the record of each point, shape (n,).
        response: amplitude of the response at each, where that is known, shape (n,).
        transfer: sensitivity of the model to acceleration over its gain, shape (n,).
        noise_freedom: degrees of freedom behind the deviation of a point; infinite where that was
            stated.
        basis: orthonormal nuisance rows, shape (q, m).
    """

    linear: Linearised
    common: FloatArray
    record: tuple[str, ...]
    response: ComplexArray | None
    transfer: ComplexArray
    noise_freedom: float
    basis: FloatArray

    @property
    def frequency_hz(self) -> FloatArray:
        """Return the frequencies of the points, shape (n,)."""
        return self.linear.frequency_hz[: len(self.record)]

    def with_nuisances(self, point: Point) -> PointsPart:
        """Return the points with the columns of a place as nuisance rows."""
        rows = np.concatenate([self.basis, self._rows(point)])
        _, sizes, rotated = np.linalg.svd(rows, full_matrices=False)
        return replace(self, basis=rotated[sizes**2 > ROUNDING * np.max(sizes**2, initial=1e-300)])

    def _rows(self, point: Point) -> FloatArray:
        """Return the columns of a place in standard deviations, shape (columns, m)."""
        parts = np.concatenate([point.changes.real, point.changes.imag], axis=1)[
            :, : len(self.linear.residual)
        ]
        return parts * self.linear.weight

    def _freed(self, rows: FloatArray) -> FloatArray:
        """Return rows less their nuisance rows."""
        return rows - (rows @ self.basis.T) @ self.basis

    def fit(self, uncertainty: FloatArray) -> LinearFit:
        """Return the linearised fit; ``uncertainty``: of the coordinates as stated, shape (P,)."""
        rows = self._freed(self.linear.matrix.T)
        residual = self._freed(self.linear.residual)
        normal = rows @ rows.T
        gradient = rows @ residual
        inverse = inverse_where_shown(normal)
        chi2 = max(float(residual @ residual - gradient @ inverse @ gradient), 0.0)
        freedom = float(max(len(residual) - len(uncertainty) - len(self.basis), 1))
        common = rows @ self.common.T
        optimum = inverse @ gradient
        return LinearFit(
            normal,
            inverse,
            gradient,
            chi2,
            freedom,
            uncertainty,
            optimum,
            self.noise_freedom,
            normal,
            common,
        )

    def sums(self, point: Point) -> ExactSums:
        """Return the products of the columns of a place with the fit."""
        rows = self._rows(point)
        freed = self._freed(rows)
        gram = freed @ freed.T
        cross = freed @ self.linear.matrix
        least = MIN_UNFOLLOWED * np.einsum("ij,ij->i", rows, rows)
        no_shift = np.zeros_like(cross)
        no_steps = np.zeros(())
        return ExactSums(
            freed @ self.linear.residual,
            gram,
            cross,
            no_shift,
            least,
            gram,
            cross,
            freed @ self.common.T,
            no_steps,
        )
