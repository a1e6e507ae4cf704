"""The score test of a departure from the fit, and how far it moves the parameters.

With e the whitened residual and J the whitened Jacobian at the optimum, a departure adds columns D
to the response. With A = J Jᵀ and D⊥ = D − D Jᵀ A⁻¹ J (rows are signals),

    T = (D⊥e)ᵀ (D⊥ V D⊥ᵀ)⁻¹ (D⊥e),    α = (D⊥D⊥ᵀ)⁻¹ D⊥e,    Δz = A⁻¹ J Dᵀ α.

V is the covariance of e: the slow profile of the noise in time, the converters' errors that repeat
with the motion, the stated systematic effects, and what is not known of the reference's noise. T is
χ² with as many degrees of freedom as columns, and Δz what the stated coordinates have beyond those
beside the departure (Rao 1948; Breusch & Pagan 1980; White 1980).

**Bound first.** V is at least the quietest level v of the profile, so T ≤ (D⊥e)ᵀ (D⊥D⊥ᵀ)⁻¹ (D⊥e) /
v: what the departure explains, over v. Sums of products by bins tell that; V is made for the few
columns that the bound leaves.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from vibrident.base.tails import f_tail
from vibrident.data.records import BoolArray, FloatArray
from vibrident.fit.departures.sums import MIN_UNFOLLOWED, ExactSums, RecordInformation, Sums
from vibrident.fit.information import inverse_where_shown
from vibrident.fit.response.rounding import TRIALS

#: Part of the covariance below which the converters count for nothing.
MIN_ROUNDING_SHARE = 1e-3
#: Halvings of an interval in which the critical value of a test lies.
MAX_HALVINGS = 60


@dataclass(frozen=True, eq=False)
class Score:
    """A score test of a departure.

    Attributes:
        statistic: T.
        columns: its degrees of freedom.
        shift: of the coordinates, stated less without the departure, shape (P,).
        amounts: of the columns, shape (m,).
        deviations: standard deviations of the amounts, shape (m,).
        doubt: standard deviation of the shift, shape (P,).
        chance: that noise has a T as large.
        noise_freedom: degrees of freedom by which V is known.
        explained: what the departure takes from the sum of squares, beyond one for each column: by
            it departures are ranked, as a misfit makes V and with it T uncertain.
    """

    statistic: float
    columns: int
    shift: FloatArray
    amounts: FloatArray
    deviations: FloatArray
    doubt: FloatArray
    chance: float
    noise_freedom: float
    explained: float

    def known(self, column: int) -> float:
        """Return the amount of a column; zero where that is less than its standard deviation."""
        amount = float(self.amounts[column])
        return amount if abs(amount) > float(self.deviations[column]) else 0.0


def _empty_matrix() -> FloatArray:
    """Return a matrix without entries."""
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
        noise_freedom: degrees of freedom behind the noise.
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
    noise_freedom: float = np.inf
    spread: FloatArray = field(default_factory=_empty_matrix)
    common: FloatArray = field(default_factory=_empty_matrix)

    @classmethod
    def from_records(cls, records: RecordInformation, uncertainty: FloatArray) -> LinearFit:
        """Join the information of all records.

        ``uncertainty``: of the coordinates as stated, shape (P,).
        """
        normal = np.sum(records.normal, axis=0)
        gradient = np.sum(records.gradient, axis=0)
        inverse = inverse_where_shown(normal)
        chi2 = max(float(np.sum(records.chi2) - gradient @ inverse @ gradient), 0.0)
        freedom = max(float(np.sum(records.freedom)) - len(uncertainty), 1.0)
        optimum = inverse @ gradient + np.sum(records.optimum, axis=0)
        return cls(normal, inverse, gradient, chi2, freedom, uncertainty, optimum)

    def beside_parameters(self, sums: Sums) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return D Jᵀ A⁻¹, D⊥e and D⊥D⊥ᵀ."""
        projection = sums.cross @ self.inverse
        return (
            projection,
            sums.score - projection @ self.gradient,
            sums.gram - projection @ sums.cross.mT,
        )

    def explained(self, sums: Sums) -> tuple[FloatArray, FloatArray]:
        """Return the sum of squares that each place's columns take, and their number.

        The columns are eliminated one by one; those that tell nothing do not count.
        """
        _, score, gram = self.beside_parameters(sums)
        total = np.zeros(score.shape[:-1])
        columns = np.zeros(score.shape[:-1], dtype=int)
        for k in range(score.shape[-1]):
            pivot = gram[..., k, k]
            independent = pivot > sums.least[..., k]
            reciprocal = np.divide(1.0, pivot, out=np.zeros_like(pivot), where=independent)
            total += score[..., k] ** 2 * reciprocal
            columns += independent
            row = gram[..., k, k + 1 :] * reciprocal[..., None]
            score[..., k + 1 :] -= row * score[..., k, None]
            gram[..., k + 1 :, k + 1 :] -= row[..., :, None] * gram[..., k, None, k + 1 :]
        return total, columns

    def may_be_significant(
        self, explained: FloatArray, columns: FloatArray, quietest: FloatArray, chance: float
    ) -> BoolArray:
        """Return whether a test could have a chance below this one, shape as of the arguments."""
        ratio = explained / np.maximum(
            quietest * columns * self._remaining_mean_square(explained, columns),
            np.finfo(float).tiny,
        )
        column_numbers = np.unique(columns)
        critical = [
            critical_f(number, max(self.freedom - number, 1.0), chance) if number else np.inf
            for number in column_numbers.tolist()
        ]
        return (columns > 0) & (
            ratio > np.array(critical)[np.searchsorted(column_numbers, columns)]
        )

    def _remaining_mean_square(self, explained: FloatArray, columns: FloatArray) -> FloatArray:
        """Return the mean square that the columns leave, at least one."""
        freedom = np.maximum(self.freedom - columns, 1.0)
        return np.maximum((self.chi2 - explained) / freedom, 1.0)

    def test(self, sums: ExactSums) -> Score | None:
        """Return the score test of one place; None where the parameters can follow its columns."""
        projection, score, gram = self.beside_parameters(sums)
        independent = np.diag(gram) > sums.least
        scale = np.where(independent, 1.0 / np.sqrt(np.where(independent, np.diag(gram), 1.0)), 0.0)
        values, vectors = np.linalg.eigh(gram * scale[:, None] * scale)
        resolved = values > MIN_UNFOLLOWED * values[-1]
        if not independent.any():
            return None
        rotation = vectors[:, resolved].T * scale
        rotated_score = rotation @ score
        errors = rotation @ (sums.common - projection @ self.common)
        covariance = (
            rotation @ sums.spread_beside(projection, self.spread) @ rotation.T + errors @ errors.T
        )
        statistic = float(
            rotated_score @ np.linalg.pinv(covariance, 1e-9, hermitian=True) @ rotated_score
        )
        scaled_score = rotated_score / values[resolved]
        amounts = scaled_score @ rotation
        back_rotation = rotation.T / values[resolved]
        scatter = back_rotation @ covariance @ back_rotation.T
        shift_by_column = projection + sums.shift
        doubt = np.sqrt(
            np.maximum(np.einsum("mp,mk,kp->p", shift_by_column, scatter, shift_by_column), 0.0)
        )
        deviations = np.sqrt(np.maximum(np.diag(scatter), 0.0))
        explained = float(rotated_score @ scaled_score)
        columns = len(rotated_score)
        rounding_share = float(np.sum(errors[:, : 2 * TRIALS] ** 2)) / max(
            np.trace(covariance), np.finfo(float).tiny
        )
        noise_freedom = min(
            TRIALS / max(rounding_share, MIN_ROUNDING_SHARE) ** 2, self.noise_freedom
        )
        chance = 1.0  # where rounding or interpolation may explain as much
        if explained >= float(sums.steps):
            chance = self.chance(statistic, explained, columns, noise_freedom)
        shift = amounts @ shift_by_column
        return Score(
            statistic,
            columns,
            shift,
            amounts,
            deviations,
            doubt,
            chance,
            noise_freedom,
            explained - columns,
        )

    def chance(
        self, statistic: float, explained: float, columns: int, noise_freedom: float
    ) -> float:
        """Return the chance of a statistic as large: F against what the departure leaves.

        What it leaves counts where it is more than noise.

        Args:
            statistic: T.
            explained: what the columns take from the sum of squares.
            columns: their number.
            noise_freedom: degrees of freedom by which V is known.
        """
        freedom = max(self.freedom - columns, 1.0)
        mean_square = float(self._remaining_mean_square(np.array(explained), np.array(columns)))
        return f_tail(columns, min(freedom, noise_freedom), statistic / columns / mean_square)

    def impact(self, shift: FloatArray) -> float:
        """Return the largest shift of a coordinate, in its stated standard uncertainty."""
        return float(
            np.max(np.abs(shift) / np.maximum(self.uncertainty, np.finfo(float).tiny), initial=0.0)
        )


@functools.lru_cache(maxsize=256)
def critical_f(above: float, below: float, chance: float) -> float:
    """Return the value that an F of such degrees of freedom exceeds with this chance."""
    low = 0.0
    high = 1.0
    while f_tail(above, below, high) > chance and high < 1e12:
        low = high
        high = 4.0 * high
    for _ in range(MAX_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if f_tail(above, below, middle) > chance else (low, middle)
        if high - low < 1e-3 * high:
            break
    return low


def shifts_beside(
    fit: LinearFit, sums: Sequence[Sums], sizes: Sequence[FloatArray]
) -> list[FloatArray]:
    """Return how far each column moves the coordinates, each of shape (m, P).

    It does so by the amounts that all have together. The amounts of each record are eliminated from
    the normal equations in turn.

    Args:
        fit: all records without the departures.
        sums: of the columns of each record.
        sizes: of the amounts that each showed by itself, shape (m,): standard deviations of a
            normal prior. Without it the common gain is not determined where each record has a gain
            of its own.
    """
    normal = fit.normal.copy()
    gradient = fit.gradient.copy()
    amounts_by_record = []
    for record_sums, deviation in zip(sums, sizes, strict=True):
        normal_matrix = np.eye(len(deviation)) + deviation[:, None] * record_sums.gram * deviation
        right_sides = np.concatenate([record_sums.score[:, None], record_sums.cross], axis=1)
        amounts = deviation[:, None] * np.linalg.solve(
            normal_matrix, deviation[:, None] * right_sides
        )
        gradient -= record_sums.cross.T @ amounts[:, 0]
        normal -= record_sums.cross.T @ amounts[:, 1:]
        amounts_by_record.append(amounts)
    optimum = inverse_where_shown(normal) @ gradient
    return [
        (amounts[:, 0] - amounts[:, 1:] @ optimum)[:, None]
        * (record_sums.cross @ fit.inverse + record_sums.shift)
        for record_sums, amounts in zip(sums, amounts_by_record, strict=True)
    ]
