"""``vibrident correct``: restore the acceleration behind a response, with an uncertainty."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from vibrident.app.cli import options
from vibrident.app.cli.console import show_output, show_written, warn
from vibrident.app.cli.options import argument, between, flag, option
from vibrident.app.cli.progress import ProgressBar
from vibrident.app.workflow.folder import inputs_of, load_result, written_whole


def correct(
    result: Path = options.RESULT_FILE,
    calibration: Path = argument(
        "CAL.toml|TABLE", "Calibration file; or a table of your own: CSV, Parquet, Excel."
    ),
    folder: Path = option(
        "--out",
        "DIR",
        "Folder for the CSV files, correction.json and the picture.",
        Path("vibrident-correction"),
    ),
    band: str | None = option(
        "--band",
        "LOW:HIGH",
        "Hz: the band to restore.",
        default="chosen from noise, motion, sensor and sampling rate",
    ),
    noise: float | None = between(
        "--noise",
        "RMS",
        "White noise of the response, in its unit.",
        0.0,
        options.SIZES[1],
        default="estimated from each record",
    ),
    track: bool = flag(
        "--track",
        help="Track the sensor through the records, and correct each with its own parameters.",
    ),
    column: str | None = option("--column", "NAME|N", "TABLE: the column of the sensor's signal."),
    time: str | None = option(
        "--time",
        "NAME|N",
        "TABLE: column of the times, in s or the unit of its name; else by name.",
    ),
    rate: float | None = options.rate("--rate", "TABLE: sampling rate, where it has no times."),
    scale: float | None = options.factor(
        "--scale", "X", "TABLE: response unit per unit of the column.", "that of its unit, or 1"
    ),
    pictures: bool = options.PICTURES,
) -> None:
    """Restore the acceleration from the measured response, with an uncertainty for every sample.

    Writes a CSV file a record, and band, noise, peak with interval, and warnings in
    correction.json. A reference is used for comparison only. Write excitation = "decay" for records
    without one.

    Of a table, writes the same table into the folder with two columns more: acceleration and its
    standard uncertainty.
    """
    limits = options.band(band)
    is_table = calibration.suffix.lower() != ".toml"
    of_table = {"--column": column, "--time": time, "--rate": rate, "--scale": scale}
    if is_table:
        options.refuse_unused({"--track": track}, "a calibration file")
    else:
        is_given = {name: value is not None for name, value in of_table.items()}
        options.refuse_unused(is_given, "a table")
    if is_table:
        _correct_table(
            load_result(result), calibration, folder, limits, noise, (column, time, rate, scale)
        )
        return
    from vibrident.data.io import read_guarded

    identified = load_result(result)
    data = read_guarded(calibration)
    inputs = [result, *inputs_of(calibration)]
    with written_whole(folder, inputs) as output, ProgressBar("Correcting"):
        from vibrident.app.workflow.uses import correct as run

        correction = run(identified, data, output.path, band_hz=limits, noise=noise, track=track)
        if pictures:
            from vibrident.show import plots

            plots.save(correction.figures[0], output.path / "correction.png")
    show_output(correction)
    show_written(
        [
            folder / "correction.json",
            folder / "*.csv",
            *([folder / "correction.png"] if pictures else []),
        ]
    )


def _correct_table(
    identified: Any,
    path: Path,
    folder: Path,
    limits: Any,
    noise: float | None,
    signal: tuple[Any, ...],
) -> None:
    from vibrident.base.errors import InputError
    from vibrident.data.io.own_table import ENDINGS, read_signal, with_columns
    from vibrident.data.records import Calibration

    column, time, rate, scale = signal
    if column is None or path.suffix.lower() not in ENDINGS:
        raise InputError(
            "This is no calibration file, and no table to add columns to.",
            expected=f"a file that ends in {', '.join(ENDINGS)}, and --column for the signal",
            found=path.name + ("" if column is None else f", --column {column}"),
            where="command line",
            remedy="give --column with the name or the number of the column",
        )
    from vibrident.use.correction import correct as run

    with written_whole(folder, [path]) as output:
        with ProgressBar("Correcting"):
            data = Calibration(
                (read_signal(path, column, time, rate, scale, identified.response_unit),),
                response_unit=identified.response_unit,
            )
            corrections = run(identified, data, band_hz=limits, noise=noise)
        correction = corrections.corrections[0]
        motion = corrections.motion
        new = {
            motion: correction.acceleration,
            f"{motion}_standard_uncertainty": correction.standard_uncertainty,
        }
        with_columns(path, output.path / path.name, new)
    warn(corrections.findings)
    show_written(output.files)
