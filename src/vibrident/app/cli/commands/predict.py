"""``vibrident predict``: the predicted response, beside the measured one."""

from __future__ import annotations

from pathlib import Path

from vibrident.app.cli import options
from vibrident.app.cli.console import show_output, show_written
from vibrident.app.cli.options import option
from vibrident.app.cli.progress import ProgressBar
from vibrident.app.workflow.folder import inputs_of, load_result, written_whole


def predict(
    result: Path = options.RESULT_FILE,
    calibration: Path = options.CALIBRATION_FILE,
    folder: Path = option(
        "--out",
        "DIR",
        "Folder for the CSV files and prediction.json.",
        Path("vibrident-prediction"),
    ),
) -> None:
    """Predict the response of other records: a CSV file each, and their rmse in prediction.json.

    Each record's state at its first sample and its offset are fitted to its measured response.
    About forty samples at each end, where the reference cannot be interpolated, are blank.
    """
    from vibrident.data.io import read_guarded

    identified = load_result(result)
    data = read_guarded(calibration)
    inputs = [result, *inputs_of(calibration)]
    with written_whole(folder, inputs) as output, ProgressBar("Predicting"):
        from vibrident.app.workflow.uses import predict as run

        prediction = run(identified, data, output.path)
    show_output(prediction)
    show_written([folder / "prediction.json", folder / "*.csv"])
