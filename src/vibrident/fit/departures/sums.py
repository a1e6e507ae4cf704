"""Products of columns with the residual, each other, the Jacobian and known errors: all that a score test needs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np

from vibrident.data.records import FloatArray


@dataclass(frozen=True, eq=False)
class Errors:
    """Whitened errors of R records whose products sum to a covariance.

    Attributes:
        rounding: of the converters, which repeat with the motion, shape (R, 2 TRIALS, 2 K).
        effects: by one standard uncertainty of each stated effect, and, the last, of the variance of the reference's
            noise, shape (R, E, 2 K).
        doubt: part of the noise that one standard uncertainty of the reference's makes, shape (R, K).
    """

    rounding: FloatArray
    effects: FloatArray
    doubt: FloatArray

    def freed(self, free: Callable[[FloatArray], FloatArray]) -> Errors:
        """The same without what nuisance columns make of them."""
        return replace(self, rounding=free(self.rounding), effects=free(self.effects))

    @property
    def rows(self) -> FloatArray:
        """All of them, shape (R, 2 TRIALS + E, 2 K)."""
        return np.concatenate([self.rounding, self.effects], axis=1)


@dataclass(frozen=True, eq=False)
class Own:
    """What each of R records says of the coordinates.

    Attributes:
        normal: J Jᵀ, shape (R, P, P).
        inverse: of it, shape (R, P, P).
        gradient: J e, shape (R, P).
        chi2: sum of squares of the residual, shape (R,).
        freedom: degrees of freedom of the residual, shape (R,).
        optimum: where parameters of its own would move the coordinates, shape (R, P).
        quietest: least level of the noise in time over its mean, shape (R,).
    """

    normal: FloatArray
    inverse: FloatArray
    gradient: FloatArray
    chi2: FloatArray
    freedom: FloatArray
    optimum: FloatArray
    quietest: FloatArray

    def along(self, axis: int) -> Own:
        """The same with one more axis, to be held against arrays of records and places."""
        return Own(*(np.expand_dims(getattr(self, each.name), axis) for each in fields(self)))

    @classmethod
    def joined(cls, every: Sequence[Own]) -> Own:
        """Of the records of several groups."""
        return cls(
            *(np.concatenate([getattr(own, each.name) for own in every]) for each in fields(cls))
        )


@dataclass(frozen=True, eq=False)
class Sums:
    """What m columns have in common with the residual, each other and the Jacobian; those of records add up.

    Those of several records and places are stacked along axes in front.
    """

    score: FloatArray  # D e, shape (…, m)
    gram: FloatArray  # D Dᵀ, shape (…, m, m)
    cross: FloatArray  # D Jᵀ, shape (…, m, P)
    shift: FloatArray  # of the coordinates by a unit of each column, of records with their own, shape (…, m, P)
    least: FloatArray  # of D Dᵀ beside the parameters, below which a column tells nothing, shape (…, m)

    def _each(self, change: Callable[[str, FloatArray], FloatArray]) -> Self:
        return type(self)(
            **{each.name: change(each.name, getattr(self, each.name)) for each in fields(self)}
        )

    def at(self, places: Any) -> Self:
        """Return those of some of the places."""
        return self._each(lambda _, part: part[places])

    def total(self) -> Self:
        """Return those of columns whose amounts the records, along the first axis, share."""
        return self._each(lambda _, part: np.sum(part, axis=0))

    def __add__(self, other: Self) -> Self:
        return self._each(lambda name, part: part + getattr(other, name))

    def some(self, kept: Sequence[int]) -> Self:
        """Return those of some of the columns."""
        columns = list(kept)

        def chosen(name: str, part: FloatArray) -> FloatArray:
            if name in ("score", "least"):
                return part[..., columns]
            if name == "steps":
                return part
            part = part[..., columns, :]
            return part[..., columns] if name in ("gram", "spread") else part

        return self._each(chosen)

    def within(self, own: Own, inverse: FloatArray) -> Self:
        """Return the same beside parameters that are each record's alone: what differs within it (Chow 1960).

        Args:
            own: of the records, along the first axes as here.
            inverse: of the Jacobians of all records, shape (P, P), by which what is found moves the coordinates.
        """
        share = self.cross @ own.inverse
        score = self.score - (share @ own.gradient[..., None])[..., 0]
        gram = self.gram - share @ self.cross.mT
        nothing = np.zeros_like(self.cross)
        return replace(
            self, score=score, gram=gram, cross=nothing, shift=self.shift + self.cross @ inverse
        )


@dataclass(frozen=True, eq=False)
class Exact(Sums):
    """The same with the covariance V of the residual: of the few columns that the bound leaves."""

    spread: FloatArray  # D V Dᵀ without the known errors, shape (…, m, m)
    cross_spread: FloatArray  # D V Jᵀ, shape (…, m, P)
    common: (
        FloatArray  # D times the errors common to the record, or to all, shape (…, m, 2 TRIALS + E)
    )
    steps: FloatArray  # power of the errors of converters and interpolation, shape (…)

    def combined(self, factors: FloatArray) -> Exact:
        """Return the same of linear combinations of the columns, shape (combinations, m)."""
        return Exact(
            factors @ self.score,
            factors @ self.gram @ factors.T,
            factors @ self.cross,
            factors @ self.shift,
            factors**2 @ self.least,
            factors @ self.spread @ factors.T,
            factors @ self.cross_spread,
            factors @ self.common,
            self.steps,
        )

    def exactly_within(
        self, own: Own, inverse: FloatArray, profile: FloatArray, known: FloatArray
    ) -> Exact:
        """Return the same beside each record's own parameters.

        Args:
            own: of the records.
            inverse: as in :meth:`within`.
            profile: J V Jᵀ of the records, shape (R, P, P).
            known: J times the known errors, shape (R, P, 2 TRIALS + E).
        """
        share = self.cross @ own.inverse
        return replace(
            self.within(own, inverse),
            spread=self.spread_beside(share, profile),
            cross_spread=np.zeros_like(self.cross),
            common=self.common - share @ known,
        )

    def spread_beside(self, share: FloatArray, spread: FloatArray) -> FloatArray:
        """Return D V Dᵀ less what parameters make of it; ``share``: D Jᵀ A⁻¹."""
        both = share @ self.cross_spread.mT
        return self.spread - both - both.mT + share @ spread @ share.mT
