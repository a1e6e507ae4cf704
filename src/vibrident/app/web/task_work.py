"""Do further tasks of the page in a separate process, with HTML and charts as output."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from vibrident.app.web import translated
from vibrident.app.web.language import language, phrase
from vibrident.app.web.session import refuse_outside
from vibrident.app.workflow.estimators import AUTO
from vibrident.app.workflow.task_output import TaskOutput
from vibrident.base.fields import Fields, NamedTexts
from vibrident.base.progress import ProgressReporter

#: The folder of the files of a task, the archive of them, and the result that it works with.
OUT = "files"
ARCHIVE = "files.zip"
RESULT_FILE = "chosen-result.json"


class ProcessProgress(ProgressReporter):
    """Passes the progress on as values: a kind, and what ``TaskProgress.receive`` takes of it."""

    def __init__(self, progress: Callable[..., object]) -> None:
        self._progress = progress

    def step(self, words: str) -> None:
        """Report the name of the step that begins."""
        self._progress("step", words)

    def __call__(self, iteration: int, most: int, cost: float) -> None:
        """Report an iteration of an optimiser."""
        self._progress("iteration", iteration, most, float(cost))

    def share(self, words: str, done: int, most: int) -> None:
        """Report how many parts of the work are done."""
        self._progress("share", words, done, most)

    def estimate(self, row: Any, units: NamedTexts) -> None:
        """Report a tracked sensor by its first frequency, or its first parameter."""
        name = next((name for name in row.values if units[name] == "Hz"), next(iter(row.values)))
        label = f"{name} / {units[name]}"
        self._progress("estimate", label, float(row.time_s), float(row.values[name]))

    def note(self, words: str) -> None:
        """Report a remark."""
        self._progress("note", words)


def work(
    task: str,
    options: Fields,
    files: Sequence[str],
    code: str,
    *,
    progress: Callable[..., object],
) -> Fields:
    """Do a task on the files of the folder; the files that it makes lie in ``OUT``.

    ``code``: of the language of what is shown.

    Returns:
        ``tables`` as HTML, ``charts`` as JSON with their heights, ``notes``, names of the
        ``files``, and of the ``results`` among them.
    """
    for name in files:
        refuse_outside(Path(name))
    folder = Path(OUT)
    folder.mkdir(exist_ok=True)
    output = _output(task, options, files, folder, ProcessProgress(progress))
    written = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    with zipfile.ZipFile(ARCHIVE, "w", zipfile.ZIP_DEFLATED) as packed:
        for path in written:
            packed.write(path, path.relative_to(folder))
    names = [str(path.relative_to(folder)) for path in written]
    results = [name for name in names if Path(name).name == "result.json"]
    speak = language(code)
    notes = (*(finding.message for finding in output.findings), *output.notes)
    return {
        "tables": translated.fragment(speak, *output.blocks),
        "charts": [
            chart
            for chart in translated.charts(speak, *output.figures)
            if len(chart[1]) < translated.MAX_CHART_BYTES
        ],
        "notes": [speak(note) for note in notes],
        "files": names,
        "results": results,
    }


def _output(
    task: str, options: Fields, files: Sequence[str], folder: Path, progress: ProcessProgress
) -> TaskOutput:
    """Do a task; the names of its options are those of the function that does it."""
    from vibrident.app.workflow import uses
    from vibrident.app.workflow.folder import load_result
    from vibrident.data.io import read

    options = dict(options)
    # both ends are there together
    band = (options.pop("low_hz"), options.pop("high_hz")) if "low_hz" in options else None
    match task:
        case "compare":
            from vibrident.app.workflow.comparison import compare

            return compare(read(files[0]), folder, progress=progress, **options)
        case "predict":
            progress.step(phrase("Predicting"))
            return uses.predict(load_result(Path(RESULT_FILE)), read(files[0]), folder)
        case "correct":
            progress.step(phrase("Correcting"))
            result = load_result(Path(RESULT_FILE))
            return uses.correct(result, read(files[0]), folder, band_hz=band, **options)
        case "track":
            from vibrident.app.workflow.tracked import track

            progress.step(phrase("Tracking"))
            paths = Path(RESULT_FILE), Path(files[0]), folder
            return track(*paths, progress=progress, **options)[0]
        case "plan":
            from vibrident.physics.simulation import one_third_octave
            from vibrident.use.planning import plan

            progress.step(phrase("Planning"))
            options["frequencies_hz"] = band and one_third_octave(*band).tolist()
            planned = plan(load_result(Path(RESULT_FILE)), **options)
            uses.write_plan(planned, folder)
            return uses.describe_plan(planned)
        case "fleet":
            return _fleet([f"./{file}" for file in files], folder, progress, **options)
        case _:
            return _identify([*map(Path, files)], folder, progress, **options)


def _identify(
    files: list[Path],
    folder: Path,
    progress: ProcessProgress,
    *,
    estimator: str = AUTO,
    discretisation: str | None = None,
    model: str = "",
    **options: Any,
) -> TaskOutput:
    """Identify as the command line does; several calibrations together."""
    from vibrident.app.workflow.identification import IdentifyRequest, result_folders, run
    from vibrident.data.io import read
    from vibrident.show import methods

    models = [model] if model else None
    request = IdentifyRequest(estimator, {"discretisation": discretisation}, models, **options)
    request.check(len(files))
    if len(files) > 1:
        progress.step(phrase("Identifying together"))
    results = run(request, [read(file) for file in files], progress)
    for result, result_folder in zip(results, result_folders(files, folder), strict=True):
        result_folder.mkdir(parents=True, exist_ok=True)
        result.save(result_folder / "result.json")
    return TaskOutput(methods.joint(results[0]) if len(results) > 1 else ())


def _fleet(
    files: list[str], folder: Path, progress: ProcessProgress, *, model: str | None = None
) -> TaskOutput:
    from vibrident.lab.fleet.parts import load_arrow
    from vibrident.lab.fleet.summary import overview
    from vibrident.lab.fleets import Fleet

    load_arrow()
    outcome = Fleet(files, folder, model=model).identify(
        progress=lambda now: progress.share(
            phrase("{done} of {total} sensors", done=now.done, total=now.total), now.done, now.total
        )
    )
    return TaskOutput(overview(outcome))
