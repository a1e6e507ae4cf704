"""The estimator ``ipnn``: the paper's network, with improvements (:mod:`vibrident.fit.estimators.training`)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar

from vibrident.base.errors import InputError
from vibrident.fit.descent.optimise import Progress, silent
from vibrident.fit.estimators.base import Estimate, Estimator, Setting
from vibrident.fit.estimators.network_settings import NetworkSettings

if TYPE_CHECKING:
    from vibrident.fit.problem import Evidence


@dataclass(frozen=True)
class Ipnn(NetworkSettings, Estimator):
    """The estimator ``ipnn``; its fields are those of :class:`NetworkSettings`."""

    title: ClassVar[str] = "the physics-informed network"
    rank: ClassVar[int] = 3
    settings: ClassVar[Mapping[str, Setting]] = MappingProxyType(
        {
            "discretisation": Setting(),
            "optimiser": Setting(default="lm"),
            "steps": Setting(needs=("optimiser", "adam")),
            "learning_rate": Setting(needs=("optimiser", "adam")),
            "residual": Setting(),
        }
    )
    trains_network: ClassVar[bool] = True

    def suits(self, evidence: Evidence) -> str:
        """Records that are no sines, or of a nonlinear model."""
        if evidence.calibration.table is not None:
            return ""
        if not evidence.model.is_linear:
            return "a model without transfer function: the network runs its equation in time"
        kinds = sorted({record.excitation for record in evidence.records})
        return f"excitation {', '.join(kinds)}: the network uses every sample of the motion"

    def configured(self, **settings: Any) -> Estimator:
        """The network with these settings; ``residual`` true: with a learned residual beside the physics.

        Raises:
            InputError: the learning rate is not between 0 and 1.
        """
        rate = settings.get("learning_rate")
        if rate is not None and not 0.0 < rate < 1.0:
            raise InputError(
                "The learning rate is not usable.",
                expected="a number between 0 and 1",
                found=repr(rate),
                where="--learning-rate",
                remedy="try 0.001",
            )
        beside = settings.pop("residual", False)
        physics = replace(self, **settings)
        if not beside:
            return physics
        from vibrident.fit.estimators.residual_network import ResidualIpnn

        return ResidualIpnn(physics=physics)

    def fit(self, evidence: Evidence, progress: Progress = silent) -> Estimate:
        """Train the network.

        Raises:
            ModelError: there are no records, or no record has a reference.
            InputError: no record is long enough.
        """
        from vibrident.fit.estimators import training

        return training.fit(self, evidence, progress)

    def where_rejected(self, evidence: Evidence, estimate: Estimate, progress: Progress = silent) -> Estimate | None:
        """The best overall fit: equal weights for all samples of a record."""
        from vibrident.fit.estimators import training

        return training.with_equal_weights(estimate)


IPNN = Ipnn()
