"""``vibrident demo``: the whole way on simulated data, with a word on what to look at."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer

from vibrident.cli.commands.simulate import write
from vibrident.cli.console import out, printable
from vibrident.cli.folder import written_whole

#: A sensor and its calibration as in the paper's section 4, at a rate that keeps the files small.
SENSOR, RATE_HZ, SAMPLES, SNR_DB, RESPONSE_NOISE, SEED = "paper", 12800.0, 4000, 20.0, 0.01, 1


def demo(
    folder: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder for everything; other files in it stay.")
    ] = Path("demo"),
) -> None:
    """Simulate a calibration, identify the sensor, compare with the truth, write a report."""
    with written_whole(folder) as output:
        _steps(output.path, folder)
    out().print(
        f"\nNext: vibrident inspect {folder}/calibration.toml\n"
        f"      vibrident compare {folder}/calibration.toml --truth {folder}/truth.json\n"
        "      vibrident --help",
        soft_wrap=True,
    )


def _steps(place: Path, folder: Path) -> None:
    from vibrident import io, terminal
    from vibrident.cli.drawing import painters
    from vibrident.cli.progress import Busy
    from vibrident.cli.truth import true_values

    console = out()
    with painters() as artists:
        _say(
            "1  A calibration",
            f"The accelerometer of the paper's Table 2 on a shaker: 21 sines from 10 Hz to 1 kHz, {SAMPLES} samples "
            f"each. The sensor feels noise {SNR_DB:g} dB below the motion; its output carries "
            f"{100 * RESPONSE_NOISE:g} % noise.",
            f"Look at: {folder}/calibration.toml, which says what the columns of the CSV files mean.",
        )
        with Busy("Simulating"):
            write(
                place,
                SENSOR,
                "sine",
                sampling_rate_hz=RATE_HZ,
                samples=SAMPLES,
                excitation_snr_db=SNR_DB,
                response_noise=RESPONSE_NOISE,
                seed=SEED,
            )
        _say(
            "2  The identification",
            "The same as: vibrident identify calibration.toml",
            "Look at: u, the standard uncertainty of each value, and the verdict on the fit.",
        )
        with Busy("Identifying") as progress:
            from vibrident.identification import identify

            result = identify(io.read(place / "calibration.toml"), progress=progress)
        # Where the file will be, not where it is being written.
        provenance = {**result.provenance, "calibration_file": str(folder / "calibration.toml")}
        result = dataclasses.replace(result, provenance=provenance)
        console.print(terminal.summary(result))
        _say(
            "3  The truth",
            "A simulation knows it. About two values in three lie within 1 u of the truth, 95 in 100 within 2 u.",
        )
        from vibrident.simulation import SENSORS

        console.print(terminal.truth_table(result, true_values(SENSORS[SENSOR])))
        _finish(place, folder, result, artists)


def _finish(place: Path, folder: Path, result, artists) -> None:
    from vibrident.cli.progress import Busy
    from vibrident.report import render

    saved = result.save(place / "result.json")
    with Busy("Drawing"):
        artists.draw(result, saved)
    (place / "report.md").write_text(render(result, pictures=place), encoding="utf-8")
    _say(
        "4  What is written",
        f"{folder}/result.json      every number above and the curves; all else is made from it",
        f"{folder}/report.md        a report with these pictures:",
        f"{folder}/sensitivity.png  the sensitivity over frequency, model and measurement",
        f"{folder}/deviation.png    their difference, which should scatter about zero within the bars",
        f"{folder}/signals.png      measured and predicted response in time",
    )


def _say(title: str, *lines: str) -> None:
    from rich.padding import Padding

    console = out()
    console.print(f"\n{title}", style="bold")
    for line in lines:
        console.print(Padding(printable(line), (0, 0, 0, 3)))
