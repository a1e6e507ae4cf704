"""Compare methods on the same data, as a shell or a page asks for it."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibrident.app.workflow.estimators import estimator, estimators_with
from vibrident.app.workflow.folder import write_json
from vibrident.app.workflow.made import SILENT, ProgressReporter, TaskOutput
from vibrident.base.errors import ModelError, NotConverged
from vibrident.fit.registry import ESTIMATORS

if TYPE_CHECKING:
    from vibrident.data.records import Calibration
    from vibrident.fit.estimators import Estimator
    from vibrident.result import Result


@dataclass(frozen=True)
class Method:
    """Method of identifying the same data.

    ``model``: None for that of the calibration; ``discretisation``: None for the usual one.
    """

    estimator: str
    model: str | None = None
    discretisation: str | None = None

    @property
    def name(self) -> str:
        """Return what distinguishes it, in a line."""
        return " ".join(part for part in (self.estimator, self.discretisation, self.model) if part)

    @property
    def chosen(self) -> str | Estimator:
        """Return the estimator, with its setting where there is one."""
        return estimator(self.estimator, {"discretisation": self.discretisation})


def compare(
    calibration: Calibration,
    folder: Path,
    *,
    estimators: Sequence[str] = (),
    models: Sequence[str] = (),
    discretisations: Sequence[str] = (),
    validate: bool = False,
    truth: Mapping[str, float] | None = None,
    tell: ProgressReporter = SILENT,
) -> tuple[TaskOutput, dict[str, Result]]:
    """Identify by each method and return the comparison, and the results by name.

    Args:
        calibration: the data of all.
        folder: for comparison.json and each result.
        estimators: their names; none for those of vibrident that suit the data.
        models: of sensors; none for the calibration's own.
        discretisations: of estimators that have one; none for the usual one.
        validate: whether each fifth of the records is left out and predicted.
        truth: true values by parameter name, as a reference.
        tell: who is told of the progress.

    Raises:
        ModelError: a named estimator does not suit the data, or none does.
        NotConverged: no start leads to a finite fit.
    """
    from vibrident.fit.estimators import ranked

    methods = _methods(
        estimators or [estimator_class.name for estimator_class in ranked(ESTIMATORS.built_in())],
        models or (None,),
        discretisations or (None,),
    )
    results = _identify_all(calibration, methods, tell, must=bool(estimators))
    scores = {}
    if validate and len(results) > 1:
        scores = _cross_validate_all(calibration, methods, results, tell)
    for name, result in results.items():
        result.save(folder / f"{name.replace(' ', '-').replace('+', '-')}.json")
    return write_comparison(results, folder, truth, scores), results


def write_comparison(
    results: Mapping[str, Result],
    folder: Path,
    truth: Mapping[str, float] | None = None,
    scores: Mapping[str, Mapping[str, Any]] | None = None,
) -> TaskOutput:
    """Write comparison.json of results by name, and return the comparison.

    ``scores``: name of a method → its cross-validation.
    """
    from vibrident.show import methods
    from vibrident.use.comparison import document

    known = dict(truth or {})
    left_out = {name: dict(s) for name, s in (scores or {}).items()}
    write_json(folder / "comparison.json", document(dict(results), known, left_out))
    blocks: tuple[Any, ...] = methods.compared(list(results.values()), list(results), known)
    if len({result.model for result in results.values()}) > 1:
        blocks += methods.models(results, left_out)
    return TaskOutput(blocks)


def _methods(
    estimators: Sequence[str],
    models: Sequence[str | None],
    steps: Sequence[str | None],
) -> list[Method]:
    """Return every valid combination: not every estimator has a discretisation."""
    stepping = estimators_with("discretisation", estimators) if any(steps) else ()
    return [
        Method(name, model, step)
        for model, name in itertools.product(models, estimators)
        for step in (steps if name in stepping else (None,))
    ]


def _identify_all(
    calibration: Calibration, methods: Sequence[Method], tell: ProgressReporter, *, must: bool
) -> dict[str, Result]:
    """Return results by name.

    Methods that do not suit the data are left out; a named one is an error.
    """
    from vibrident.use.identification import identify

    results: dict[str, Result] = {}
    failures: dict[str | None, ModelError | NotConverged] = {}
    for method in methods:
        tell.step(f"Identifying by {method.name}")
        try:
            results[method.name] = identify(calibration, method.model, method.chosen, progress=tell)
        except (ModelError, NotConverged) as failure:
            if must or method.discretisation:
                raise
            failures.setdefault(method.model, failure)
            problem = failure.problem if isinstance(failure, ModelError) else str(failure)
            tell.note(f"Left out: {method.name}. {problem}")
    for model, failure in failures.items():
        if not any(m.model == model and m.name in results for m in methods):
            raise failure
    return results


def _cross_validate_all(
    calibration: Calibration,
    methods: Sequence[Method],
    results: Mapping[str, Result],
    tell: ProgressReporter,
) -> dict[str, dict[str, Any]]:
    from vibrident.use.validation import cross_validate

    scores = {}
    for method in methods:
        if method.name not in results:
            continue
        tell.step(f"Cross-validating {method.name}")
        score = cross_validate(calibration, results[method.name], method.chosen, progress=tell)
        if score is not None:
            scores[method.name] = asdict(score)
    return scores
