"""``vibrident compare``: estimators, models and discretisations on the same data, or earlier results."""

from __future__ import annotations

import itertools
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibrident.app.cli import options
from vibrident.app.cli.console import distinct, note, show, wrote
from vibrident.app.cli.options import argument, flag, option
from vibrident.app.cli.progress import Busy
from vibrident.app.workflow.estimators import estimator, estimators_with, misfit
from vibrident.app.workflow.folder import load_result, write_json, written_whole
from vibrident.base.errors import InputError, ModelError, NotConverged
from vibrident.fit.registry import ESTIMATORS

if TYPE_CHECKING:
    from vibrident.data.records import Calibration
    from vibrident.fit.estimators import Estimator
    from vibrident.result import Result


@dataclass(frozen=True)
class Method:
    """One way to identify the same data; None: the model of the calibration file, the usual discretisation."""

    estimator: str
    model: str | None = None
    discretisation: str | None = None

    @property
    def name(self) -> str:
        """What distinguishes it, in a line."""
        return " ".join(part for part in (self.estimator, self.discretisation, self.model) if part)

    @property
    def chosen(self) -> str | Estimator:
        """The estimator, with its setting where there is one."""
        return estimator(self.estimator, {"discretisation": self.discretisation})


def compare(
    files: list[Path] = argument("CAL.toml | RESULT...", "A calibration file, or results."),
    estimators: str | None = option(
        "--estimators", "A,B", "Of {estimators by name}.", default="all of vibrident that suit the data"
    ),
    models: str | None = option("--models", "A,B", "Sensor models.", default="the file's"),
    discretisations: str | None = option(
        "--discretisations", "A,B", f"Network: of {', '.join(options.DISCRETISATIONS)}.", default=False
    ),
    truth: Path | None = option("--truth", "FILE", "truth.json of a simulation, as the reference."),
    validate: bool = flag("--cross-validate", help="Fit again without each fifth of the records, and predict it."),
    folder: Path = option("--out", "DIR", "Folder for comparison.json, and each result.", Path("vibrident-comparison")),
) -> None:
    """Compare methods side by side: parameters, fit, and time; deviations are from the first one.

    Of several models it recommends one, with the reason.
    """
    named = options.listed("--estimators", ESTIMATORS.names)(estimators)
    steps = options.listed("--discretisations", options.DISCRETISATIONS)(discretisations)
    names = options.listed("--models")(models)
    if steps and named and not estimators_with("discretisation", named):
        wanted = f"--estimators with {' or '.join(estimators_with('discretisation'))}"
        raise misfit("--discretisations", wanted, f"--estimators {','.join(named)}")
    from vibrident.physics.models import parse
    from vibrident.use.comparison import document, read_truth

    known = read_truth(truth) if truth else {}
    for name in names or ():
        parse(name)  # checked before anything is identified
    with written_whole(folder) as output:
        calibrations = [file for file in files if file.suffix.lower() == ".toml"]
        if calibrations and len(files) > 1:
            raise InputError(
                "These files cannot be compared with each other.",
                expected="one calibration file (.toml), or results (.json)",
                found=", ".join(str(file) for file in files),
                where="command line",
                remedy="compare one calibration file at a time, or the results of several",
            )
        if calibrations:
            from vibrident.data.io import read_guarded
            from vibrident.fit.estimators import ranked

            calibration = read_guarded(files[0])
            methods = _methods(
                named or [one.name for one in ranked(ESTIMATORS.built_in())], names or (None,), steps or (None,)
            )
            results = _identified(calibration, methods, must=bool(named))
            scores = _cross_validated(calibration, methods, results) if validate and len(results) > 1 else {}
            for name, result in results.items():
                result.save(output.path / f"{name.replace(' ', '-').replace('+', '-')}.json")
        else:
            for option_name, value in {"--estimators": named, "--models": names, "--discretisations": steps}.items():
                if value:
                    raise misfit(option_name, "a calibration file (.toml)", "results, which exist already")
            results, scores = {name: load_result(file) for name, file in zip(distinct(files), files, strict=True)}, {}
        write_json(output.path / "comparison.json", document(results, known, scores))
    from vibrident.show import methods
    from vibrident.show.views import Sentence

    show(*methods.compared(list(results.values()), list(results), known))
    if len({result.model for result in results.values()}) > 1:
        show(*methods.models(results, scores), Sentence(""))
    wrote(output.files)


def _methods(estimators: list, models: tuple | list, steps: tuple | list) -> list[Method]:
    """Every valid combination: not every estimator has a discretisation."""
    stepping = estimators_with("discretisation", estimators) if steps != (None,) else ()
    return [
        Method(name, model, step)
        for model, name in itertools.product(models, estimators)
        for step in (steps if name in stepping else (None,))
    ]


def _identified(calibration: Calibration, methods: list[Method], *, must: bool) -> dict[str, Result]:
    """Results by name. Methods that do not suit the data are left out, except those named: ``must`` for estimators."""
    from vibrident.use.identification import identify

    results: dict[str, Result] = {}
    failures: dict[str | None, ModelError | NotConverged] = {}
    for method in methods:
        try:
            with Busy(f"Identifying by {method.name}") as progress:
                results[method.name] = identify(calibration, method.model, method.chosen, progress=progress)
        except (ModelError, NotConverged) as failure:
            if must or method.discretisation:
                raise
            failures.setdefault(method.model, failure)
            problem = failure.problem if isinstance(failure, ModelError) else str(failure)
            note(f"Left out: {method.name}. {problem}")
    for model, failure in failures.items():
        if not any(method.model == model and method.name in results for method in methods):
            raise failure
    return results


def _cross_validated(
    calibration: Calibration, methods: list[Method], results: dict[str, Result]
) -> dict[str, dict[str, Any]]:
    from vibrident.use.validation import cross_validate

    scores = {}
    for method in methods:
        if method.name not in results:
            continue
        with Busy(f"Cross-validating {method.name}") as progress:
            score = cross_validate(calibration, results[method.name], method.chosen, progress=progress)
        if score is not None:
            scores[method.name] = asdict(score)
    return scores
