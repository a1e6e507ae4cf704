"""Products that a score test needs: of columns with residual, Jacobian, errors and each other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Self

import numpy as np

from vibrident.data.records import FloatArray

#: Columns of which nuisances and coordinates leave less than this part, in squares, tell nothing:
#: what is left is rounding.
MIN_UNFOLLOWED = 1e-7


@dataclass(frozen=True, eq=False)
class Errors:
    """Whitened errors of R records whose products sum to a covariance.

    Attributes:
        rounding: of the converters, which repeat with the motion, shape (R, 2 TRIALS, 2 K).
        effects: by one standard uncertainty of each stated effect, and, the last, of the variance
            of the reference's noise, shape (R, E, 2 K).
        doubt: part of the noise that one standard uncertainty of the reference's makes, shape (R,
            K).
    """

    rounding: FloatArray
    effects: FloatArray
    doubt: FloatArray

    def freed(self, free_rows: Callable[[FloatArray], FloatArray]) -> Errors:
        """Return the errors without what nuisance columns make of them.

        ``free_rows``: frees whitened rows from the nuisance columns.
        """
        return replace(self, rounding=free_rows(self.rounding), effects=free_rows(self.effects))

    @property
    def rows(self) -> FloatArray:
        """Return all errors, shape (R, 2 TRIALS + E, 2 K)."""
        return np.concatenate([self.rounding, self.effects], axis=1)


@dataclass(frozen=True, eq=False)
class RecordInformation:
    """Information of each of R records on the coordinates.

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

    def with_axis(self, axis: int) -> RecordInformation:
        """Return the information with one more axis, to broadcast over the places of records."""
        return RecordInformation(
            *(np.expand_dims(getattr(self, attribute.name), axis) for attribute in fields(self))
        )

    @classmethod
    def joined(cls, groups: Sequence[RecordInformation]) -> RecordInformation:
        """Return the information of the records of several groups."""
        return cls(
            *(
                np.concatenate([getattr(group, attribute.name) for group in groups])
                for attribute in fields(cls)
            )
        )


@dataclass(frozen=True, eq=False)
class Sums:
    """Products of m columns with the residual, each other and the Jacobian.

    Those of records add up. Those of several records and places are stacked along axes in front.

    Attributes:
        score: D e, shape (…, m).
        gram: D Dᵀ, shape (…, m, m).
        cross: D Jᵀ, shape (…, m, P).
        shift: shift of the coordinates per unit amount of each column, for records with
            coordinates of their own, shape (…, m, P).
        least: D Dᵀ beside the parameters below which a column tells nothing, shape (…, m).
    """

    score: FloatArray
    gram: FloatArray
    cross: FloatArray
    shift: FloatArray
    least: FloatArray

    def _map(self, change: Callable[[str, FloatArray], FloatArray]) -> Self:
        """Return the sums with each array changed; ``change``: of its name and itself."""
        return type(self)(
            **{
                attribute.name: change(attribute.name, getattr(self, attribute.name))
                for attribute in fields(self)
            }
        )

    def at(self, index: Any) -> Self:
        """Return the sums at an index along the axes of records and places."""
        return self._map(lambda _, array: array[index])

    def total(self) -> Self:
        """Return the sums of columns whose amounts the records, along the first axis, share."""
        return self._map(lambda _, array: np.sum(array, axis=0))

    def __add__(self, addend: Self) -> Self:
        return self._map(lambda name, array: array + getattr(addend, name))

    def of_columns(self, numbers: Sequence[int]) -> Self:
        """Return the sums of these columns alone."""
        columns = list(numbers)

        def select(name: str, array: FloatArray) -> FloatArray:
            if name in ("score", "least"):
                return array[..., columns]
            if name == "steps":
                return array
            array = array[..., columns, :]
            return array[..., columns] if name in ("gram", "spread") else array

        return self._map(select)

    def within(self, information: RecordInformation, inverse: FloatArray) -> Self:
        """Return the sums beside parameters of each record's own (Chow 1960).

        What differs within the record remains.

        Args:
            information: on the coordinates, of the records, along the first axes as here.
            inverse: of the Jacobians of all records, shape (P, P), by which amounts move the
                coordinates.
        """
        projection = self.cross @ information.inverse
        score = self.score - (projection @ information.gradient[..., None])[..., 0]
        gram = self.gram - projection @ self.cross.mT
        no_cross = np.zeros_like(self.cross)
        return replace(
            self, score=score, gram=gram, cross=no_cross, shift=self.shift + self.cross @ inverse
        )


@dataclass(frozen=True, eq=False)
class ExactSums(Sums):
    """Sums with the covariance V of the residual: of the few columns that the bound leaves."""

    spread: FloatArray  # D V Dᵀ without the known errors, shape (…, m, m)
    cross_spread: FloatArray  # D V Jᵀ, shape (…, m, P)
    #: D times the errors common to the record, or to all, shape (…, m, 2 TRIALS + E).
    common: FloatArray
    steps: FloatArray  # power of the errors of converters and interpolation, shape (…)

    def combined(self, factors: FloatArray) -> ExactSums:
        """Return the sums of linear combinations of the columns.

        ``factors``: shape (combinations, m).
        """
        return ExactSums(
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
        self,
        information: RecordInformation,
        inverse: FloatArray,
        profile: FloatArray,
        known: FloatArray,
    ) -> ExactSums:
        """Return the sums beside each record's own parameters, with their covariance.

        Args:
            information: on the coordinates, of the records.
            inverse: as in :meth:`within`.
            profile: J V Jᵀ of the records, shape (R, P, P).
            known: J times the known errors, shape (R, P, 2 TRIALS + E).
        """
        projection = self.cross @ information.inverse
        return replace(
            self.within(information, inverse),
            spread=self.spread_beside(projection, profile),
            cross_spread=np.zeros_like(self.cross),
            common=self.common - projection @ known,
        )

    def spread_beside(self, projection: FloatArray, spread: FloatArray) -> FloatArray:
        """Return D V Dᵀ less what parameters make of it; ``projection``: D Jᵀ A⁻¹."""
        product = projection @ self.cross_spread.mT
        return self.spread - product - product.mT + projection @ spread @ projection.mT
