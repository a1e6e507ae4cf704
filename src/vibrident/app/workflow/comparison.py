"""Compare methods on the same data, as a shell or a page asks for it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibrident.app.workflow.folder import write_json
from vibrident.app.workflow.task_output import TaskOutput
from vibrident.base.fields import NamedNumbers
from vibrident.base.progress import SILENT, ProgressReporter

if TYPE_CHECKING:
    from vibrident.data.records import Calibration
    from vibrident.use.methods import Comparison


def compare(
    calibration: Calibration,
    folder: Path,
    *,
    estimators: Sequence[str] = (),
    models: Sequence[str] = (),
    discretisations: Sequence[str] = (),
    validate: bool = False,
    truth: NamedNumbers | None = None,
    progress: ProgressReporter = SILENT,
) -> TaskOutput:
    """Compare methods as :func:`vibrident.compare` does.

    ``folder``: for comparison.json and each result; ``progress``: gets the progress.
    """
    from vibrident.use.methods import compare_methods

    comparison = compare_methods(
        calibration,
        estimators=estimators,
        models=models,
        discretisations=discretisations,
        cross_validation=validate,
        truth=truth,
        progress=progress,
    )
    for name, result in comparison.results.items():
        result.save(folder / f"{name.replace(' ', '-').replace('+', '-')}.json")
    return write_comparison(comparison, folder)


def write_comparison(comparison: Comparison, folder: Path) -> TaskOutput:
    """Write comparison.json, and return the comparison."""
    from vibrident.show import methods

    write_json(folder / "comparison.json", comparison.to_dict())
    results = comparison.results
    blocks: tuple[Any, ...] = methods.compared(
        list(results.values()), list(results), dict(comparison.truth)
    )
    if len({result.model for result in results.values()}) > 1:
        scores = {name: dict(score) for name, score in comparison.cross_validations.items()}
        blocks += methods.models(results, scores)
    return TaskOutput(blocks)
