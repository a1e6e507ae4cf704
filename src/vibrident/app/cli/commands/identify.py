"""``vibrident identify``: from a calibration file to ``result.json``."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import typer

from vibrident.app.cli import options
from vibrident.app.cli.console import DOUBTFUL, note, output_console, print_line, show, warn
from vibrident.app.cli.options import argument, choice, flag, option
from vibrident.app.cli.progress import ProgressBar
from vibrident.app.cli.words import shell_word
from vibrident.app.workflow.estimators import AUTO, estimator_names
from vibrident.app.workflow.folder import inputs_of, written_whole
from vibrident.app.workflow.identification import IdentifyRequest, result_folders, run
from vibrident.base.fields import Fields

_DETAILS = "Settings of an estimator"
_detail = partial(option, panel=_DETAILS)
_LONG = "Long records"
_MODEL = (
    "Sensor model, in place of the file's: {cores}. Add-ons follow with +: {add-ons}. For several "
    "files one for all, or one each, joined by commas."
)
_EXCERPTS = (
    "Keep in result.json the samples of records that pictures in reports show; most of its size."
)
_DISCRETISATION = choice(
    "--discretisation",
    options.DISCRETISATIONS,
    f"Network: how a step is taken: {', '.join(options.DISCRETISATIONS)}.",
    metavar="NAME",
    default="bandlimited",
    panel=_DETAILS,
)


def identify(
    context: typer.Context,
    calibrations: list[Path] = argument(
        "CAL.toml...", "Calibration file; several of one sensor are fitted together."
    ),
    model: str | None = option("--model", "NAME", _MODEL),
    estimator_name: str = choice(
        "--estimator",
        estimator_names,
        f"How to fit; {AUTO} chooses by the data and says why.",
        AUTO,
        "{estimators}",
    ),
    folder: Path = option(
        "--out",
        "DIR",
        "Folder for result.json and pictures; other files in it stay.",
        Path("vibrident-out"),
    ),
    uncertainty: str = choice(
        "--uncertainty",
        options.UNCERTAINTIES,
        "What the uncertainties cover: noise alone; inflated, the misfit too; auto, the misfit "
        "where the model is rejected.",
        "auto",
    ),
    band: str | None = option(
        "--band", "LOW:HIGH", "Hz: the band that the fit takes.", default="the files', or all"
    ),
    share: str | None = option(
        "--share",
        "A,B",
        "Several files: the parameters they share, no others.",
        default="the oscillator, and gains of equal outputs",
    ),
    strict: bool = flag("--strict", help="Exit with 3 if the result carries a warning."),
    pictures: bool = flag(
        "--pictures/--no-pictures", help="Draw pictures (PNG) into the folder.", value=True
    ),
    excerpts: bool = flag("--excerpts/--no-excerpts", help=_EXCERPTS, value=True),
    weights: bool = flag("--weights", help="Print the network's weights, the paper's Table 1."),
    quiet: bool = flag("--quiet", "-q", help="Print nothing but errors and warnings."),
    discretisation: str | None = _DISCRETISATION,
    optimiser: str | None = choice(
        "--optimiser",
        ("lm", "adam"),
        "Network: Levenberg-Marquardt, or Adam as in the paper.",
        default="lm",
        panel=_DETAILS,
    ),
    steps: int | None = _detail(
        "--steps", "N", "Network with adam: training steps.", default="1500", min=1
    ),
    learning_rate: float | None = _detail(
        "--learning-rate", "X", "Network with adam: step size.", default="0.001"
    ),
    weighting: str | None = choice(
        "--weighting",
        ("plain", "weighted"),
        "Least squares on the response: by uncertainty, or plain as in the paper.",
        panel=_DETAILS,
    ),
    residual: bool = flag(
        "--residual",
        help="Network: learn the residual by a small network beside the physics; kept only where "
        "it predicts held-out data better.",
        panel=_DETAILS,
    ),
    set_values: list[str] | None = option(
        "--set",
        "NAME=VALUE",
        "A setting of another package's estimator; may be repeated.",
        panel=_DETAILS,
    ),
    scheduler: str | None = option(
        "--scheduler",
        "ADDRESS|FILE.json",
        "A running Dask scheduler whose workers share the stretches of a long record; or local, "
        "for workers on all cores. Needs the extra cluster.",
        panel=_LONG,
    ),
    work: Path | None = option(
        "--work",
        "DIR",
        "Keep fits of stretches here; after an interruption the same command continues.",
        panel=_LONG,
    ),
    posterior: bool = flag(
        "--posterior",
        help="Also sample and print the parameters' posterior; for weakly determined ones. Needs "
        "the extra bayes.",
    ),
) -> None:
    """Identify a sensor: DIR/result.json, pictures, and a short table.

    Several files make one joint fit: the first one's result is DIR/result.json, each other one's
    DIR/NAME/result.json, NAME being the file's without .toml.

    Exit codes: 0 identified; 2 bad input; 3 with --strict, a result with a warning (it is written
    all the same).
    """
    settings: Fields = {
        "discretisation": discretisation,
        "optimiser": optimiser,
        "steps": steps,
        "learning_rate": learning_rate,
        "weighting": weighting,
        "residual": residual or None,
        **options.settings(set_values or ()),
    }
    request = IdentifyRequest(
        estimator_name,
        settings,
        None if model is None else [name.strip() for name in model.split(",")],
        uncertainty,
        options.listed("--share")(share),
        posterior,
        options.band(band),
        weights,
        scheduler,
        work,
    )
    request.check(len(calibrations))
    inputs = [path for file in calibrations for path in inputs_of(file)]
    with written_whole(folder, inputs) as output:
        results = _identify(request, calibrations, output.path, pictures, excerpts)
    _show(results, output.files, context, quiet=quiet, weights=weights)
    codes = dict.fromkeys(code for result in results for code in result.warning_codes)
    if strict and codes:
        note(f"Strict: the result carries a warning ({', '.join(codes)}).")
        raise typer.Exit(DOUBTFUL)


def _identify(
    request: IdentifyRequest, files: list[Path], output_folder: Path, plots: bool, excerpts: bool
) -> list[Any]:
    """Identify the sensor, and write results and pictures into the folder."""
    from vibrident.data.io import read_guarded
    from vibrident.data.io.long_records import long_records_of

    can_be_long = len(files) == 1 and not request.posterior
    long = long_records_of(files[0], guarded=True) if can_be_long else None
    calibrations = [read_guarded(file) for file in files] if long is None else [long]
    # From here on it takes seconds; a bad file has been refused before the slow imports.
    from vibrident.app.cli.drawing import painter

    with painter(is_needed=plots) as artist:
        with ProgressBar("Identifying") as progress:
            results = run(request, calibrations, progress)
        unused = [f"--{name}" for name in ("scheduler", "work") if getattr(request, name)]
        if unused and "stretches" not in results[0].settings:
            names = " and ".join(unused)
            note(f"Note: the records were fitted as a whole; {names} had no effect.")
        for result, folder in zip(results, result_folders(files, output_folder), strict=True):
            saved = result.save(folder / "result.json")
            if plots:
                with ProgressBar("Drawing"):
                    artist.draw(result, saved)
            if not excerpts:  # the pictures were drawn with them
                result.save(saved, excerpts=False)
    return results


def _show(
    results: list[Any], files: list[Path], context: typer.Context, *, quiet: bool, weights: bool
) -> None:
    """Print the results and the written files; with ``quiet``, only remarks and warnings."""
    from vibrident.show import terminal

    is_joint = len(results) > 1
    if is_joint and not quiet:
        from vibrident.show import methods
        from vibrident.show.views import Sentence

        show(*methods.joint(results[0]), Sentence(""))
    word = shell_word(context.find_root().command, "identify")
    for result in results:
        _note_remarks(result)
        if quiet:
            warn(result.warnings)
        else:
            if is_joint:
                joint = result.settings["joint"]
                print_line(joint["calibrations"][joint["position"]]["file"])
            written = files if result is results[-1] else []
            # paths are not cropped
            output_console().print(terminal.summary(result, written, word), crop=False)
            if residual := result.settings.get("residual_network"):
                print_line(_residual_line(residual))
            if sampled := result.settings.get("posterior"):
                output_console().print(terminal.posterior_table(result), crop=False)
                print_line(_posterior_line(sampled))
        if weights and result.weights:
            output_console().print(terminal.weights_table(result))
        elif weights:
            note(f"No weights: {result.estimator} trains no network.")


def _note_remarks(result: Any) -> None:
    """Print remarks on copied records, corrections, and known responses of the channels."""
    from vibrident.data.screening.copies import notes_of_copies
    from vibrident.show.tables import corrections

    files = result.provenance.get("files", ())
    for text in notes_of_copies((file["file"], file["history"]) for file in files):
        note(text)
    for correction in corrections(result):
        note(f"Note: the data are corrected for {correction}.")
    for row in result.settings.get("known_responses", ()):
        low, high = row["band_hz"]
        note(
            f"Note: {row['source']}, known response of the {row['channel']}, is taken out; the fit "
            f"takes {low:.4g} to {high:.4g} Hz."
        )


def _residual_line(residual: Fields) -> str:
    if not residual["kept"]:
        return f"Learned residual: none kept, share 0 ({residual['reason']})."
    return (
        f"Learned residual ({' and '.join(residual['structure'])}): {100 * residual['share']:.3g} "
        f"% of the response; rmse {residual['rmse']:.3g}, of the physics alone "
        f"{residual['rmse_of_physics_alone']:.3g}."
    )


def _posterior_line(posterior: Fields) -> str:
    words = (
        f"Posterior: {posterior['chains']} chains of {posterior['draws']} draws, "
        f"{posterior['sampler']}."
    )
    if names := posterior["ends_by_prior"]:
        words += (
            f" The range searched, not the data, limits {', '.join(names)} on at least one side."
        )
    if not posterior["converged"]:
        words += (
            " The chains are too short for their autocorrelation time: do not use these numbers."
        )
    return words
