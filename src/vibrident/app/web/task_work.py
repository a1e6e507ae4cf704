"""Do further tasks of the page in a separate process, with HTML and charts as output."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from vibrident.app.web import translated
from vibrident.app.web.language import language, phrase
from vibrident.app.web.session import refuse_outside
from vibrident.app.web.tasks import IDENTIFY
from vibrident.app.workflow.estimators import AUTO
from vibrident.app.workflow.made import ProgressReporter, TaskOutput
from vibrident.base.fields import Fields, GivenFields

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

    def estimate(self, row: Any, units: Mapping[str, str]) -> None:
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
    output = _TASKS[task](options, files, folder, ProcessProgress(progress))
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


def _compare(
    options: Fields, files: Sequence[str], folder: Path, progress: ProcessProgress
) -> TaskOutput:
    from vibrident.app.workflow.comparison import compare
    from vibrident.data.io import read

    output, _ = compare(
        read(files[0]),
        folder,
        estimators=options.get("estimators") or (),
        models=options.get("models") or (),
        validate=bool(options.get("validate")),
        progress=progress,
    )
    return output


def _predict(
    options: Fields, files: Sequence[str], folder: Path, progress: ProcessProgress
) -> TaskOutput:
    from vibrident.app.workflow.folder import load_result
    from vibrident.app.workflow.uses import predict
    from vibrident.data.io import read

    progress.step(phrase("Predicting"))
    return predict(load_result(Path(RESULT_FILE)), read(files[0]), folder)


def _correct(
    options: Fields, files: Sequence[str], folder: Path, progress: ProcessProgress
) -> TaskOutput:
    from vibrident.app.workflow.folder import load_result
    from vibrident.app.workflow.uses import correct
    from vibrident.data.io import read

    progress.step(phrase("Correcting"))
    return correct(
        load_result(Path(RESULT_FILE)),
        read(files[0]),
        folder,
        band_hz=_band(options),
        noise=options.get("noise"),
        track=bool(options.get("track")),
    )


def _track(
    options: Fields, files: Sequence[str], folder: Path, progress: ProcessProgress
) -> TaskOutput:
    from vibrident.app.workflow.tracked import track
    from vibrident.use.tracking import FALSE_ALARMS_PER_DAY

    progress.step(phrase("Tracking"))
    output, _ = track(
        Path(RESULT_FILE),
        Path(files[0]),
        folder,
        every_s=options.get("every"),
        false_alarms_per_day=options.get("false_alarms_per_day") or FALSE_ALARMS_PER_DAY,
        progress=progress,
    )
    return output


def _plan(
    options: Fields, files: Sequence[str], folder: Path, progress: ProcessProgress
) -> TaskOutput:
    from vibrident.app.workflow.folder import load_result
    from vibrident.app.workflow.uses import describe_plan, write_plan
    from vibrident.physics.simulation import one_third_octave
    from vibrident.use.planning import plan

    progress.step(phrase("Planning"))
    band = _band(options)
    best_plan = plan(
        load_result(Path(RESULT_FILE)),
        frequencies_hz=None if band is None else one_third_octave(*band).tolist(),
        best=options.get("best"),
        times_as_long=options.get("times_as_long") or 1.0,
    )
    write_plan(best_plan, folder)
    return describe_plan(best_plan)


def _identify(
    options: Fields, files: Sequence[str], folder: Path, progress: ProcessProgress
) -> TaskOutput:
    """Identify as the command line does; several calibrations together."""
    from vibrident.app.workflow.identification import IdentifyRequest, result_folders, run
    from vibrident.data.io import read
    from vibrident.show import methods

    model = options.get("model")
    request = IdentifyRequest(
        options.get("estimator", AUTO),
        {"discretisation": options.get("discretisation")},
        models=[model] if model else None,
        uncertainty=options.get("uncertainty", "auto"),
        share=options.get("share"),
    )
    request.check(len(files))
    if len(files) > 1:
        progress.step(phrase("Identifying together"))
    results = run(request, [read(file) for file in files], progress)
    for result, result_folder in zip(
        results, result_folders([*map(Path, files)], folder), strict=True
    ):
        result_folder.mkdir(parents=True, exist_ok=True)
        result.save(result_folder / "result.json")
    return TaskOutput(methods.joint(results[0]) if len(results) > 1 else ())


def _fleet(
    options: Fields, files: Sequence[str], folder: Path, progress: ProcessProgress
) -> TaskOutput:
    from vibrident.lab.fleet.parts import load_arrow
    from vibrident.lab.fleet.summary import overview
    from vibrident.lab.fleets import Fleet

    load_arrow()
    fleet = Fleet([f"./{file}" for file in files], folder, model=options.get("model"))
    outcome = fleet.identify(
        progress=lambda now: progress.share(
            phrase("{done} of {total} sensors", done=now.done, total=now.total), now.done, now.total
        )
    )
    return TaskOutput(overview(outcome))


_TASKS: Mapping[str, Callable[[Fields, Sequence[str], Path, ProcessProgress], TaskOutput]] = {
    "compare": _compare,
    "predict": _predict,
    "correct": _correct,
    "track": _track,
    "plan": _plan,
    "joint": _identify,
    IDENTIFY: _identify,
    "fleet": _fleet,
}


def _band(options: GivenFields) -> tuple[float, float] | None:
    """Return both ends of a band, which were checked to be there together; None for neither."""
    return None if "low_hz" not in options else (options["low_hz"], options["high_hz"])
