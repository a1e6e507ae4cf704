"""What every estimator takes and gives."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from vibrident.errors import ModelError
from vibrident.estimators.optimise import Progress, Trace
from vibrident.estimators.start import Start
from vibrident.measure import MeasuredResponse
from vibrident.models import SensorModel
from vibrident.problem import Coordinates, Evidence, NetworkProblem
from vibrident.records import FloatArray


@dataclass(frozen=True, eq=False)
class Estimate:
    """Parameters and their covariance, before they become a result.

    Attributes:
        estimator: its name.
        coordinates: the map from z to physical parameters.
        z: the optimum, shape (p,).
        covariance: of z, from the noise alone, shape (p, p).
        degrees_of_freedom: behind the noise estimate; infinite where uncertainties were stated.
        trace: of the optimiser.
        settings: what was chosen.
        tones: the tones as last measured, with the start transient taken out; None without sine records.
        problem: the network over the records, where the estimator made one.
        equations: number of residuals in the cost.
        begin: the way from the grid to the start values.
        predicted: predicted response of every record at the optimum, NaN where there is none, where it is at hand.
        if_rejected: makes the estimate to take where the model does not explain the data, so that the residual is no
            noise to weigh by; None where it is this one.
    """

    estimator: str
    coordinates: Coordinates
    z: FloatArray
    covariance: FloatArray
    degrees_of_freedom: float
    trace: Trace
    settings: Mapping[str, Any] = field(default_factory=dict)
    tones: MeasuredResponse | None = None
    problem: NetworkProblem | None = None
    predicted: tuple[FloatArray, ...] | None = None
    begin: Start | None = None
    equations: float = 1.0
    if_rejected: Callable[[], Estimate] | None = None


def refuse_nonlinear(model: SensorModel, estimator: str) -> None:
    """Refuse a model without transfer function where the estimator works on one.

    Raises:
        ModelError: the model is not linear.
    """
    if not model.is_linear:
        raise ModelError(
            f"The estimator {estimator!r} works in frequency, and this model has no transfer function.",
            expected="the estimator 'ipnn' (or 'auto') with [[records]], which hold the motion in time",
            found=f"estimator {estimator!r} with {model.name!r}",
            where="estimator",
            remedy="use the estimator 'ipnn' with records, or a linear model",
        )


class Estimator(Protocol):
    """A way to turn evidence into an estimate."""

    @property
    def name(self) -> str:
        """Name in settings and on the command line."""
        ...

    def fit(self, evidence: Evidence, progress: Progress) -> Estimate:
        """Identify the model's parameters."""
        ...
