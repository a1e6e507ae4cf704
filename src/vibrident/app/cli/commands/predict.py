"""``vibrident predict``: the predicted response, beside the measured one."""

from __future__ import annotations

from pathlib import Path

from vibrident.app.cli import options
from vibrident.app.cli.console import say, show_rows, warn, write_samples, wrote
from vibrident.app.cli.options import option
from vibrident.app.cli.progress import Busy
from vibrident.app.workflow.folder import load_result, write_json, written_whole


def predict(
    result: Path = options.RESULT_FILE,
    calibration: Path = options.CALIBRATION_FILE,
    folder: Path = option(
        "--out", "DIR", "Folder for the CSV files and prediction.json.", Path("vibrident-prediction")
    ),
) -> None:
    """Predict the response of other records: a CSV file each, and their rmse in prediction.json.

    Each record's state at its first sample and its offset are fitted to its measured response.
    About forty samples at each end, where the reference cannot be interpolated, are blank.
    """
    from vibrident.data.io import read_guarded
    from vibrident.data.io.writer import record_files

    known = load_result(result)
    data = read_guarded(calibration)
    with written_whole(folder) as output:
        with Busy("Predicting"):
            from vibrident.use.prediction import predict as run
            from vibrident.use.prediction import prediction_document

            predictions = run(known, data)
        files = record_files([p.record.name for p in predictions.predictions])
        for file, prediction in zip(files, predictions.predictions, strict=True):
            record = prediction.record
            write_samples(output.path / file, record, response=record.response, predicted=prediction.predicted)
        document = {"model": known.model, **prediction_document(predictions, files, data.response_unit)}
        write_json(output.path / "prediction.json", document)
    warn(predictions.findings)
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
    show_rows(rows, "Predicted response")
    if predictions.rmse is not None:
        say(f"rmse of all records: {predictions.rmse:.5g} {unit}")
    wrote([folder / "prediction.json", folder / "*.csv"])
