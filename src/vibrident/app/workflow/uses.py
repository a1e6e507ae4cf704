"""Use a result as a shell or a page asks for it: predict, correct, plan."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibrident.app.workflow.folder import write_json, write_samples
from vibrident.app.workflow.task_output import TaskOutput
from vibrident.base.fields import Fields
from vibrident.show.rows import table_of
from vibrident.show.views import Sentence

if TYPE_CHECKING:
    from vibrident.data.records import Calibration
    from vibrident.result import Result
    from vibrident.use.planning import MountedSensor, Plan


def predict(identified: Result, data: Calibration, folder: Path) -> TaskOutput:
    """Write the predicted response of each record as CSV, and their rmse in prediction.json."""
    from vibrident.data.io.writer import record_files
    from vibrident.use.prediction import predict as run
    from vibrident.use.prediction import prediction_document

    predictions = run(identified, data)
    files = record_files([p.record.name for p in predictions.predictions])
    for file, prediction in zip(files, predictions.predictions, strict=True):
        record = prediction.record
        write_samples(
            folder / file, record, response=record.response, predicted=prediction.predicted
        )
    document = {
        "model": identified.model,
        **prediction_document(predictions, files, data.response_unit),
    }
    write_json(folder / "prediction.json", document)
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
    blocks: tuple[Any, ...] = (table_of(rows, "Predicted response"),)
    if predictions.rmse is not None:
        blocks += (Sentence(f"rmse of all records: {predictions.rmse:.5g} {unit}"),)
    return TaskOutput(blocks, findings=tuple(predictions.findings))


def correct(
    identified: Result,
    data: Calibration,
    folder: Path,
    *,
    band_hz: tuple[float, float] | None = None,
    noise: float | None = None,
    track: bool = False,
) -> TaskOutput:
    """Write the restored motion of each record as CSV, with an uncertainty for every sample.

    ``band_hz``, ``noise``: as of :func:`vibrident.use.correction.correct`; ``track``: whether the
    sensor is tracked through the records. The document is correction.json.
    """
    from vibrident.data.io.writer import record_files
    from vibrident.show.use_figures import correction as figure
    from vibrident.use.correction import correct as run
    from vibrident.use.correction import correction_document

    if track:
        from vibrident.use.tracking.adaptive import correct_tracked

        corrections = correct_tracked(identified, data, band_hz=band_hz, noise=noise)
    else:
        corrections = run(identified, data, band_hz=band_hz, noise=noise)
    files = record_files([c.record.name for c in corrections.corrections])
    for file, correction in zip(files, corrections.corrections, strict=True):
        a = correction.acceleration
        u = correction.standard_uncertainty
        write_samples(folder / file, correction.record, acceleration=a, standard_uncertainty=u)
    document = correction_document(corrections, files)
    write_json(folder / "correction.json", document)
    return TaskOutput(
        (table_of(_corrected(document), f"Restored {corrections.motion}"),),
        (figure(corrections, dict(identified.sensor)),),
        tuple(corrections.findings),
    )


def _corrected(document: Fields) -> list[Fields]:
    """Return a row a record: band, peak with its interval, and rmse from a reference."""
    from vibrident.base.amounts import pretty

    unit = pretty(document["unit"])
    rows = []
    for row in document["records"]:
        band = row["band"]
        reference = row["reference"]
        peak, interval, share = (None, None, None) if row["peak"] is None else _peak(row["peak"])
        rows.append(
            {
                "record": row["name"],
                "band / Hz": f"{band['low_hz']:.4g} to {band['high_hz']:.4g}",
                f"peak / {unit}": peak,
                "95 % interval": interval,
                "u / peak": share,
                f"rmse / {unit}": None if reference is None else reference["rmse"],
            }
        )
    return rows


def _peak(peak: Fields) -> tuple[float, str, str]:
    """Return the value of a peak, both ends of its interval, and u over the value.

    The ends have the second digit of u.
    """
    from vibrident.show.numbers import NONE, pair, uncertainty

    value = peak["value"]
    u = peak["standard_uncertainty"]
    interval = " … ".join(pair(end, u)[0] for end in peak["interval_95"])
    return value, interval, f"{uncertainty(100 * abs(u / value))} %" if value else NONE


def describe_plan(plan: Plan) -> TaskOutput:
    """Return the output of a plan: expected uncertainties, frequencies, efficiency, warnings."""
    from vibrident.show import methods
    from vibrident.show.use_figures import plan as figure

    pairs = zip(plan.frequency_hz, plan.uses, strict=True)
    listed = ", ".join(f"{f:.5g}" + (f" (×{n})" if n > 1 else "") for f, n in pairs)
    lines = [f"Frequencies in Hz: {listed}"]
    if plan.efficiency is not None:
        lines.append(
            f"{plan.criterion}-optimal choice of {sum(plan.uses)} out of "
            f"{plan.candidates_hz.size}; efficiency {100 * plan.efficiency:.0f} % of the best "
            "possible in the same measuring time."
        )
    notes = tuple(f"Warning: {warning}" for warning in plan.warnings)
    sentences = tuple(map(Sentence, lines))
    return TaskOutput((methods.planned(plan), *sentences), (figure(plan),), notes=notes)


def write_plan(plan: Plan, folder: Path) -> None:
    """Write plan.json."""
    from vibrident.use.planning import plan_document

    write_json(folder / "plan.json", plan_document(plan))


def describe_mounted(result: Result, mounted: MountedSensor) -> TaskOutput:
    """Return the output of another mounting: both sensitivities and their difference."""
    from vibrident.show import methods
    from vibrident.show.use_figures import mounting as figure

    frequency_hz, damping = mounted.mounting
    sentence = f"Mounting: {frequency_hz:.5g} Hz, damping ratio {damping:.3g}. U with k = 2."
    return TaskOutput(
        (methods.mounted(result, mounted), Sentence(sentence)), (figure(result, mounted),)
    )


def write_mounted(mounted: MountedSensor, folder: Path) -> None:
    """Write mounting.csv: both sensitivities by frequency."""
    from vibrident.use.planning import mounted_document

    columns = mounted_document(mounted)
    rows = [",".join(columns)]
    rows += [
        ",".join(f"{value:.10g}" for value in row) for row in zip(*columns.values(), strict=True)
    ]
    (folder / "mounting.csv").write_text("\n".join(rows) + "\n", encoding="utf-8")
