"""``vibrident track``: a sensor's parameters kept up to date with the samples as they come, and alarms."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vibrident.app.cli import options
from vibrident.app.cli.console import note, out, say, show_rows, wrote
from vibrident.app.cli.options import between, flag, option
from vibrident.app.workflow.folder import load_result
from vibrident.base.errors import InputError

if TYPE_CHECKING:
    from vibrident.app.workflow.tracking import Files
    from vibrident.data.records import Record
    from vibrident.data.sources.source import Chunk
    from vibrident.result import Result
    from vibrident.use.tracking.session import Session
    from vibrident.use.tracking.state import Estimate

RECORDS = "calibration-records"  # the source where none is given
EVERY_S = 1.0  # time between rows of a stream, s, where --every does not say
WALK = 0.01  # random walk of a parameter in a year, relative, where no history tells it: a choice


def track(
    result: Path = options.RESULT_FILE,
    calibration: Path = options.CALIBRATION_FILE,
    folder: Path = option("--out", "DIR", "Folder for track.csv, track.json and the picture.", Path("vibrident-track")),
    follow: bool = flag("--follow", help="The record's file grows: go on as it does, and after an interruption."),
    stdin: str | None = option("--stdin", "csv|float32", "Take the samples from standard input."),
    source: str | None = option("--source", "NAME[=ADDRESS]", "Take them from tcp=HOST:PORT, or a plug-in."),
    idle: float | None = between("--idle", "SECONDS", "End after so long without samples.", 0.0, 1e9, default="wait"),
    every: float | None = between(
        "--every", "SECONDS", "Time between rows.", 1e-6, 1e9, default=f"{EVERY_S:g}, or a hundredth of the records"
    ),
    rate: float = between(
        "--false-alarms-per-day", "RATE", "False alarms expected in a day of motion.", 1e-9, 1e3, 0.01
    ),
    store: str | None = option(
        "--store", "URL", "History of the sensor, by whose random walk u grows.", default=f"{WALK:.0%} a year"
    ),
    no_plots: bool = flag("--no-pictures", "--no-plots", help="Draw no picture."),
) -> None:
    """Keep a sensor's parameters up to date, with their uncertainties, and say when the sensor changes.

    Takes the records of the calibration file, or samples as they come. Writes a row an interval in track.csv, and the
    end, the alarms and what was wrong with the samples in track.json, and the sensor as it is now in
    result.json, for other commands.
    """
    name, address = _chosen(follow=follow, stdin=stdin, source=source)
    known = load_result(result)
    from vibrident.app.workflow.tracking import Files
    from vibrident.data.io.calibration_file import read_calibration_file
    from vibrident.data.registry import SOURCES
    from vibrident.data.sources.source import Wanted
    from vibrident.use.tracking.session import Session
    from vibrident.use.tracking.state import Settings

    described = read_calibration_file(calibration)
    kind = SOURCES[name]
    rates = [described.sampling.rate_hz, *(entry.rate_hz for entry in described.records)]
    rate_hz, length_s = next(filter(None, rates), None), 0.0
    if name == RECORDS:
        records = _records(calibration, known)
        rate_hz, length_s = records[0].sampling_rate_hz, sum(record.duration_s for record in records)
    if rate_hz is None:
        raise InputError(
            "The sampling rate is not given.",
            expected="rate_hz under [sampling], or under [[records]] beside a time_column",
            found="none",
            where=str(calibration),
            remedy="add rate_hz = … (samples per second)",
        )
    settings = Settings(rate, _walks(store, known), described.reference.standard_uncertainty)
    seconds = every or (max(settings.block / rate_hz, min(EVERY_S, length_s / 100)) if length_s else EVERY_S)
    session = Session.of(known, rate_hz, described.reference.quantity, seconds, settings)
    key = {"result": known.to_json(), "file": calibration.read_text(encoding="utf-8"), "source": [name, address]}
    files = Files(folder, session, {**key, "settings": vars(settings), "every": seconds})
    position = files.begin(resumable=kind.resumable)
    wanted = Wanted(described, calibration, rate_hz, address, position, idle)
    with files.rows:
        with _live(session) as show:
            _run(kind.open(wanted), session, files, show, resumable=kind.resumable)
        document = files.end()
    _say(document)
    from vibrident.use.tracking.outcome import tracked_result

    written = [folder / "track.csv", folder / "track.json", tracked_result(known, session).save(folder / "result.json")]
    if not no_plots:
        written.append(_drawn(folder, document, dict(known.sensor)))
    wrote(written)


def _walks(store: str | None, known: Result) -> float | tuple[float, ...]:
    """Relative random walk of each parameter in a year, as the history tells it."""
    if store is None:
        return WALK
    from vibrident.lab.history.document import random_walks
    from vibrident.lab.history.store import Store

    with Store(store) as opened:
        told = random_walks(opened, known)
    names = known.to_sensor().model.parameter_names
    if untold := [name for name in names if name not in told]:
        note(f"The history tells no random walk of {', '.join(untold)}: {WALK:.0%} a year is taken.")
    return tuple(told.get(name, WALK) for name in names)


def _chosen(*, follow: bool, stdin: str | None, source: str | None) -> tuple[str, str]:
    """Name and address of the source."""
    name, _, address = (source or "").partition("=")
    given = [("follow", "")] if follow else []
    given += [("stdin", stdin)] if stdin is not None else []
    given += [(name, address)] if source else []
    if len(given) > 1:
        raise InputError(
            "More than one source is given.",
            expected="one of --follow, --stdin, --source",
            found=", ".join(name for name, _ in given),
            where="options",
            remedy="leave the others out",
        )
    return given[0] if given else (RECORDS, "")


def _records(calibration: Path, known: Result) -> Sequence[Record]:
    """The records, which must be in the unit of the result."""
    from vibrident.data.io import read_guarded

    data = read_guarded(calibration)
    data.require_response(known.response_unit, "A table has no samples to track a sensor by.")
    return data.records


def _run(chunks: Iterator[Chunk], session: Session, files: Files, show: Any, *, resumable: bool) -> None:
    said, changing = (len(session.alarms), len(session.troubles)), session.changing
    for chunk in chunks:
        rows = session.take(chunk)
        files.write(rows)
        if session.changing not in (changing, None):
            changing = session.changing
            note(f"Something changed at {changing[0]:.12g} s; what it was is said when it is learned.")
        for alarm in session.alarms[said[0] :]:
            change = f"{alarm.parameter} {alarm.before:.6g} → {alarm.after:.6g}"
            note(f"Alarm at {alarm.time_s:.12g} s: {change}: {alarm.what}")
        for trouble in session.troubles[said[1] :]:
            note(f"{trouble.samples} samples {trouble.what} at {trouble.time_s:.12g} s")
        said = len(session.alarms), len(session.troubles)
        if resumable and chunk.position:
            files.keep(chunk.position)
        if rows:
            show(rows[-1])


@contextlib.contextmanager
def _live(session: Session) -> Iterator[Any]:
    """What shows a row: a table that is renewed, on a terminal."""
    console = out()
    if not console.is_terminal:
        yield lambda row: None
        return
    from rich.live import Live

    from vibrident.show.terminal import inspection_table

    with Live(console=console, transient=True, refresh_per_second=4) as live:

        def show(row: Estimate) -> None:
            rows = _rows(row.values, row.uncertainty, session.units)
            rows = [{**each, "excited": each["parameter"] in row.excited} for each in rows]
            live.update(inspection_table(rows, f"Tracked, {row.time_s:.6g} s"))

        yield show


def _rows(values: Any, u: Any, units: Any) -> list[dict[str, Any]]:
    """Parameters by name, to the second digit of u."""
    from vibrident.show.numbers import pair

    numbers = {name: pair(value, u[name]) for name, value in values.items()}
    return [
        {"parameter": name, "value": value, "u": rounded, "unit": units[name]}
        for name, (value, rounded) in numbers.items()
    ]


def _say(document: dict[str, Any]) -> None:
    value, u, units = (
        {name: each[key] for name, each in document["parameters"].items()}
        for key in ("value", "standard_uncertainty", "unit")
    )
    show_rows(_rows(value, u, units), f"Tracked sensor, {document['time_s']:.12g} s")
    shown = ("time_s", "parameter", "from", "to", "what")
    if alarms := [{key: alarm[key] for key in shown} for alarm in document["alarms"]]:
        show_rows(alarms, "Alarms")
    if changing := document["changing"]:
        say(f"something changed at {changing['time_s']:.12g} s; too little motion followed to tell what")
    elif not alarms:
        say("no alarm")


def _drawn(folder: Path, document: dict[str, Any], sensor: dict[str, object]) -> Path:
    from pandas import read_csv

    from vibrident.show import plots

    table = read_csv(folder / "track.csv")
    columns = {name: table[name].to_numpy(dtype=float) for name in table.columns if name != "excited"}
    return plots.save(plots.tracking(columns, document, sensor), folder / "track.png")
