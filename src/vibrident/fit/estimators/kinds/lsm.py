"""The estimator ``lsm``: the paper's least squares on 1/H (:mod:`vibrident.fit.estimators.inverse_response`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar, Literal

from vibrident.fit.descent.optimise import Progress, silent
from vibrident.fit.estimators.base import Estimate, Estimator, Setting

if TYPE_CHECKING:
    from vibrident.fit.problem import Evidence


@dataclass(frozen=True)
class LeastSquares(Estimator):
    """Settings of the estimator ``lsm``.

    Attributes:
        weighting: ``weighted`` by the uncertainty of 1/H, or ``plain`` as in the paper.
    """

    name: ClassVar[str] = "lsm"
    title: ClassVar[str] = "least squares on the response"
    rank: ClassVar[int] = 2
    settings: ClassVar[Mapping[str, Setting]] = MappingProxyType({"weighting": Setting()})

    weighting: Literal["plain", "weighted"] = "weighted"

    def fit(self, evidence: Evidence, progress: Progress = silent) -> Estimate:
        """Fit 1/H.

        Raises:
            ModelError: there is no phase, a record is not a sine, or the model is nonlinear.
        """
        from vibrident.fit.estimators import inverse_response

        return inverse_response.fit(self.name, self.weighting, evidence, progress)


LSM = LeastSquares()
