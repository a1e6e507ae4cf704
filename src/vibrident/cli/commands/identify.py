"""``vibrident identify``: from a calibration file to ``result.json``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from vibrident.cli import options
from vibrident.cli.console import note, out
from vibrident.cli.estimators import EstimatorOptions, checked, estimator
from vibrident.cli.folder import written_whole
from vibrident.cli.options import choice

WARNED = 3
_DETAILS = "Settings of an estimator"

_Discretisation = Annotated[
    str | None,
    choice(
        "--discretisation",
        options.DISCRETISATIONS,
        f"ipnn: how a step is taken: {', '.join(options.DISCRETISATIONS)}.",
        "NAME",
        rich_help_panel=_DETAILS,
        show_default="bandlimited",
    ),
]
_Optimiser = Annotated[
    str | None,
    choice(
        "--optimiser",
        options.OPTIMISERS,
        "ipnn: Levenberg-Marquardt, or Adam as in the paper.",
        rich_help_panel=_DETAILS,
        show_default="lm",
    ),
]
_Steps = Annotated[
    int | None,
    typer.Option(
        "--steps",
        metavar="N",
        min=1,
        help="ipnn with adam: training steps.",
        rich_help_panel=_DETAILS,
        show_default="1500",
    ),
]
_LearningRate = Annotated[
    float | None,
    typer.Option(
        "--learning-rate",
        metavar="X",
        help="ipnn with adam: step size.",
        rich_help_panel=_DETAILS,
        show_default="0.001",
    ),
]
_Weighting = Annotated[
    str | None,
    choice(
        "--weighting",
        options.WEIGHTINGS,
        "lsm: by uncertainty, or plain as in the paper.",
        rich_help_panel=_DETAILS,
    ),
]
_Residual = Annotated[
    bool,
    typer.Option(
        "--residual",
        help="ipnn: let a small network beside the physics learn what it leaves; kept only where it foretells "
        "held-out data better.",
        rich_help_panel=_DETAILS,
    ),
]
_Posterior = Annotated[
    bool,
    typer.Option(
        "--posterior",
        help="ml: sample the parameters' posterior too, and print it; for what is weakly determined. Needs the extra "
        "bayes.",
    ),
]


def identify(
    calibration: options.CalibrationFile,
    model: Annotated[
        str | None,
        typer.Option("--model", metavar="NAME", help="Sensor model, in place of the file's; add-ons with +."),
    ] = None,
    estimator_name: Annotated[
        str, choice("--estimator", options.ESTIMATORS, "How to fit; auto chooses by the data and says why.")
    ] = "auto",
    folder: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder for result.json and pictures; other files in it stay.")
    ] = Path("vibrident-out"),
    uncertainty: Annotated[
        str,
        choice(
            "--uncertainty",
            options.UNCERTAINTIES,
            "What they cover: noise alone; inflated, the misfit too; auto, the misfit of records whose model fails.",
        ),
    ] = "auto",
    strict: Annotated[bool, typer.Option("--strict", help="Exit with 3 where the result carries a warning.")] = False,
    plots: Annotated[bool, typer.Option("--plots/--no-plots", help="Draw pictures (PNG) into the folder.")] = True,
    weights: Annotated[
        bool, typer.Option("--weights", help="Print the network's weights, the paper's Table 1.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing but errors and warnings.")] = False,
    discretisation: _Discretisation = None,
    optimiser: _Optimiser = None,
    steps: _Steps = None,
    learning_rate: _LearningRate = None,
    weighting: _Weighting = None,
    residual: _Residual = False,
    posterior: _Posterior = False,
) -> None:
    """Identify a sensor: DIR/result.json, pictures, and a short table.

    Exit codes: 0 identified; 2 bad input; 3 with --strict, a result with a warning (it is written all the same).
    """
    settings = EstimatorOptions(discretisation, optimiser, steps, learning_rate, weighting, residual or None)
    checked(estimator_name, settings, weights=weights)
    with written_whole(folder) as output:
        how = {"uncertainty": uncertainty, "posterior": posterior}
        result = _identified(calibration, model, (estimator_name, settings), how, output.path, plots)
    _show(result, output.files, quiet=quiet, weights=weights)
    if strict and result.warnings:
        note(f"Strict: the result carries a warning ({', '.join(result.warning_codes)}).")
        raise typer.Exit(WARNED)


def _identified(
    file: Path, model: str | None, chosen: tuple[str, EstimatorOptions], how: dict[str, Any], place: Path, plots: bool
) -> Any:
    from vibrident.io import read

    calibration = read(file)
    # From here on it takes seconds: what a bad file needs is loaded already, what it does not need is not.
    from vibrident.cli.drawing import painters
    from vibrident.cli.progress import Busy

    with painters(wanted=plots) as artists:
        with Busy("Identifying") as progress:
            from vibrident.identification import identify as run
            from vibrident.uncertainty.posterior import Sampling

            sampling = Sampling() if how["posterior"] else None
            result = run(
                calibration,
                model,
                estimator(*chosen),
                uncertainty=how["uncertainty"],
                posterior=sampling,
                progress=progress,
            )
        saved = result.save(place / "result.json")
        if plots:
            with Busy("Drawing"):
                artists.draw(result, saved)
    return result


def _show(result: Any, files: list[Path], *, quiet: bool, weights: bool) -> None:
    from vibrident import terminal

    if quiet:
        for warning in result.warnings:
            note(f"Warning ({warning.code}): {warning.message}")
    else:
        out().print(terminal.summary(result, files), crop=False)  # a path is never cut
        if residual := result.settings.get("residual_network"):
            out().print(_residual_line(residual), soft_wrap=True)
        if posterior := result.settings.get("posterior"):
            out().print(terminal.posterior_table(result), crop=False)
            out().print(_posterior_line(posterior), soft_wrap=True)
    if weights and result.weights:
        out().print(terminal.weights_table(result))
    elif weights:
        note(f"No weights: {result.estimator} trains no network; --estimator ipnn does.")


def _residual_line(residual: dict[str, Any]) -> str:
    if not residual["kept"]:
        return f"Learned residual: none kept, share 0 ({residual['reason']})."
    return (
        f"Learned residual ({' and '.join(residual['structure'])}): {100 * residual['share']:.3g} % of the response; "
        f"rmse {residual['rmse']:.3g}, of the physics alone {residual['rmse_of_physics_alone']:.3g}."
    )


def _posterior_line(posterior: dict[str, Any]) -> str:
    words = f"Posterior: {posterior['chains']} chains of {posterior['draws']} draws, {posterior['sampler']}."
    if names := posterior["ends_by_prior"]:
        words += f" The range searched, not the data, ends {', '.join(names)} on one side at least."
    if not posterior["converged"]:
        words += " The chains do not agree, or steps diverged: take it as a warning and not as numbers."
    return words
