"""``vibrident demo``: the main path on simulated data, with notes on what to look at."""

from __future__ import annotations

import dataclasses
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from vibrident.app.cli.console import output_console, print_line, show
from vibrident.app.cli.options import option
from vibrident.app.cli.progress import ProgressBar
from vibrident.app.workflow.folder import written_whole
from vibrident.app.workflow.simulated import RESPONSE_NOISE, SAMPLES, SENSOR, SNR_DB, write_demo
from vibrident.base.escaping import terminal as printable

if TYPE_CHECKING:
    from vibrident.app.cli.drawing import Painter
    from vibrident.result import Result


def demo(
    folder: Path = option(
        "--out", "DIR", "Folder for everything; other files in it stay.", Path("demo")
    ),
) -> None:
    """Simulate a calibration, identify the sensor, compare with the truth, write a report."""
    with written_whole(folder) as output:
        _steps(output.path, folder)
    file, truth = (shlex.quote(str(folder / name)) for name in ("calibration.toml", "truth.json"))
    print_line(
        f"\nNext: vibrident inspect {file}\n      vibrident compare {file} --truth {truth}\n      "
        "vibrident --help"
    )


def _steps(demo_folder: Path, folder: Path) -> None:
    from vibrident.app.cli.drawing import painter
    from vibrident.data import io
    from vibrident.show import terminal

    file = shlex.quote(str(folder / "calibration.toml"))
    with painter() as artist:
        _print_chapter(
            "1  A calibration",
            "The accelerometer of the paper's Table 2 on a shaker: 21 sines from 10 Hz to 1 kHz, "
            f"{SAMPLES} samples each. The sensor feels noise {SNR_DB:g} dB below the motion; its "
            f"output carries {100 * RESPONSE_NOISE:g} % noise.",
            f"Look at: {folder}/calibration.toml, which says what the columns of the CSV files "
            "mean.",
        )
        with ProgressBar("Simulating"):
            write_demo(demo_folder)
        _print_chapter(
            "2  The identification",
            f"The same as: vibrident identify {file}",
            "Look at: u, the standard uncertainty of each value, and the verdict on the fit.",
        )
        with ProgressBar("Identifying") as progress:
            from vibrident.use.identification import identify

            result = identify(io.read(demo_folder / "calibration.toml"), progress=progress)
        # The final path, not the temporary one.
        provenance = {**result.provenance, "calibration_file": str(folder / "calibration.toml")}
        result = dataclasses.replace(result, provenance=provenance)
        output_console().print(terminal.summary(result))
        _print_chapter(
            "3  The paper's network beside it, and the truth",
            f"The same as: vibrident identify {file} --estimator ipnn --weights",
            "A simulation knows the truth. About two values in three lie within 1 u of it, 95 in "
            "100 within 2 u. The network's weights are the physics: its curve is that of a sensor "
            "with the parameters above it.",
        )
        with ProgressBar("Training the network") as progress:
            network = identify(
                io.read(demo_folder / "calibration.toml"), estimator="ipnn", progress=progress
            )
        network = dataclasses.replace(network, provenance=provenance)
        _show_comparison([result, network])
        _finish(demo_folder, folder, result, network, artist)


def _show_comparison(results: list[Result]) -> None:
    """Show parameters, curve and weights of the estimators beside the truth."""
    import numpy as np

    from vibrident.app.workflow.simulated import true_values
    from vibrident.physics.models import parse
    from vibrident.physics.simulation import SENSORS
    from vibrident.show import methods

    sensor = SENSORS[SENSOR]
    shown_hz = (10.0, 160.0, 630.0, 1000.0)
    response = parse(sensor.model).frequency_response(sensor.parameters, np.array(shown_hz))
    true = dict(zip(shown_hz, np.abs(response).tolist(), strict=True))
    show(methods.network_beside(results, true_values(sensor), true))


def _finish(
    demo_folder: Path, folder: Path, result: Result, network: Result, artist: Painter
) -> None:
    from vibrident.show import plots
    from vibrident.show.comparison_curves import comparison_figure
    from vibrident.show.report import render

    saved = result.save(demo_folder / "result.json")
    network.save(demo_folder / "network.json")
    with ProgressBar("Drawing"):
        artist.draw(result, saved)
        if (
            curves := comparison_figure([result, network], [result.estimator, network.estimator])
        ) is not None:
            plots.save(curves, demo_folder / "network.png")
    (demo_folder / "report.md").write_text(render(result, pictures=demo_folder), encoding="utf-8")
    records = result.measured.record
    files = {
        "calibration.toml": f"what the columns of the {len(records)} CSV files mean: {records[0]} "
        f"… {records[-1]}",
        "truth.json": "the simulated sensor's parameters",
        "result.json": "every number of step 2 and the curves; all else is made from it",
        "report.md": "a report with these pictures:",
        "sensitivity.png": "the sensitivity over frequency, model and measurement",
        "deviation.png": "their difference, which should scatter about zero within the bars",
        "signals.png": "measured and predicted response in time",
        "residuals.png": "what the model leaves, by record, and how it is distributed",
        "training.png": "loss and parameters by iteration",
        "network.json": "the paper's network of step 3: parameters, weights, curve",
        "network.png": "its curve beside that of step 2",
    }
    width = max(map(len, files))
    _print_chapter(
        "4  What is written",
        *(f"{folder}/{name:<{width}}  {words}" for name, words in files.items()),
    )


def _print_chapter(title: str, *lines: str) -> None:
    from rich.padding import Padding

    print_line(f"\n{title}", style="bold")
    for line in lines:
        output_console().print(Padding(printable(line), (0, 0, 0, 3), expand=False))
