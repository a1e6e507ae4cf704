"""``vibrident compare``: compare methods on the same data, or earlier results."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from vibrident.app.cli import options
from vibrident.app.cli.console import distinct_names, show_output, show_written
from vibrident.app.cli.options import argument, flag, option
from vibrident.app.cli.progress import ProgressBar
from vibrident.app.workflow.estimators import estimators_with, misfit_error
from vibrident.app.workflow.folder import written_whole
from vibrident.base.errors import InputError, ModelError
from vibrident.fit.registry import ESTIMATORS


def compare(
    files: list[Path] = argument("CAL.toml | RESULT...", "A calibration file, or results."),
    estimators: str | None = option(
        "--estimators",
        "A,B",
        "Of {estimators by name}.",
        default="all of vibrident that suit the data",
    ),
    models: str | None = option("--models", "A,B", "Sensor models.", default="the file's"),
    discretisations: str | None = option(
        "--discretisations",
        "A,B",
        f"Network: of {', '.join(options.DISCRETISATIONS)}.",
        default=False,
    ),
    truth: Path | None = option("--truth", "FILE", "truth.json of a simulation, as the reference."),
    validate: bool = flag(
        "--cross-validate", help="Fit again without each fifth of the records, and predict it."
    ),
    folder: Path = option(
        "--out", "DIR", "Folder for comparison.json, and each result.", Path("vibrident-comparison")
    ),
) -> None:
    """Compare methods side by side: parameters, fit, and time; deviations are from the first one.

    Of several models it recommends one, with the reason.
    """
    named = options.listed("--estimators", ESTIMATORS.names)(estimators)
    steps = options.listed("--discretisations", options.DISCRETISATIONS)(discretisations)
    names = options.listed("--models")(models)
    if steps and named and not estimators_with("discretisation", named):
        expected = f"--estimators with {' or '.join(estimators_with('discretisation'))}"
        raise misfit_error("--discretisations", expected, f"--estimators {','.join(named)}")
    from vibrident.use.comparison import read_truth

    truth_values = read_truth(truth) if truth else {}
    _require_models(names or ())  # before anything is identified
    with written_whole(folder) as output:
        calibrations = [file for file in files if file.suffix.lower() == ".toml"]
        if calibrations and len(files) > 1:
            raise _mixed_files_error(files)
        if calibrations:
            from vibrident.app.workflow.comparison import compare as run
            from vibrident.data.io import read_guarded

            calibration = read_guarded(files[0])
            with ProgressBar("Identifying") as progress:
                comparison = run(
                    calibration,
                    output.path,
                    estimators=named or (),
                    models=names or (),
                    discretisations=steps or (),
                    validate=validate,
                    truth=truth_values,
                    progress=progress,
                )
        else:
            for option_name, value in {
                "--estimators": named,
                "--models": names,
                "--discretisations": steps,
            }.items():
                if value:
                    raise misfit_error(
                        option_name, "a calibration file (.toml)", "results, which exist already"
                    )
            from vibrident.app.workflow.comparison import write_comparison
            from vibrident.use.methods import compare as run

            comparison = write_comparison(
                run(dict(zip(distinct_names(files), files, strict=True)), truth=truth_values),
                output.path,
            )
    show_output(comparison)
    show_written(output.files)


def _mixed_files_error(files: list[Path]) -> InputError:
    return InputError(
        "These files cannot be compared with each other.",
        expected="one calibration file (.toml), or results (.json)",
        found=", ".join(str(file) for file in files),
        where="command line",
        remedy="compare one calibration file at a time, or the results of several",
    )


def _require_models(names: Sequence[str]) -> None:
    """Refuse names of models that are not known."""
    from vibrident.physics.models import parse

    for name in names:
        try:
            parse(name)
        except ModelError as error:
            raise error.at("⟦--models⟧") from None
