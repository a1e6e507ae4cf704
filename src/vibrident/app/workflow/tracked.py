"""Track a sensor through samples, as a shell or a page asks for it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibrident.app.workflow.folder import inputs_of, load_result, refuse_to_replace
from vibrident.app.workflow.task_output import TaskOutput
from vibrident.app.workflow.tracking import RECORDS, TrackingFiles
from vibrident.base.errors import InputError
from vibrident.base.fields import Fields, NamedNumbers, NamedTexts
from vibrident.base.progress import SILENT, ProgressReporter
from vibrident.show.rows import table_of
from vibrident.show.views import Sentence
from vibrident.use.tracking import DRIFT_PER_YEAR, EVERY_S, FALSE_ALARMS_PER_DAY

if TYPE_CHECKING:
    from vibrident.data.io.calibration_file import CalibrationFile
    from vibrident.data.records import Calibration
    from vibrident.data.sources.source import Chunk
    from vibrident.result import Result
    from vibrident.use.tracking.session import TrackingSession


def track(
    result: Path,
    calibration: Path,
    folder: Path,
    *,
    source: str = RECORDS,
    address: str = "",
    idle_s: float | None = None,
    every_s: float | None = None,
    false_alarms_per_day: float = FALSE_ALARMS_PER_DAY,
    store: str | None = None,
    progress: ProgressReporter = SILENT,
) -> tuple[TaskOutput, list[Path]]:
    """Track a sensor; return the output, and the written files.

    These are track.csv, track.json and result.json.

    Args:
        result: of an identification.
        calibration: its file.
        folder: of the files written.
        source: of the samples, by name.
        address: of the source.
        idle_s: without samples after which a stream ends; None to wait.
        every_s: between rows; None for a hundredth of the records.
        false_alarms_per_day: expected of noise alone.
        store: history by whose random walk u grows.
        progress: gets the progress.

    Raises:
        InputError: no sampling rate is stated, or the samples are in another unit.
    """
    from vibrident.data.io import read_guarded
    from vibrident.data.io.calibration_file import read_calibration_file
    from vibrident.data.known import refuse_known
    from vibrident.data.registry import SOURCES
    from vibrident.data.sources.source import SourceRequest
    from vibrident.use.tracking.outcome import tracked_result
    from vibrident.use.tracking.session import TrackingSession
    from vibrident.use.tracking.state import TrackerSettings

    outputs = [folder / name for name in ("track.csv", "track.json", "result.json")]
    refuse_to_replace([result, *inputs_of(calibration)], outputs)
    calibrated = load_result(result)
    described = read_calibration_file(calibration)
    kind = SOURCES[source]
    walks = _walks(store, calibrated, progress)
    reference_u = described.reference.standard_uncertainty
    settings = TrackerSettings(false_alarms_per_day, walks, reference_u)
    rate_hz = length_s = 0.0
    chunks: Iterator[Chunk] = iter(())
    if source == RECORDS:
        data = read_guarded(calibration)
        _note_known_records(calibrated, data, progress)
        length_s = sum(record.duration_s for record in data.records)
        session, chunks = TrackingSession.from_records(calibrated, data, settings, every_s)
    else:
        channels = ("reference", "response")
        by_channel = {name: getattr(described, name).known_response for name in channels}
        refuse_known(by_channel, "Tracking of samples as they come", str(calibration))
        rate_hz = _sampling_rate_hz(described, calibration)
        quantity = described.reference.quantity
        session = TrackingSession.from_result(
            calibrated, rate_hz, quantity, every_s or EVERY_S, settings
        )
    key = {
        "result": calibrated.to_json(),
        "file": calibration.read_text(encoding="utf-8"),
        "source": [source, address],
        "settings": vars(settings),
        "every": session.every,
    }
    files = TrackingFiles(folder, session, key)
    position = files.begin(resumable=kind.resumable)
    with files.rows:
        if source != RECORDS:
            request = SourceRequest(described, calibration, rate_hz, address, position, idle_s)
            chunks = kind.open(request)
        _run(chunks, session, files, progress, resumable=kind.resumable, length_s=length_s)
        document = files.end()
    tracked_result(calibrated, session).save(outputs[-1])
    return _describe(document, folder, dict(calibrated.sensor)), outputs


def _note_known_records(calibrated: Result, data: Calibration, progress: ProgressReporter) -> None:
    """Say which records the calibration was made from: their information counts twice."""
    known = {file["sha256"] for file in calibrated.provenance.get("files", ())}
    names = [record.name for record in data.records if record.provenance.sha256 in known]
    if names:
        progress.note(
            f"Note: the result was identified from {', '.join(names)}, too: what they say counts "
            "twice, and the uncertainties are too small."
        )


def _sampling_rate_hz(described: CalibrationFile, calibration: Path) -> float:
    for entry in (described.sampling, *described.records):
        if entry.rate_hz:
            return entry.rate_hz
    raise InputError(
        "The sampling rate is not given.",
        expected="rate_hz under [sampling], or under [[records]] beside a time_column",
        found="none",
        where=str(calibration),
        remedy="add rate_hz = … (samples per second)",
    )


def parameter_rows(values: NamedNumbers, u: NamedNumbers, units: NamedTexts) -> list[Fields]:
    """Return parameters in words, to the second digit of u, in units with a prefix that suits."""
    from vibrident.base.amounts import scaled
    from vibrident.physics.naming import in_words
    from vibrident.show.numbers import pair

    rows: list[Fields] = []
    for name, value in values.items():
        scale = scaled(units[name], value)
        printed, rounded = pair(scale.times(value), scale.times(u[name]))
        rows.append(
            {"parameter": in_words(name), "value": printed, "u": rounded, "unit": scale.unit}
        )
    return rows


def _walks(
    store: str | None, calibrated: Result, progress: ProgressReporter
) -> float | tuple[float, ...]:
    """Return the relative random walk of each parameter in a year, from the history."""
    if store is None:
        return DRIFT_PER_YEAR
    from vibrident.lab.history.document import random_walks
    from vibrident.lab.history.store import Store

    with Store(store) as opened:
        walks = random_walks(opened, calibrated)
    names = calibrated.to_sensor().model.parameter_names
    if untold := [name for name in names if name not in walks]:
        walk = f"{DRIFT_PER_YEAR:.0%} a year is taken."
        progress.note(f"The history tells no random walk of {', '.join(untold)}: {walk}")
    return tuple(walks.get(name, DRIFT_PER_YEAR) for name in names)


def _run(
    chunks: Iterator[Chunk],
    session: TrackingSession,
    files: TrackingFiles,
    progress: ProgressReporter,
    *,
    resumable: bool,
    length_s: float,
) -> None:
    reported = (len(session.alarms), len(session.troubles))
    changing = session.changing
    start_s: float | None = None
    for chunk in chunks:
        rows = session.take(chunk)
        files.write(rows)
        if session.changing not in (changing, None):
            changing = session.changing
            progress.note(
                f"Something changed at {changing[0]:.12g} s; what it was is said when it is "
                "learned."
            )
        for alarm in session.alarms[reported[0] :]:
            change = f"{alarm.parameter} {alarm.before:.6g} → {alarm.after:.6g}"
            progress.note(f"Alarm at {alarm.time_s:.12g} s: {change}: {alarm.what}")
        for trouble in session.troubles[reported[1] :]:
            progress.note(f"{trouble.samples} samples {trouble.what} at {trouble.time_s:.12g} s")
        reported = len(session.alarms), len(session.troubles)
        if resumable and chunk.position:
            files.keep(chunk.position)
        for row in rows:
            progress.estimate(row, session.units)
        if rows and length_s:
            start_s = rows[0].time_s if start_s is None else start_s
            done_s = min(rows[-1].time_s - start_s, length_s)
            progress.share(
                f"Tracking, {done_s:.4g} of {length_s:.4g} s",
                round(1000 * done_s),
                round(1000 * length_s),
            )


def _describe(document: Fields, folder: Path, sensor: dict[str, object]) -> TaskOutput:
    """Return the sensor at the end, the alarms, and the chart of track.csv."""
    from pandas import read_csv

    from vibrident.show.use_figures import tracking as figure

    value, u, units = (
        {name: parameter[key] for name, parameter in document["parameters"].items()}
        for key in ("value", "standard_uncertainty", "unit")
    )
    title = f"Tracked sensor, {document['time_s']:.12g} s"
    blocks: list[Any] = [table_of(parameter_rows(value, u, units), title)]
    alarm_columns = ("time_s", "parameter", "from", "to", "what")
    if alarms := [{key: alarm[key] for key in alarm_columns} for alarm in document["alarms"]]:
        blocks.append(table_of(alarms, "Alarms"))
    if changing := document["changing"]:
        at_s = f"{changing['time_s']:.12g} s"
        blocks.append(
            Sentence(f"something changed at {at_s}; too little motion followed to tell what")
        )
    elif not alarms:
        blocks.append(Sentence("no alarm"))
    table = read_csv(folder / "track.csv")
    columns = {
        name: table[name].to_numpy(dtype=float) for name in table.columns if name != "excited"
    }
    return TaskOutput(tuple(blocks), (figure(columns, document, sensor),))
