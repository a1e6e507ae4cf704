"""The score test of a departure from the fit, and how far it moves the parameters.

With e the whitened residual and J the whitened Jacobian at the optimum, a departure adds columns D to the response.
With A = J Jᵀ and D⊥ = D − D Jᵀ A⁻¹ J (rows are signals),

    T = (D⊥e)ᵀ (D⊥ V D⊥ᵀ)⁻¹ (D⊥e),    α = (D⊥D⊥ᵀ)⁻¹ D⊥e,    Δz = A⁻¹ J Dᵀ α.

V is the covariance of e: the slow profile of the noise in time, the converters' errors that repeat with the motion, the
stated systematic effects, and what is not known of the reference's noise. T is χ² with as many degrees of freedom as
columns, and Δz what the stated coordinates have beyond those beside the departure (Rao 1948; Breusch & Pagan 1980;
White 1980).

**Bound first.** V is at least the quietest level v of the profile, so T ≤ (D⊥e)ᵀ (D⊥D⊥ᵀ)⁻¹ (D⊥e) / v: what the
departure explains, over v. Sums of products by bins tell that; V is made for the few columns that the bound leaves.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from vibrident.base.tails import f_tail
from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.departures.sums import Exact, Own, Sums
from vibrident.fit.information import inverse_where_shown
from vibrident.fit.response.rounding import TRIALS

#: Columns of which the parameters leave less than this part, in squares, tell nothing: rounding of the projections.
WITHIN = 1e-7
#: Part of the covariance below which the converters count for nothing.
SMALLEST = 1e-3
#: Halvings of an interval in which the critical value of a test lies.
HALVINGS = 60


@dataclass(frozen=True, eq=False)
class Score:
    """A score test.

    Attributes:
        statistic: T.
        columns: its degrees of freedom.
        shift: of the coordinates, stated less without the departure, shape (P,).
        amounts: of the columns, shape (m,).
        deviations: standard deviations of the amounts, shape (m,).
        doubt: standard deviation of the shift, shape (P,).
        chance: that noise has a T as large.
        told: degrees of freedom by which V is known.
        explained: what the departure takes from the sum of squares, beyond one for each column: by it departures are
            ranked, as a misfit makes V and with it T uncertain.
    """

    statistic: float
    columns: int
    shift: FloatArray
    amounts: FloatArray
    deviations: FloatArray
    doubt: FloatArray
    chance: float
    told: float
    explained: float

    def known(self, column: int) -> float:
        """Return the amount of a column; zero where that is less than its standard deviation."""
        amount = float(self.amounts[column])
        return amount if abs(amount) > float(self.deviations[column]) else 0.0


def _nothing() -> FloatArray:
    return np.zeros((0, 0))


@dataclass(frozen=True, eq=False)
class LinearFit:
    """The fit at its optimum, linearised: what departures are tested against.

    Attributes:
        normal: J Jᵀ, shape (P, P).
        inverse: of it, shape (P, P).
        gradient: J e, shape (P,).
        chi2: sum of squares of the residual beside the parameters.
        freedom: its degrees of freedom.
        uncertainty: of the coordinates as stated, shape (P,).
        optimum: where the best coordinates are from those of the fit, shape (P,).
        told: degrees of freedom behind the noise.
        spread: covariance of J e by the noise's profile, shape (P, P); empty for a bound.
        common: J times the known errors, shape (P, 2 TRIALS + E); empty for a bound.
    """

    normal: FloatArray
    inverse: FloatArray
    gradient: FloatArray
    chi2: float
    freedom: float
    uncertainty: FloatArray
    optimum: FloatArray
    told: float = np.inf
    spread: FloatArray = field(default_factory=_nothing)
    common: FloatArray = field(default_factory=_nothing)

    @classmethod
    def of(cls, own: Own, uncertainty: FloatArray) -> LinearFit:
        """Of all records; ``uncertainty``: of the coordinates as stated, shape (P,)."""
        normal = np.sum(own.normal, axis=0)
        gradient = np.sum(own.gradient, axis=0)
        inverse = inverse_where_shown(normal)
        chi2 = max(float(np.sum(own.chi2) - gradient @ inverse @ gradient), 0.0)
        freedom = max(float(np.sum(own.freedom)) - len(uncertainty), 1.0)
        optimum = inverse @ gradient + np.sum(own.optimum, axis=0)
        return cls(normal, inverse, gradient, chi2, freedom, uncertainty, optimum)

    def beside_parameters(self, sums: Sums) -> tuple[FloatArray, FloatArray, FloatArray]:
        """D Jᵀ A⁻¹, D⊥e and D⊥D⊥ᵀ."""
        share = sums.cross @ self.inverse
        return share, sums.score - share @ self.gradient, sums.gram - share @ sums.cross.mT

    def explained(self, sums: Sums) -> tuple[FloatArray, FloatArray]:
        """What the columns of each place take from the sum of squares, and how many tell something; one by one."""
        _, score, gram = self.beside_parameters(sums)
        total = np.zeros(score.shape[:-1])
        columns = np.zeros(score.shape[:-1], dtype=int)
        for k in range(score.shape[-1]):
            pivot = gram[..., k, k]
            seen = pivot > sums.least[..., k]
            over = np.divide(1.0, pivot, out=np.zeros_like(pivot), where=seen)
            total += score[..., k] ** 2 * over
            columns += seen
            row = gram[..., k, k + 1 :] * over[..., None]
            score[..., k + 1 :] -= row * score[..., k, None]
            gram[..., k + 1 :, k + 1 :] -= row[..., :, None] * gram[..., k, None, k + 1 :]
        return total, columns

    def may_be(
        self, explained: FloatArray, columns: FloatArray, quietest: FloatArray, chance: float
    ) -> BoolArray:
        """Whether a test could have a chance below this one, shape as of the arguments."""
        ratio = explained / np.maximum(
            quietest * columns * self._left(explained, columns), np.finfo(float).tiny
        )
        numbers = np.unique(columns)
        critical = [
            critical_f(m, max(self.freedom - m, 1.0), chance) if m else np.inf
            for m in numbers.tolist()
        ]
        return (columns > 0) & (ratio > np.array(critical)[np.searchsorted(numbers, columns)])

    def _left(self, explained: FloatArray, columns: FloatArray) -> FloatArray:
        """Mean square that the columns leave, at least one."""
        left = np.maximum(self.freedom - columns, 1.0)
        return np.maximum((self.chi2 - explained) / left, 1.0)

    def test(self, sums: Exact) -> Score | None:
        """The score test of one place; None where the parameters can follow the columns."""
        share, score, gram = self.beside_parameters(sums)
        seen = np.diag(gram) > sums.least
        scale = np.where(seen, 1.0 / np.sqrt(np.where(seen, np.diag(gram), 1.0)), 0.0)
        values, vectors = np.linalg.eigh(gram * scale[:, None] * scale)
        kept = values > WITHIN * values[-1]
        if not seen.any():
            return None
        turn = vectors[:, kept].T * scale
        turned = turn @ score
        errors = turn @ (sums.common - share @ self.common)
        covariance = turn @ sums.spread_beside(share, self.spread) @ turn.T + errors @ errors.T
        statistic = float(turned @ np.linalg.pinv(covariance, 1e-9, hermitian=True) @ turned)
        parts = turned / values[kept]
        amounts = parts @ turn
        over = turn.T / values[kept]
        scatter = over @ covariance @ over.T
        moves = share + sums.shift
        doubt = np.sqrt(np.maximum(np.einsum("mp,mk,kp->p", moves, scatter, moves), 0.0))
        deviations = np.sqrt(np.maximum(np.diag(scatter), 0.0))
        explained = float(turned @ parts)
        columns = len(turned)
        repeated = float(np.sum(errors[:, : 2 * TRIALS] ** 2)) / max(
            np.trace(covariance), np.finfo(float).tiny
        )
        told = min(TRIALS / max(repeated, SMALLEST) ** 2, self.told)
        chance = 1.0  # converters or interpolation may do as much as what is rounded
        if explained >= float(sums.steps):
            chance = self.chance(statistic, explained, columns, told)
        shift = amounts @ moves
        return Score(
            statistic, columns, shift, amounts, deviations, doubt, chance, told, explained - columns
        )

    def chance(self, statistic: float, explained: float, columns: int, told: float) -> float:
        """Return the chance of a statistic as large: F against what the departure leaves, if that is more than noise.

        Args:
            statistic: T.
            explained: what the columns take from the sum of squares.
            columns: their number.
            told: degrees of freedom by which V is known.
        """
        left = max(self.freedom - columns, 1.0)
        rest = float(self._left(np.array(explained), np.array(columns)))
        return f_tail(columns, min(left, told), statistic / columns / rest)

    def impact(self, shift: FloatArray) -> float:
        """Largest shift of a coordinate, in its stated standard uncertainty."""
        return float(
            np.max(np.abs(shift) / np.maximum(self.uncertainty, np.finfo(float).tiny), initial=0.0)
        )


@functools.lru_cache(maxsize=256)
def critical_f(above: float, below: float, chance: float) -> float:
    """Value that an F of such degrees of freedom exceeds with this chance."""
    low = 0.0
    high = 1.0
    while f_tail(above, below, high) > chance and high < 1e12:
        low = high
        high = 4.0 * high
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if f_tail(above, below, middle) > chance else (low, middle)
        if high - low < 1e-3 * high:
            break
    return low


def shifts_beside(
    fit: LinearFit, sums: Sequence[Sums], sizes: Sequence[FloatArray]
) -> list[FloatArray]:
    """How far each column moves the coordinates, by the amounts that all have together, each of shape (m, P).

    The amounts of each record are eliminated from the normal equations in turn.

    Args:
        fit: all records without the departures.
        sums: of the columns of each record.
        sizes: of the amounts that each showed by itself, shape (m,): standard deviations of a normal prior. Without it
            the common gain is not determined where each record has a gain of its own.
    """
    normal = fit.normal.copy()
    gradient = fit.gradient.copy()
    solved = []
    for part, size in zip(sums, sizes, strict=True):
        ridged = np.eye(len(size)) + size[:, None] * part.gram * size
        both = np.concatenate([part.score[:, None], part.cross], axis=1)
        amounts = size[:, None] * np.linalg.solve(ridged, size[:, None] * both)
        gradient -= part.cross.T @ amounts[:, 0]
        normal -= part.cross.T @ amounts[:, 1:]
        solved.append(amounts)
    moved = inverse_where_shown(normal) @ gradient
    return [
        (amounts[:, 0] - amounts[:, 1:] @ moved)[:, None] * (part.cross @ fit.inverse + part.shift)
        for part, amounts in zip(sums, solved, strict=True)
    ]
