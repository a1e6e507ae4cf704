"""Methods beside each other on the same data, as a shell or a page asks for them."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibrident.app.workflow.estimators import estimator, estimators_with
from vibrident.app.workflow.folder import write_json
from vibrident.app.workflow.made import SILENT, Made, Teller
from vibrident.base.errors import ModelError, NotConverged
from vibrident.fit.registry import ESTIMATORS

if TYPE_CHECKING:
    from vibrident.data.records import Calibration
    from vibrident.fit.estimators import Estimator
    from vibrident.result import Result


@dataclass(frozen=True)
class Method:
    """One way to identify the same data; None: the model of the calibration, the usual discretisation."""

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
    tell: Teller = SILENT,
) -> tuple[Made, dict[str, Result]]:
    """Identify by each method and return what that says, and the results by name.

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
        estimators or [one.name for one in ranked(ESTIMATORS.built_in())],
        models or (None,),
        discretisations or (None,),
    )
    results = _identified(calibration, methods, tell, must=bool(estimators))
    scores = {}
    if validate and len(results) > 1:
        scores = _cross_validated(calibration, methods, results, tell)
    for name, result in results.items():
        result.save(folder / f"{name.replace(' ', '-').replace('+', '-')}.json")
    return compared(results, folder, truth, scores), results


def compared(
    results: Mapping[str, Result],
    folder: Path,
    truth: Mapping[str, float] | None = None,
    scores: Mapping[str, Mapping[str, Any]] | None = None,
) -> Made:
    """Write comparison.json of results by name, and return what it says.

    ``scores``: name of a method → its cross-validation.
    """
    from vibrident.show import methods
    from vibrident.use.comparison import document

    known, left_out = dict(truth or {}), {name: dict(s) for name, s in (scores or {}).items()}
    write_json(folder / "comparison.json", document(dict(results), known, left_out))
    blocks: tuple[Any, ...] = methods.compared(list(results.values()), list(results), known)
    if len({result.model for result in results.values()}) > 1:
        blocks += methods.models(results, left_out)
    return Made(blocks)


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


def _identified(calibration: Calibration, methods: Sequence[Method], tell: Teller, *, must: bool) -> dict[str, Result]:
    """Return results by name. Methods that do not suit the data are left out, but not named ones."""
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


def _cross_validated(
    calibration: Calibration,
    methods: Sequence[Method],
    results: Mapping[str, Result],
    tell: Teller,
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
