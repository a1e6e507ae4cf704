"""Input and output of every estimator, and the choice of the one that suits the data."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from vibrident.base.errors import ModelError
from vibrident.fit.estimators.findings import Findings
from vibrident.fit.optimise import Progress, Trace, silent
from vibrident.fit.registry import AUTO, ESTIMATORS

if TYPE_CHECKING:
    from vibrident.data.records import FloatArray
    from vibrident.fit.descent.settle import InNoise
    from vibrident.fit.problem import Coordinates, Evidence, NetworkProblem
    from vibrident.fit.response import MeasuredResponse
    from vibrident.fit.start.start import Start


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
        settings: what was chosen, for the result alone.
        tones: the tones as last measured, with the start transient taken out; None without sine
            records.
        problem: the network over the records, where the estimator made one.
        equations: number of residuals in the cost.
        begin: the path from the grid to the start values.
        predicted: predicted response of every record at the optimum, NaN where it is not defined;
            None if not computed.
        criterion: the function that was minimised: of the residual of the network's ``samples``,
            the ``likelihood`` of the responses in frequency, or an ``other`` one.
        findings: of the estimator, beside the parameters.
        in_noise: records in the noise of the fit, for its judgement and for a joint fit; None for
            equal weights or points.
        rival_optima: other optima: by how much χ² is larger, and the parameters.
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
    criterion: Literal["samples", "likelihood", "other"] = "other"
    findings: Findings = field(default_factory=Findings)
    in_noise: InNoise | None = None
    rival_optima: tuple[tuple[float, dict[str, float]], ...] = ()


@dataclass(frozen=True)
class Setting:
    """A setting that a user may give to an estimator by name.

    Attributes:
        needs: name and value of another setting without which this one has no meaning.
        default: of the setting, in words; empty if there is no default.
    """

    needs: tuple[str, str] | None = None
    default: str = ""


@dataclass(frozen=True)
class Estimator(ABC):
    """A way to turn evidence into an estimate; its fields are its settings.

    A module of ``fit/estimators/kinds`` or ``paper/estimators`` holds one with its settings at
    their defaults, and so does an entry point.

    Attributes:
        name: in results, settings and on the command line.
        title: the estimator in a few words.
        rank: place in the order in which methods are compared and asked whether they suit, the
            lowest first.
        settings: what a user may set, by name; ``configured`` knows the names that are no field.
        trains_network: whether the result has weights of a network.
        for_one_calibration: whether its estimate can take no part in a joint fit.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    rank: ClassVar[int] = 100
    settings: ClassVar[Mapping[str, Setting]] = MappingProxyType({})
    trains_network: ClassVar[bool] = False
    for_one_calibration: ClassVar[bool] = False

    @abstractmethod
    def fit(self, evidence: Evidence, progress: Progress = silent) -> Estimate:
        """Identify the model's parameters.

        Raises:
            ModelError: model and data are not for this estimator.
            NotConverged: no start leads to a finite fit.
        """

    def where_rejected(
        self, evidence: Evidence, estimate: Estimate, progress: Progress = silent
    ) -> Estimate | None:
        """Return the replacement of an estimate whose model does not explain the data, if any.

        The residual by which the estimate was weighted is not noise then.
        """
        return None

    def suits(self, evidence: Evidence) -> str:
        """Return the reason to choose this estimator; empty: it is not chosen automatically."""
        return ""

    def for_noise_alone(self) -> Estimator:
        """Return the estimator whose uncertainty covers the noise alone, not the deviations."""
        return self

    def configured(self, **settings: Any) -> Estimator:
        """Return the estimator with these settings in place of its own.

        Raises:
            InputError: a value cannot be used.
        """
        return replace(self, **settings)


def ranked(names: Iterable[str] | None = None) -> tuple[Estimator, ...]:
    """Return estimators in the order in which methods are compared, with default settings.

    ``names``: of those to take; None for all.
    """
    chosen = ESTIMATORS.all().values() if names is None else map(ESTIMATORS.__getitem__, names)
    return tuple(sorted(chosen, key=lambda estimator: (estimator.rank, estimator.name)))


def choose(evidence: Evidence) -> tuple[Estimator, str]:
    """Return the estimator for these data, and the reason in words.

    Raises:
        ModelError: no estimator suits.
    """
    for estimator in ranked():
        if reason := estimator.suits(evidence):
            return estimator, f"{AUTO}: {reason}"
    raise ModelError(
        "No estimator suits these data.",
        expected="a table, or records with a reference",
        found=f"a model {evidence.model.name!r} with other data",
        where="⟦identify.estimator⟧",
        remedy="name the estimator",
    )
