"""Methods beside each other on the same data, or results of one sensor beside each other."""

from __future__ import annotations

import itertools
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard

from vibrident.base.brief import brief
from vibrident.base.errors import InputError, ModelError, NotConverged, unknown
from vibrident.base.fields import Fields, GivenFields, NamedNumbers
from vibrident.base.progress import SILENT, ProgressReporter
from vibrident.data.io import GivenCalibration, as_calibration
from vibrident.data.records import Calibration
from vibrident.fit.estimators import Estimator, ranked
from vibrident.fit.registry import ESTIMATORS
from vibrident.result import Result
from vibrident.result.loading import GivenResult, as_result
from vibrident.use.comparison import (
    COVERAGE_FACTOR,
    document,
    normalized_error,
    not_comparable,
    shared_covariance,
    shared_sources,
)
from vibrident.use.identification import identify
from vibrident.use.model_choice import Recommendation, recommendation
from vibrident.use.validation import cross_validate

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True)
class IdentificationMethod:
    """Way to identify the same data.

    Attributes:
        estimator: its name.
        model: name of the sensor model; None: that of the calibration.
        discretisation: of the network; None: the usual one.
    """

    estimator: str
    model: str | None = None
    discretisation: str | None = None

    @property
    def name(self) -> str:
        """Return what distinguishes it, in a line."""
        return " ".join(word for word in (self.estimator, self.discretisation, self.model) if word)

    @property
    def configured(self) -> str | Estimator:
        """Return the estimator, with its setting where there is one."""
        if self.discretisation is None:
            return self.estimator
        return ESTIMATORS[self.estimator].configured(discretisation=self.discretisation)


@dataclass(frozen=True, eq=False)
class Comparison:
    """Results of one sensor beside each other.

    Attributes:
        results: by name: of the method, or as they were given.
        truth: true values by parameter name; empty where they are not known.
        cross_validations: by name of the method: how well it predicts records that it was not
            fitted to.
    """

    results: Mapping[str, Result]
    truth: NamedNumbers = field(default_factory=dict)
    cross_validations: Mapping[str, GivenFields] = field(default_factory=dict)

    __repr__ = brief

    @property
    def recommendation(self) -> Recommendation:
        """Recommend a method, with the reason in words, if all results are of the same data."""
        return recommendation(self.results)

    def to_dataframe(self) -> DataFrame:
        """Return a row a result and parameter; deviations are from the truth, or the first."""
        import pandas as pd

        methods = self.to_dict()["methods"]
        rows = [
            {"method": method["name"], "parameter": name, **values}
            for method in methods
            for name, values in method["parameters"].items()
        ]
        return pd.DataFrame(rows).set_index(["method", "parameter"])

    def to_dict(self) -> dict[str, Any]:
        """Return what ``comparison.json`` says: plain values."""
        scores = {name: dict(score) for name, score in self.cross_validations.items()}
        return document(dict(self.results), dict(self.truth), scores)

    def normalized_error(self, parameter: str) -> dict[str, float | None]:
        """Return E_n of each further result against the first: two values agree where |E_n| ≤ 1.

        E_n = (value − first)/√(U² + U_first² − 2 k² cov), k = 2 (ISO 13528, GUM 5.2.2);
        the covariance is that of the stated sources that both share, such as the same reference.

        Args:
            parameter: name of a parameter of all results.

        Returns:
            By name of the result; None where E_n says nothing: of two evaluations of the same data,
            of two sensors, or without an uncertainty.

        Raises:
            InputError: a result has no such parameter.
        """
        first, *later_names = self.results
        values = {name: _value(result, name, parameter) for name, result in self.results.items()}
        shared = {
            name: shared_sources(named_result, parameter=parameter)
            for name, named_result in self.results.items()
        }
        errors: dict[str, float | None] = {}
        for name in later_names:
            pair = [values[name], values[first]]
            expanded_pair = [expanded for _, expanded in pair if expanded is not None]
            if len(expanded_pair) < 2 or not_comparable(self.results[name], self.results[first]):
                errors[name] = None
                continue
            covariance = shared_covariance(shared[name], shared[first])
            errors[name] = normalized_error(
                pair[0][0], expanded_pair[0], pair[1][0], expanded_pair[1], covariance
            )
        return errors


def compare(
    data: GivenCalibration | Mapping[str, GivenResult] | Sequence[GivenResult],
    *,
    estimators: Sequence[str] = (),
    models: Sequence[str] = (),
    discretisations: Sequence[str] = (),
    cross_validation: bool = False,
    truth: Mapping[str, float] | None = None,
) -> Comparison:
    """Compare methods on the same data, or earlier results of one sensor.

    Args:
        data: a calibration, or the path of its file, to be identified by each method; or results,
            or paths of their files, by name or in a sequence (then named "1", "2", …).
        estimators: names of estimators for a calibration; none: those of vibrident that suit it.
        models: names of sensor models for a calibration; none: its own.
        discretisations: of estimators that have one; none: the usual one.
        cross_validation: whether each fifth of the records is left out and predicted.
        truth: true values by parameter name, from which deviations are taken; None: from the first.

    Raises:
        InputError: there is nothing to compare, or methods are named for results.
        ModelError: a named estimator or model does not suit the data, or none does.
        NotConverged: no start of a fit leads to a finite one.

    Examples:
        >>> import vibrident
        >>> hz = [100, 300, 650, 1000]
        >>> calibration = vibrident.simulate(frequencies_hz=hz, samples=2000, response_noise=1e-3)
        >>> models = ["accelerometer", "accelerometer+delay"]
        >>> comparison = vibrident.compare(calibration, models=models, estimators=["ml"])
        >>> comparison.recommendation.method
        'ml accelerometer'
        >>> then, now = (vibrident.identify(calibration, estimator=name) for name in ("lsm", "ml"))
        >>> list(vibrident.compare({"then": then, "now": now}).normalized_error("sensitivity"))
        ['now']
    """
    if isinstance(data, Calibration) or _is_calibration_file(data):
        return compare_methods(
            as_calibration(data),
            estimators=estimators,
            models=models,
            discretisations=discretisations,
            cross_validation=cross_validation,
            truth=truth,
        )
    if named := [
        *estimators,
        *models,
        *discretisations,
        *(["cross_validation"] if cross_validation else []),
    ]:
        raise InputError(
            "Results cannot be compared by further methods.",
            expected="a calibration, or results without estimators, models and discretisations",
            found=", ".join(named),
            where="compare",
            remedy="leave them out, or give the calibration",
        )
    if isinstance(data, str | os.PathLike | Result):
        data = [data]
    named_results = (
        data if isinstance(data, Mapping) else {str(n): item for n, item in enumerate(data, 1)}
    )
    if not named_results:
        raise InputError(
            "There is nothing to compare.",
            expected="a calibration, or at least one result",
            found="none",
            where="compare",
            remedy="give results, or a calibration",
        )
    return Comparison(
        {name: as_result(result) for name, result in named_results.items()}, dict(truth or {})
    )


def compare_methods(
    calibration: Calibration,
    *,
    estimators: Sequence[str] = (),
    models: Sequence[str] = (),
    discretisations: Sequence[str] = (),
    cross_validation: bool = False,
    truth: NamedNumbers | None = None,
    progress: ProgressReporter = SILENT,
) -> Comparison:
    """Identify a calibration by each method, as :func:`compare` does, and report its progress."""
    methods = _valid_methods(
        estimators or [estimator.name for estimator in ranked(ESTIMATORS.built_in())],
        models or (None,),
        discretisations or (None,),
    )
    results = _identify_by_methods(calibration, methods, progress, must=bool(estimators))
    comparison = Comparison(results, dict(truth or {}))
    if not cross_validation or len(results) < 2:
        return comparison
    return replace(
        comparison,
        cross_validations=_cross_validate_methods(calibration, methods, results, progress),
    )


def with_setting(setting: str, names: Sequence[str]) -> tuple[str, ...]:
    """Return the names of those estimators that have a setting."""
    return tuple(name for name in names if setting in ESTIMATORS[name].settings)


def _is_calibration_file(data: object) -> TypeGuard[str | os.PathLike[str]]:
    return isinstance(data, str | os.PathLike) and Path(data).suffix.lower() == ".toml"


def _value(result: Result, name: str, parameter: str) -> tuple[float, float | None]:
    """Return value and expanded uncertainty of a parameter."""
    if parameter not in result.parameters:
        raise unknown(
            f"The result {name!r} has no such parameter.",
            parameter,
            list(result.parameters),
            "normalized_error",
        )
    estimate = result.parameters[parameter]
    u = estimate.standard_uncertainty
    return estimate.value, None if u is None else COVERAGE_FACTOR * u


def _valid_methods(
    estimators: Sequence[str],
    models: Sequence[str | None],
    steps: Sequence[str | None],
) -> list[IdentificationMethod]:
    """Return every valid combination: not every estimator has a discretisation."""
    stepping = with_setting("discretisation", estimators) if any(steps) else ()
    return [
        IdentificationMethod(name, model, step)
        for model, name in itertools.product(models, estimators)
        for step in (steps if name in stepping else (None,))
    ]


def _identify_by_methods(
    calibration: Calibration,
    methods: Sequence[IdentificationMethod],
    progress: ProgressReporter,
    *,
    must: bool,
) -> dict[str, Result]:
    """Return results by name; unnamed methods that do not suit the data are left out."""
    results: dict[str, Result] = {}
    failures: dict[str | None, ModelError | NotConverged] = {}
    for method in methods:
        progress.step(f"Identifying by {method.name}")
        try:
            results[method.name] = identify(
                calibration, method.model, method.configured, progress=progress
            )
        except (ModelError, NotConverged) as failure:
            if must or method.discretisation:
                raise
            failures.setdefault(method.model, failure)
            problem = failure.problem if isinstance(failure, ModelError) else str(failure)
            progress.note(f"Left out: {method.name}. {problem}")
    for model, failure in failures.items():
        if not any(m.model == model and m.name in results for m in methods):
            raise failure
    return results


def _cross_validate_methods(
    calibration: Calibration,
    methods: Sequence[IdentificationMethod],
    results: Mapping[str, Result],
    progress: ProgressReporter,
) -> dict[str, Fields]:
    scores = {}
    for method in methods:
        if method.name not in results:
            continue
        progress.step(f"Cross-validating {method.name}")
        score = cross_validate(
            calibration, results[method.name], method.configured, progress=progress
        )
        if score is not None:
            scores[method.name] = asdict(score)
    return scores
