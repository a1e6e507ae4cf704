"""``vibrident history``: the calibrations of every sensor in a store, with drift and due dates."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from vibrident.app.cli.console import note, print_line, show, show_written
from vibrident.app.cli.history_options import (
    build_question,
    open_store,
    read_date,
    read_tolerance,
)
from vibrident.app.cli.options import (
    CERTIFICATE_FILES,
    RESULT_FILES,
    argument,
    between,
    choice,
    option,
    require_choice,
)
from vibrident.app.workflow.folder import load_result, write_json, written_whole
from vibrident.base.errors import InputError
from vibrident.base.fields import GivenFields

if TYPE_CHECKING:
    from vibrident.result import Result
    from vibrident.show.views import Block

history = typer.Typer(
    no_args_is_help=True,
    help="Keep every calibration of every sensor; drift, agreement, due dates.",
)

PICTURES = (".png", ".svg", ".pdf")

_STORE = option(
    "--store",
    "URL",
    "sqlite:///FILE, FILE.db or postgresql://USER@HOST/DATABASE.",
    default="VIBRIDENT_STORE, else a file in the user's data folder",
)
_SERIAL = argument("SERIAL", "Serial number.")
_CALIBRATION = argument("ID", "Number of the calibration.")
_TYPE = option("--type", "TYPE", "Of sensors with one serial number.")
_MAKER = option("--manufacturer", "NAME", "Of sensors with one serial number.")
_AXIS = option("--axis", "AXIS", "Of sensors with several.")
_FORM = choice("--format", ("text", "json"), "Tables, or one JSON document.", "text")
_BY = option("--by", "NAME", "Author of the entry.", default="the account")
_APPROVER = option(
    "--by", "NAME", "Who approves.", default="approved_by of the certificate, else the account"
)
_NOTE = option("--note", "TEXT", "Why.", "")
_QUANTITY = option(
    "--quantity",
    "NAME",
    "A parameter of the results, such as natural_frequency.",
    default="the sensitivity at the reference frequency",
)
_FREQUENCY = option(
    "--frequency", "HZ", "The sensitivity at this nominal frequency.", default=False
)
_TOLERANCE = option("--tolerance", "REL", "Tolerance: 1% or 0.01.", default=False)
_NOMINAL = option(
    "--nominal",
    "VALUE",
    "Value it is used with, in the unit without prefix, as V/(m/s²).",
    default="the last calibration's",
)
_LIMITS = option(
    "--limits", "FILE", "Nominal values and tolerances by type, as for `vibrident fleet`."
)
_INTERVAL = between(
    "--interval",
    "YEARS",
    "Interval in force, years.",
    1e-3,
    1e3,
    default="between the last two calibrations",
)


@history.command("add")
def add(
    results: list[Path] = RESULT_FILES,
    store: str | None = _STORE,
    serial: str | None = option("--serial", "SERIAL", "For results without one."),
    date: str | None = option(
        "--date", "DATE", "Of the calibration, where the result states none."
    ),
    certificate: list[Path] | None = CERTIFICATE_FILES,
) -> None:
    """Add results. An existing result stays unchanged; where it states no date, another --date \
corrects that by an event. A stated date is corrected by `event --kind redated`."""
    day = read_date(date, "--date")
    from vibrident.lab.history.entry import add_all, rows_of
    from vibrident.show.issue import issued
    from vibrident.show.views import count

    def read(path: Path) -> Result:
        return issued(load_result(path), certificate or [])[0]

    for path in results:  # check all before adding any
        loaded = read(path)
        try:
            rows_of(loaded, serial, day)
        except InputError as error:
            raise error.within(str(path)) from error
    with open_store(store) as opened:
        added = list(add_all(opened, map(read, results), serial_number=serial, date=day))
        for path, entry in zip(results, added, strict=True):
            stored = "" if entry.new else ", already stored"
            if entry.former_date is not None:
                stored += f"; its date is now {day}, it was {entry.former_date}"
            print_line(f"{path}: calibration {entry.number}{stored}")
        new_ones = sum(entry.new for entry in added)
        note(f"{new_ones} of {count(len(added), 'result')} new in {opened.printed}")


@history.command("list")
def list_sensors(
    store: str | None = _STORE, type_name: str | None = _TYPE, form: str = _FORM
) -> None:
    """List the sensors, with the number of their calibrations and the dates of the first and \
the last."""
    from vibrident.lab.history import tables
    from vibrident.lab.history.document import listed
    from vibrident.show.views import count

    with open_store(store) as opened:
        rows = listed(opened, type_name)
    _print(form, rows, lambda: [replace(tables.listed(rows), title=count(len(rows), "sensor"))])


@history.command("show")
def show_sensor(
    serial: str = _SERIAL,
    store: str | None = _STORE,
    type_name: str | None = _TYPE,
    axis: str | None = _AXIS,
    maker: str | None = _MAKER,
    quantity: str | None = _QUANTITY,
    frequency: float | None = _FREQUENCY,
    until: str | None = option(
        "--at", "DATE", "Predict for it.", default="the end of the interval"
    ),
    tolerance: str | None = _TOLERANCE,
    nominal: float | None = _NOMINAL,
    limits: Path | None = _LIMITS,
    interval: float | None = _INTERVAL,
    form: str = _FORM,
    target: Path | None = option(
        "--out", "FILE", "Write it as .html, .png, .svg, .pdf or .json too."
    ),
) -> None:
    """Show every calibration of a sensor, their agreement, drift, prediction, and control \
charts."""
    from vibrident.lab.history import page, query
    from vibrident.lab.history.document import of_sensor

    if target is not None:
        require_choice("--out", target.suffix.lower(), (".html", *PICTURES, ".json"))
    question = build_question(
        quantity,
        frequency,
        read_tolerance(tolerance, nominal),
        limits,
        interval,
        read_date(until, "--at"),
    )
    with open_store(store) as opened:
        document = of_sensor(opened, query.find(opened, serial, type_name, axis, maker), question)
    _print(form, document, lambda: page.printed(document))
    if target is not None:
        _write(document, target)


@history.command("due")
def due(
    serial: str | None = argument("[SERIAL]", "Serial number.", None, "all sensors"),
    tolerance: str | None = _TOLERANCE,
    store: str | None = _STORE,
    type_name: str | None = _TYPE,
    axis: str | None = _AXIS,
    maker: str | None = _MAKER,
    quantity: str | None = _QUANTITY,
    frequency: float | None = _FREQUENCY,
    nominal: float | None = _NOMINAL,
    limits: Path | None = _LIMITS,
    interval: float | None = _INTERVAL,
    form: str = _FORM,
) -> None:
    """Say when each sensor is due: by the risk of being outside the tolerance, the \
interval, and the staircase."""
    given_tolerance = read_tolerance(tolerance, nominal)
    if (given_tolerance is None) == (limits is None):
        raise InputError(
            "No tolerance is given." if limits is None else "Two tolerances are given.",
            expected="a tolerance such as 1%, or a file of limits by type",
            found="none" if limits is None else "both",
            where="--tolerance, --limits",
            remedy="give --tolerance or --limits, not both",
        )
    from vibrident.lab.history import query, tables
    from vibrident.lab.history.document import all_due, of_sensor
    from vibrident.show.views import count

    question = build_question(quantity, frequency, given_tolerance, limits, interval)
    with open_store(store) as opened:
        if serial is not None:
            sensor = query.find(opened, serial, type_name, axis, maker)
            document = of_sensor(opened, sensor, question)
            rows = all_due(opened, question, type_name, sensor.id)
            _print(form, rows, lambda: [tables.due(document) or tables.all_due(rows)])
            return
        rows = all_due(opened, question, type_name)
    within = (
        f"tolerance ±{100 * given_tolerance.relative:g} %"
        if given_tolerance is not None
        else "tolerances by type"
    )
    title = f"{count(len(rows), 'sensor')}, the soonest first; {within}"
    _print(form, rows, lambda: [replace(tables.all_due(rows), title=title)])


@history.command("approve")
def approve(
    number: int = _CALIBRATION,
    store: str | None = _STORE,
    by: str | None = _APPROVER,
    note_text: str = _NOTE,
) -> None:
    """Approve a calibration. Other evaluations of the same data are superseded."""
    from vibrident.lab.history import approval

    with open_store(store) as opened:
        superseded = approval.approve(opened, number, by=by, note=note_text)
    print_line(f"Calibration {number} is approved.")
    for number_superseded in superseded:
        print_line(f"Calibration {number_superseded}, of the same data, is superseded.")


@history.command("event")
def event(
    serial: str = _SERIAL,
    kind: str = choice(
        "--kind",
        ("repaired", "recalled", "superseded", "redated"),
        "What happened.",
        ...,
        default=False,
    ),
    date: str | None = option("--date", "DATE", "When.", default="today"),
    calibration: int | None = option(
        "--calibration", "ID", "Of this calibration, not of the sensor."
    ),
    note_text: str = _NOTE,
    by: str | None = _BY,
    store: str | None = _STORE,
    type_name: str | None = _TYPE,
    axis: str | None = _AXIS,
    maker: str | None = _MAKER,
) -> None:
    """Enter what happened to a sensor, or to one of its calibrations; redated: its date is \
--date."""
    day = read_date(date, "--date")
    from vibrident.lab.history import entry, query

    with open_store(store) as opened:
        sensor = query.find(opened, serial, type_name, axis, maker)
        entry.add_event(
            opened, sensor, kind, date=day, calibration_id=calibration, by=by, note=note_text
        )
    subject = sensor.name if calibration is None else f"Calibration {calibration} of {sensor.name}"
    print_line(f"{subject}: {kind}, {day or datetime.date.today()}")


@history.command("result")
def result(
    number: int = _CALIBRATION,
    target: Path = option("--out", "FILE", "result.json to write.", ..., False),
    store: str | None = _STORE,
) -> None:
    """Write a stored result to a file."""
    from vibrident.lab.history import query

    with open_store(store) as opened:
        stored = query.result(opened, number)
    with written_whole(target.parent) as output:
        stored.save(output.path / target.name)
    show_written(output.files)


@history.command("export")
def export(
    target: Path = argument("FILE.parquet|FILE.csv", "File to write."), store: str | None = _STORE
) -> None:
    """Write one row a calibration, with every parameter and its standard uncertainty."""
    from vibrident.lab.history import query, table_file

    require_choice("FILE", target.suffix.lower(), (".parquet", ".csv"))
    with open_store(store) as opened:
        rows = list(query.rows(opened))
    with written_whole(target.parent) as output:
        table_file.write(rows, output.path / target.name)
    show_written(output.files)


@history.command("upgrade")
def upgrade(store: str | None = _STORE) -> None:
    """Upgrade a store of an older version, with its data; or create a new one."""
    with open_store(store) as opened:
        before, after = opened.upgrade()
        if before is None:
            state = "is new"
        else:
            state = "was up to date" if before == after else f"was at schema {before}"
        print_line(f"{opened.printed} {state}; schema {after}")


def _print(form: str, content: Any, blocks: Callable[[], Iterable[Block | None]]) -> None:
    """Print the content as one JSON document, or the blocks made of it."""
    if form == "json":
        from vibrident.result.document import json_text

        typer.echo(json_text(content), nl=False)
    else:
        show(*blocks())


def _write(document: GivenFields, target: Path) -> None:
    """Write the history of one sensor in the form that the file's ending names."""
    with written_whole(target.parent) as output:
        file = output.path / target.name
        if target.suffix.lower() in PICTURES:
            from vibrident.lab.history.page import picture
            from vibrident.show import plots

            plots.save(picture(document), file)
        elif target.suffix.lower() == ".html":
            from vibrident.lab.history import page
            from vibrident.show.media import html

            file.write_text(html.render(page.report(document)), encoding="utf-8")
        else:
            write_json(file, document)
    show_written(output.files)
