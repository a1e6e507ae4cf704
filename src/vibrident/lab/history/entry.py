"""Additions to the store: results, each once, and events."""

from __future__ import annotations

import datetime
import getpass
import itertools
import json
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import sqlalchemy as sa

from vibrident.base.errors import InputError
from vibrident.base.fields import Fields, GivenFields, NamedTexts
from vibrident.lab.history import query, schema
from vibrident.lab.history.query import StoredSensor
from vibrident.lab.history.result_rows import (
    SENSOR_KEYS,
    ResultRows,
    identity,
    rows_of,
)
from vibrident.lab.history.schema import calibration
from vibrident.lab.history.store import Store
from vibrident.result import Result

_AT_ONCE = 20  # results in one transaction: few, so that other writers wait for milliseconds only


class Added(NamedTuple):
    """Outcome of adding a result."""

    new: bool  # False for one that the store holds already
    number: int  # of the calibration in the store
    # date until now of a calibration that the store holds and that was given another one; else None
    former_date: datetime.date | None = None


def add_all(
    store: Store,
    results: Iterable[Result],
    *,
    serial_number: str | None = None,
    date: datetime.date | None = None,
) -> Iterator[Added]:
    """Add results, and yield the outcome of each.

    A result that the store holds already stays as it is. Where a ``date`` is given that is not the
    one in the store, the event ``redated`` corrects it.

    Raises:
        InputError: as :func:`rows_of`; the results before this one are then in the store.
    """
    store.begin()
    prepared = (rows_of(result, serial_number, date) for result in results)
    while batch := list(itertools.islice(prepared, _AT_ONCE)):
        with store.writing() as connection:
            added = [_insert(store, connection, rows, date) for rows in batch]
        yield from added


def _insert(
    store: Store, connection: sa.Connection, rows: ResultRows, date: datetime.date | None
) -> Added:
    sensor_id = _sensor_id(store, connection, rows.sensor)
    same = _find_same_result(connection, sensor_id, rows.calibration)
    if same is not None:
        return Added(
            False, same, None if date is None else _redate(connection, sensor_id, same, date)
        )
    _check_number(store, connection, rows)
    key = connection.execute(
        store.insert(schema.calibration)
        .values(rows.calibration | {"sensor_id": sensor_id})
        .on_conflict_do_nothing()
        .returning(schema.calibration.c.id)
    ).scalar_one_or_none()
    if key is None:  # another writer was faster
        return _insert(store, connection, rows, date)
    for table, rows_of_table in ((schema.parameter, rows.parameters), (schema.point, rows.points)):
        if rows_of_table:
            connection.execute(
                sa.insert(table), [row | {"calibration_id": key} for row in rows_of_table]
            )
    record(connection, {"sensor_id": sensor_id, "calibration_id": key, "kind": "added"})
    return Added(True, key)


def _find_same_result(connection: sa.Connection, sensor_id: int, row: Fields) -> int | None:
    """Return the number of the calibration that holds the same result; None if there is none."""
    columns = calibration.c
    same = connection.execute(
        sa.select(columns.id).where(columns.sha256 == row["sha256"])
    ).scalar_one_or_none()
    if same is not None:
        return same
    # earlier versions hashed the text: those of the same data are compared by what they say
    alike = sa.and_(
        columns.sensor_id == sensor_id,
        columns.estimator == row["estimator"],
        columns.data_files == row["data_files"],
        columns.chi2_reduced.is_not_distinct_from(row["chi2_reduced"]),
    )
    for number, packed in connection.execute(sa.select(columns.id, columns.document).where(alike)):
        if identity(query.unpacked(packed)) == row["sha256"]:
            return number
    return None


def _check_number(store: Store, connection: sa.Connection, rows: ResultRows) -> None:
    """Refuse a certificate number that a laboratory gave to another measurement.

    Evaluations of the same data state one number, and so do the axes of one sensor; one of them
    is certified.
    """
    row_added = rows.calibration
    columns = calibration.c
    if not row_added["certificate_number"]:
        return
    query_of_number = (
        sa.select(columns.id, columns.data_files, *schema.sensor.c)
        .join(schema.sensor, columns.sensor_id == schema.sensor.c.id)
        .where(columns.certificate_number == row_added["certificate_number"])
        .where(columns.laboratory == row_added["laboratory"])
    )
    files = set(json.loads(row_added["data_files"]))
    for row in connection.execute(query_of_number).mappings():
        same_device = all(row[key] == rows.sensor[key] for key in SENSOR_KEYS if key != "axis")
        other_axis = same_device and row["axis"] != rows.sensor["axis"]
        if other_axis or files & set(json.loads(row["data_files"])):
            continue
        raise InputError(
            "Another calibration has this certificate number.",
            expected="a number of its own for each certificate",
            found=(
                f"{row_added['certificate_number']}, as calibration {row[columns.id]} of sensor "
                f"{row['serial_number']}"
            ),
            where=store.printed,
            remedy="correct [certificate] number in the calibration file and identify again",
        )


def _redate(
    connection: sa.Connection, sensor_id: int, number: int, date: datetime.date
) -> datetime.date | None:
    """Correct the date of a calibration by an event; return the former date.

    None if it is the same.
    """
    query_of_date = sa.select(query.corrected_date()).where(calibration.c.id == number)
    former = connection.execute(query_of_date).scalar_one()
    if former == date:
        return None
    note = f"the date was {former}"
    record(
        connection,
        {
            "sensor_id": sensor_id,
            "calibration_id": number,
            "kind": schema.REDATED,
            "date": date,
            "note": note,
        },
    )
    return former


def _sensor_id(store: Store, connection: sa.Connection, identity: NamedTexts) -> int:
    selection = sa.select(schema.sensor.c.id).where(
        sa.and_(*(schema.sensor.c[key] == value for key, value in identity.items()))
    )
    sensor_id = connection.execute(selection).scalar_one_or_none()
    if sensor_id is not None:
        return sensor_id
    new = (
        store.insert(schema.sensor)
        .values(identity)
        .on_conflict_do_nothing()
        .returning(schema.sensor.c.id)
    )
    sensor_id = connection.execute(new).scalar_one_or_none()
    return connection.execute(selection).scalar_one() if sensor_id is None else sensor_id


def record(connection: sa.Connection, event: GivenFields) -> None:
    """Add an event with the time and user of its entry; the date is today's unless given."""
    now = datetime.datetime.now(datetime.UTC)
    row = {
        "date": now.date(),
        "recorded": now.isoformat(timespec="seconds"),
        "by": user(),
        "note": "",
    }
    connection.execute(
        sa.insert(schema.event), [row | {k: v for k, v in event.items() if v is not None}]
    )


def user() -> str:
    """Return the name of the account that runs the program; empty if the system gives none."""
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):
        return ""


def add_event(
    store: Store,
    sensor: StoredSensor,
    kind: str,
    *,
    date: datetime.date | None = None,
    calibration_id: int | None = None,
    by: str | None = None,
    note: str = "",
) -> None:
    """Record what happened to a sensor, or to one of its calibrations.

    ``kind``: ``repaired``, ``recalled``; of a calibration also ``superseded``, and ``redated``: its
    date is ``date``.

    Raises:
        InputError: the calibration is not one of this sensor, or the kind needs one, or a date.
    """
    if kind == schema.REDATED and date is None:
        raise InputError(
            "It is not said which date the calibration has.",
            expected="a date such as 2025-03-31",
            found="none",
            where="⟦history.date⟧",
            remedy="give the date of the calibration",
        )
    if kind in ("superseded", schema.REDATED) and calibration_id is None:
        raise InputError(
            f"It is not said which calibration is {kind}.",
            expected="the number of a calibration",
            found="none",
            where="⟦history.calibration_id⟧",
            remedy="⟦command = history show SERIAL⟧ lists the numbers",
        )
    with store.writing() as connection:
        if calibration_id is not None:
            query.require_calibration_of(connection, store, calibration_id, sensor)
        values = {
            "sensor_id": sensor.id,
            "calibration_id": calibration_id,
            "kind": kind,
            "date": date,
        }
        record(connection, values | {"by": by, "note": note})
