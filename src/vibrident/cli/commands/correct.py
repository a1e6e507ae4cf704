"""``vibrident correct``: the acceleration behind a measured response, with an uncertainty for every sample."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from vibrident.cli import options
from vibrident.cli.console import note, out, wrote
from vibrident.cli.files import record_files
from vibrident.workflow.folder import written_whole
from vibrident.workflow.results import load_result

if TYPE_CHECKING:
    from vibrident.correction import Correction


def correct(
    result: Annotated[
        Path, typer.Argument(metavar="RESULT", help="result.json of an identification.", show_default=False)
    ],
    calibration: options.CalibrationFile,
    folder: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder for the CSV files, correction.json and the picture.")
    ] = Path("vibrident-correction"),
    band: Annotated[
        str | None,
        typer.Option(
            "--band",
            metavar="LOW:HIGH",
            help="Hz: the band to restore.",
            show_default="chosen from noise, motion, sensor and sampling rate",
        ),
    ] = None,
    noise: Annotated[
        float | None,
        typer.Option(
            "--noise",
            metavar="RMS",
            help="White noise of the response, in its unit.",
            show_default="estimated from each record",
        ),
    ] = None,
    no_plots: Annotated[bool, typer.Option("--no-pictures", "--no-plots", help="Draw no picture.")] = False,
) -> None:
    """Restore the acceleration from the measured response, with an uncertainty for every sample.

    Writes a CSV file a record, and band, noise, peak with interval, and warnings in correction.json.
    A reference is used for comparison only. Write excitation = "decay" for records without one.
    """
    limits = options.band(band)
    from vibrident.io import read_guarded

    known = load_result(result)
    data = read_guarded(calibration)
    with written_whole(folder) as output:
        from vibrident.cli.progress import Busy

        with Busy("Correcting"):
            from vibrident.correction import correct as run
            from vibrident.correction import summary

            corrections = run(known, data, band_hz=limits, noise=noise)
            files = record_files([c.record.name for c in corrections.corrections])
            for file, correction in zip(files, corrections.corrections, strict=True):
                _write_csv(output.path / file, correction)
            document = summary(corrections, files)
            text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
            (output.path / "correction.json").write_text(text, encoding="utf-8")
            if not no_plots:
                from vibrident import plots

                plots.save(plots.correction(corrections, dict(known.sensor)), output.path / "correction.png")
    for finding in corrections.findings:
        note(f"Warning ({finding.code}): {finding.message}")
    _show(document, folder, corrections.motion, drawn=not no_plots)


def _write_csv(path: Path, correction: Correction) -> None:
    """Columns time_s (the file's own clock), acceleration, standard_uncertainty; blank where unknown."""
    record = correction.record
    times = (record.start_time_s + record.time_s).tolist()
    rows = zip(times, correction.acceleration.tolist(), correction.standard_uncertainty.tolist(), strict=True)
    with path.open("w", encoding="ascii", newline="\n") as stream:
        stream.write("time_s,acceleration,standard_uncertainty\n")
        stream.writelines(f"{t!r},{a!r},{u!r}\n" if a == a else f"{t!r},,\n" for t, a, u in rows)


def _show(document: dict[str, Any], folder: Path, motion: str, *, drawn: bool) -> None:
    from vibrident import terminal
    from vibrident.naming import pretty

    unit = pretty(document["unit"])
    rows = []
    for row in document["records"]:
        peak, band, reference = row["peak"], row["band"], row["reference"]
        rows.append(
            {
                "record": row["name"],
                "band / Hz": f"{band['low_hz']:.4g} to {band['high_hz']:.4g}",
                f"peak / {unit}": None if peak is None else peak["value"],
                "95 % interval": None if peak is None else _interval(peak),
                "u / peak": None if peak is None else f"{100 * _ratio(peak):.2g} %",
                f"rmse / {unit}": None if reference is None else reference["rmse"],
            }
        )
    console = out()
    console.print(terminal.inspection_table(rows, f"Restored {motion}"))
    csv = folder / f"{len(rows)} CSV file{'s' * (len(rows) != 1)}"
    written = [folder / "correction.json", csv, *([folder / "correction.png"] if drawn else [])]
    wrote(written)


def _interval(peak: dict[str, Any]) -> str:
    """Both ends to the second digit of u."""
    from vibrident.present.numbers import pair

    return " … ".join(pair(end, peak["standard_uncertainty"])[0] for end in peak["interval_95"])


def _ratio(peak: dict[str, Any]) -> float:
    return abs(peak["standard_uncertainty"] / peak["value"]) if peak["value"] else float("inf")
