"""The score test of a departure from the fit, and how far it moves the parameters.

With e the whitened residual and J the whitened Jacobian at the optimum, a departure adds columns D to the response.
With A = J Jᵀ and D⊥ = D − D Jᵀ A⁻¹ J (rows are signals),

    T = (D⊥e)ᵀ (D⊥ V D⊥ᵀ)⁻¹ (D⊥e),    α = (D⊥D⊥ᵀ)⁻¹ D⊥e,    Δz = A⁻¹ J Dᵀ α.

V is the covariance of e: the slow profile of the noise in time, the converters' errors that repeat with the motion, the
stated systematic effects, and what is not known of the reference's noise. T is χ² with as many degrees of freedom as
columns, and Δz what the stated coordinates have beyond those beside the departure (Rao 1948; Breusch & Pagan 1980;
White 1980).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from vibrident.base.tails import f_tail
from vibrident.data.records import FloatArray
from vibrident.fit.departures.part import Own, Part
from vibrident.fit.information import inverse_where_shown
from vibrident.fit.response.rounding import TRIALS

#: Columns of which the parameters leave less than this part, in squares, tell nothing: rounding of the projections.
WITHIN = 1e-7
#: Part of the covariance below which the converters count for nothing.
SMALLEST = 1e-3


@dataclass(frozen=True, eq=False)
class Sums:
    """What m columns have in common with the residual, each other and the Jacobian; those of records add up.

    Those of several places are stacked along axes in front.
    """

    score: FloatArray  # D e, shape (…, m)
    gram: FloatArray  # D Dᵀ, shape (…, m, m)
    spread: FloatArray  # D V Dᵀ without the converters' errors, shape (…, m, m)
    cross: FloatArray  # D Jᵀ, shape (…, m, P)
    cross_spread: FloatArray  # D V Jᵀ, shape (…, m, P)
    common: FloatArray  # D times the errors common to the record, or to all, shape (…, m, 2 TRIALS + K)
    shift: FloatArray  # of the coordinates by a unit of each column, of records with their own, shape (…, m, P)
    least: FloatArray  # of D Dᵀ beside the parameters, below which a column tells nothing, shape (…, m)
    steps: FloatArray  # power of the errors of converters and interpolation, shape (…)

    @classmethod
    def of(cls, part: Part, white: FloatArray, parameters: int, doubt: FloatArray | None = None) -> Sums:
        """Of whitened columns, shape (m, n).

        ``doubt``: what they have in common with an error of the reference's noise, shape (m,); None: they are linear in
        the motion, and :attr:`Part.effects` tells it.
        """
        loud, nothing = white * part.profile, np.zeros((len(white), parameters))
        common = part.in_common(white)
        if doubt is not None:
            common[:, -1] = doubt
        sums = cls(
            white @ part.residual,
            white @ white.T,
            loud @ white.T,
            white @ part.jacobian.T,
            loud @ part.jacobian.T,
            common,
            nothing,
            WITHIN * np.einsum("ij,ij->i", white, white),
            np.array(part.steps),
        )
        return sums.beside(part, parameters)

    @classmethod
    def stacked(cls, every: Sequence[Sums]) -> Sums:
        """Of places with as many columns each."""
        return cls(*(np.stack([getattr(one, each.name) for one in every]) for each in fields(cls)))

    @staticmethod
    def side_by_side(every: Sequence[Sums]) -> Sums:
        """Of all columns of several records together."""
        own = {each.name: [getattr(one, each.name) for one in every] for each in fields(Sums)}
        gram, spread, steps = (own.pop(name) for name in ("gram", "spread", "steps"))
        joined = {name: np.concatenate(columns) for name, columns in own.items()}
        return Sums(**joined, gram=_blocks(gram), spread=_blocks(spread), steps=np.sum(steps, axis=0))

    def beside(self, part: Part, parameters: int) -> Sums:
        """The same with the record's own parameters projected out, where it has any."""
        if part.pull is None:
            return self
        return self._without_own(part.own, self.cross @ part.own.inverse @ part.pull.T, parameters)

    def within(self, own: Own, inverse: FloatArray) -> Sums:
        """The same beside parameters that are the record's alone: what differs within it (Chow 1960).

        ``inverse``: of the Jacobians of all records, shape (P, P), by which what is found moves the coordinates.
        """
        if own.alone is not None:
            return self
        return self._without_own(own, self.cross @ inverse, len(inverse))

    def _without_own(self, own: Own, shift: FloatArray, parameters: int) -> Sums:
        share = self.cross @ own.inverse
        both = share @ self.cross_spread.mT
        nothing = np.zeros((*self.score.shape, parameters))
        return Sums(
            self.score - share @ own.gradient,
            self.gram - share @ self.cross.mT,
            self.spread - both - both.mT + share @ own.spread @ share.mT,
            nothing,
            nothing,
            self.common - share @ own.common,
            shift,
            self.least,
            self.steps,
        )

    def some(self, kept: Sequence[int]) -> Sums:
        """Of some of the columns."""
        every = list(kept)
        return Sums(
            self.score[..., every],
            self.gram[..., every, :][..., every],
            self.spread[..., every, :][..., every],
            self.cross[..., every, :],
            self.cross_spread[..., every, :],
            self.common[..., every, :],
            self.shift[..., every, :],
            self.least[..., every],
            self.steps,
        )

    def at(self, places: int | Sequence[int]) -> Sums:
        """Of some of the places."""
        return Sums(*(getattr(self, each.name)[places] for each in fields(self)))

    def __add__(self, other: Sums) -> Sums:
        return Sums(*(getattr(self, each.name) + getattr(other, each.name) for each in fields(self)))


def _blocks(every: Sequence[FloatArray]) -> FloatArray:
    """A matrix with these on its diagonal, each of shape (m, m)."""
    ends = np.cumsum([len(one) for one in every]).tolist()
    found = np.zeros((ends[-1], ends[-1]))
    for end, one in zip(ends, every, strict=True):
        found[end - len(one) : end, end - len(one) : end] = one
    return found


@dataclass(frozen=True, eq=False)
class Score:
    """A score test.

    Attributes:
        statistic: T.
        columns: its degrees of freedom.
        shift: of the coordinates, stated less without the departure, shape (P,).
        amounts: of the columns, shape (m,).
        chance: that noise has a T as large.
        explained: what the departure takes from the sum of squares, beyond one for each column: by it departures are
            ranked, as a misfit makes V and with it T uncertain.
    """

    statistic: float
    columns: int
    shift: FloatArray
    amounts: FloatArray
    chance: float
    explained: float


@dataclass(frozen=True, eq=False)
class LinearFit:
    """The fit at its optimum, linearised: what departures are tested against.

    Attributes:
        inverse: of J Jᵀ, shape (P, P).
        spread: J V Jᵀ, shape (P, P).
        gradient: J e, shape (P,).
        common: J times the common errors, shape (P, 2 TRIALS + K).
        chi2: sum of squares of the residual beside the parameters.
        freedom: its degrees of freedom.
        uncertainty: of the coordinates as stated, shape (P,).
        told: degrees of freedom behind the noise.
    """

    inverse: FloatArray
    spread: FloatArray
    gradient: FloatArray
    common: FloatArray
    chi2: float
    freedom: float
    uncertainty: FloatArray
    told: float = np.inf

    @classmethod
    def of(cls, every: Sequence[Own], uncertainty: FloatArray) -> LinearFit:
        """Of all parts; ``uncertainty``: of the coordinates as stated, shape (P,)."""
        count = len(uncertainty)
        normal, spread = np.zeros((2, count, count))
        gradient, common = np.zeros(count), np.zeros((count, every[0].common.shape[1]))
        chi2, freedom = 0.0, -float(count)
        for own in every:
            chi2 += own.chi2
            freedom += own.freedom
            if own.alone is None:
                normal += own.normal
                spread += own.spread
                gradient += own.gradient
                common += own.common
        inverse = inverse_where_shown(normal)
        chi2 -= float(gradient @ inverse @ gradient)
        return cls(inverse, spread, gradient, common, max(chi2, 0.0), max(freedom, 1.0), uncertainty)

    def optimum(self, every: Sequence[Own]) -> FloatArray:
        """Where the best coordinates are from those of the fit, shape (P,)."""
        alone = [own.alone for own in every if own.alone is not None]
        return np.asarray(np.sum([self.inverse @ self.gradient, *alone], axis=0))

    def test(self, sums: Sums) -> list[Score | None]:
        """The score test at each of stacked places; None where the parameters can follow the columns."""
        share = sums.cross @ self.inverse
        score, gram = sums.score - share @ self.gradient, sums.gram - share @ sums.cross.mT
        power = np.diagonal(gram, axis1=-2, axis2=-1)
        seen = power > sums.least
        both = share @ sums.cross_spread.mT
        spread = sums.spread - both - both.mT + share @ self.spread @ share.mT
        scale = np.where(seen, 1.0 / np.sqrt(np.where(seen, power, 1.0)), 0.0)
        values, vectors = np.linalg.eigh(gram * scale[..., None] * scale[..., None, :])
        kept = seen.any(axis=-1, keepdims=True) & (values > WITHIN * values[..., -1:])
        turn = np.where(kept[..., None], vectors.mT * scale[..., None, :], 0.0)
        turned, errors = (turn @ score[..., None])[..., 0], turn @ (sums.common - share @ self.common)
        covariance = turn @ spread @ turn.mT + errors @ errors.mT
        statistic = np.einsum("...i,...ij,...j", turned, np.linalg.pinv(covariance, 1e-9, hermitian=True), turned)
        parts = np.where(kept, turned / np.where(kept, values, 1.0), 0.0)
        amounts = (parts[..., None, :] @ turn)[..., 0, :]
        shift = (amounts[..., None, :] @ (share + sums.shift))[..., 0, :]
        explained = np.sum(turned * parts, axis=-1)
        repeated = np.sum(errors[..., : 2 * TRIALS] ** 2, axis=(-2, -1)) / np.maximum(
            np.trace(covariance, axis1=-2, axis2=-1), np.finfo(float).tiny
        )
        told = np.minimum((np.sqrt(TRIALS) / np.maximum(repeated, SMALLEST)) ** 2, self.told)
        columns = np.sum(kept, axis=-1)
        return [
            None
            if not m
            else Score(
                float(statistic[k]),
                m,
                shift[k],
                amounts[k],
                # converters or interpolation may do as much as what is rounded
                1.0
                if explained[k] < sums.steps[k]
                else self._chance(*map(float, (statistic[k], explained[k], m, told[k]))),
                float(explained[k]) - m,
            )
            for k, m in enumerate(columns.tolist())
        ]

    def moved(self, sums: Sums, sizes: FloatArray) -> FloatArray:
        """How far each column moves the coordinates, by the amounts that all have together, shape (m, P).

        ``sizes``: of the amounts that each showed by itself, shape (m,): standard deviations of a normal prior. Without
        it the common gain is not determined where each record has a gain of its own.
        """
        share = sums.cross @ self.inverse
        score, gram = sums.score - share @ self.gradient, sums.gram - share @ sums.cross.T
        amounts = sizes * np.linalg.solve(np.eye(len(sizes)) + sizes[:, None] * gram * sizes, sizes * score)
        return np.asarray(amounts[:, None] * (share + sums.shift))

    def _chance(self, statistic: float, explained: float, columns: float, told: float) -> float:
        """An F test against what the departure leaves, where that is more than noise.

        ``told``: degrees of freedom by which the covariance of the columns is known.
        """
        left = max(self.freedom - columns, 1.0)
        rest = max((self.chi2 - explained) / left, 1.0)
        return f_tail(columns, min(left, told), statistic / columns / rest)

    def impact(self, shift: FloatArray) -> float:
        """Largest shift of a coordinate, in its stated standard uncertainty."""
        return float(np.max(np.abs(shift) / np.maximum(self.uncertainty, np.finfo(float).tiny), initial=0.0))
