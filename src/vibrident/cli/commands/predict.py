"""``vibrident predict``: the predicted response, beside the measured one."""

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
    from vibrident.prediction import Prediction, Predictions


def predict(
    result: Annotated[
        Path, typer.Argument(metavar="RESULT", help="result.json of an identification.", show_default=False)
    ],
    calibration: options.CalibrationFile,
    folder: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Folder for the CSV files and prediction.json.")
    ] = Path("vibrident-prediction"),
) -> None:
    """Predict the response of other records: a CSV file each, and their rmse in prediction.json.

    Each record's state at its first sample and its offset are fitted to its measured response.
    About forty samples at each end, where the reference cannot be interpolated, are blank.
    """
    from vibrident.io import read_guarded

    known = load_result(result)
    data = read_guarded(calibration)
    with written_whole(folder) as output:
        from vibrident.cli.progress import Busy

        with Busy("Predicting"):
            from vibrident.prediction import predict as run
            from vibrident.prediction import summary

            predictions = run(known, data)
        files = record_files([p.record.name for p in predictions.predictions])
        for file, prediction in zip(files, predictions.predictions, strict=True):
            _write_csv(output.path / file, prediction)
        document = {"model": known.model, **summary(predictions, files, data.response_unit)}
        text = json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
        (output.path / "prediction.json").write_text(text, encoding="utf-8")
    for finding in predictions.findings:
        note(f"Warning ({finding.code}): {finding.message}")
    _show(document, predictions, folder)


def _write_csv(path: Path, prediction: Prediction) -> None:
    """Columns time_s (the file's own clock), response and predicted; blank without a prediction."""
    record = prediction.record
    times = (record.start_time_s + record.time_s).tolist()
    rows = zip(times, record.response.tolist(), prediction.predicted.tolist(), strict=True)
    with path.open("w", encoding="ascii", newline="\n") as stream:
        stream.write("time_s,response,predicted\n")
        stream.writelines(f"{t!r},{y!r},{p!r}\n" if p == p else f"{t!r},{y!r},\n" for t, y, p in rows)


def _show(document: dict[str, Any], predictions: Predictions, folder: Path) -> None:
    from vibrident import terminal

    unit = document["unit"]
    rows = [
        {
            "record": row["name"],
            "samples": row["samples"],
            "compared": row["samples_compared"],
            f"rmse / {unit}": row["rmse"],
            "rmse / sd": row["nrmse"],
        }
        for row in document["records"]
    ]
    console = out()
    console.print(terminal.inspection_table(rows, "Predicted response"))
    if predictions.rmse is not None:
        console.print(f"rmse of all records: {predictions.rmse:.5g} {unit}", soft_wrap=True)
    wrote([folder / "prediction.json", folder / f"{len(rows)} CSV file{'s' * (len(rows) != 1)}"])
