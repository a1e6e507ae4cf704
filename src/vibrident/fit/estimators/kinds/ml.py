"""The estimator ``ml``: maximum likelihood on the complex responses (:mod:`vibrident.fit.estimators.likelihood`)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from vibrident.fit.descent.optimise import Progress, silent
from vibrident.fit.estimators.base import Estimate, Estimator

if TYPE_CHECKING:
    from vibrident.fit.problem import Evidence


@dataclass(frozen=True)
class MaximumLikelihood(Estimator):
    """Settings of the estimator ``ml``.

    Attributes:
        model_error: where the deviations of sine records exceed what their noise and the stated systematic effects
            explain, a relative error of the model, the same at all frequencies, joins the noise (Mandel & Paule 1970),
            as large as the deviations demand. Points of very little noise then no longer rule, and the uncertainty
            covers the misfit. It is reported, and never applied to the stated uncertainties of a table.
    """

    name: ClassVar[str] = "ml"
    title: ClassVar[str] = "maximum likelihood"
    rank: ClassVar[int] = 1

    model_error: bool = True

    def suits(self, evidence: Evidence) -> str:
        """Tables, and sine records of linear models."""
        if evidence.calibration.table is not None:
            return "a table of responses with their uncertainties: weighted fit in magnitude and phase"
        if evidence.model.is_linear and evidence.only_sines:
            return "sine records: each tone is estimated in both channels, so noise on the reference does no harm"
        return ""

    def for_noise_alone(self) -> MaximumLikelihood:
        """Without a model error."""
        return replace(self, model_error=False)

    def fit(self, evidence: Evidence, progress: Progress = silent) -> Estimate:
        """Fit the model to the complex responses.

        Raises:
            ModelError: a record is not a sine, or the model is nonlinear; such motion needs the network.
        """
        from vibrident.fit.estimators import likelihood

        return likelihood.fit(self.name, evidence, progress)

    def where_rejected(self, evidence: Evidence, estimate: Estimate, progress: Progress = silent) -> Estimate | None:
        """With a model error beside the noise."""
        from vibrident.fit.estimators import likelihood

        return likelihood.with_random_effect(evidence, estimate, progress) if self.model_error else None


ML = MaximumLikelihood()
