"""The rows that the store keeps of a result, and how results are added: each whole or not at all, and only once."""

from __future__ import annotations

import datetime
import getpass
import hashlib
import itertools
import json
import math
import zlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import sqlalchemy as sa

from vibrident.base.errors import InputError
from vibrident.lab.history import query, schema
from vibrident.lab.history.query import StoredSensor
from vibrident.lab.history.schema import calibration
from vibrident.lab.history.store import Store
from vibrident.result import Result
from vibrident.result.document import plain
from vibrident.show.history import date_of
from vibrident.show.numbers import unit_of_sensitivity
from vibrident.show.points import nominal_points, reference_point
from vibrident.use.comparison import shared_sources

_AT_ONCE = 20  # results in one transaction: few, so that other writers wait for milliseconds only
_FILE_DIGITS = (
    20  # digits kept of the SHA-256 of a data file: enough to recognise results of the same data
)
_SENSOR_KEYS = ("manufacturer", "type", "serial_number", "axis")

DatabaseRow = dict[str, Any]


@dataclass(frozen=True)
class ResultRows:
    """A result as rows by table, without the keys that the database gives."""

    sensor: DatabaseRow
    calibration: DatabaseRow
    parameters: list[DatabaseRow]
    points: list[DatabaseRow]


def rows_of(
    result: Result, serial_number: str | None = None, date: datetime.date | None = None
) -> ResultRows:
    """The rows of a result.

    ``result``: the result; ``serial_number``: if the result states no serial number; ``date``: of
    the calibration, if the result states no date.

    Raises:
        InputError: the serial number or the date is in neither the result nor the arguments.
    """
    sensor = {key: str(result.sensor.get(key) or "").strip() for key in _SENSOR_KEYS}
    sensor["serial_number"] = _serial_number(sensor["serial_number"], serial_number)
    stated = result.certificate.get("date_of_calibration")
    when = date_of(result)
    if stated is not None and when is not None and date not in (None, when):
        raise InputError(
            "The date is not that of the result.",
            expected=f"{when}, as its certificate states",
            found=str(date),
            where="⟦history.date⟧",
            remedy=(
                "leave it out, or correct date_of_calibration in the calibration file and "
                "identify again"
            ),
        )
    when = when if date is None else date
    if when is None:
        key = '[certificate] date_of_calibration = "2025-03-31"'
        raise _missing(
            "date of its calibration",
            key,
            "⟦history.date⟧",
            "none" if stated is None else repr(stated),
        )
    calibration = {
        "sha256": identity(result),
        "date": when,
        "date_stated": stated is not None or date is not None,
        "model": result.model,
        "estimator": result.estimator,
        "adequate": result.fit.adequate,
        "chi2_reduced": plain(result.fit.chi2_reduced),
        "warnings": json.dumps(result.warning_codes),
        "laboratory": str(result.certificate.get("laboratory") or ""),
        "certificate_number": str(result.certificate.get("number") or ""),
        "data_files": json.dumps(_data_files(result)),
        "document": zlib.compress(result.to_json().encode()),
    }
    return ResultRows(sensor, calibration, _parameters(result), _points(result))


def identity(result: Result) -> str:
    """Return the SHA-256 of what a result says; neither its layout nor its excerpts are part of it."""
    document = {name: value for name, value in result.to_dict().items() if name != "signals"}
    text = json.dumps(document, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def _serial_number(stated: str, given: str | None) -> str:
    given = (given or "").strip()
    if given and stated and given != stated:
        raise InputError(
            "The serial number is not that of the result.",
            expected=f"{stated}, as the result states",
            found=given,
            where="⟦history.serial_number⟧",
            remedy="leave the option away, or give the result of that sensor",
        )
    if not (stated or given):
        raise _missing(
            "serial number", '[sensor] serial_number = "4711"', "⟦history.serial_number⟧"
        )
    return stated or given


def _missing(what: str, key: str, option: str, found: str = "none") -> InputError:
    return InputError(
        f"The result does not state the {what}, so it cannot be added to a history.",
        expected=key.split(" ", 1)[1].partition(" =")[0],
        found=found,
        where="result.json, sensor and certificate",
        remedy=f"state {key} in the calibration file, or give {option}",
    )


def _data_files(result: Result) -> list[str]:
    hashes = (str(entry.get("sha256") or "") for entry in result.provenance.get("files") or ())
    return sorted({text[:_FILE_DIGITS] for text in hashes if text})


def _parameters(result: Result) -> list[DatabaseRow]:
    """The magnitude of the sensitivity at the reference frequency, if it is known, and the parameters."""

    def row(
        name: str,
        value: float,
        u: float | None,
        unit: str,
        shared: Mapping[str, float],
        **more: Any,
    ) -> DatabaseRow:
        numbers = {"value": plain(value), "standard_uncertainty": plain(u)}
        return {
            "name": name,
            **numbers,
            "unit": unit,
            "frequency_hz": None,
            "shared": json.dumps(shared),
            **more,
        }

    rows = []
    at = None if result.is_tracked else reference_point(result)[0]
    if at is not None and math.isfinite(at.magnitude):
        shared = shared_sources(result, sensitivity=(at.frequency_hz, at.magnitude))
        unit = unit_of_sensitivity(result)
        more = {"identifiable": True, "derived": True}
        known = at.magnitude, at.magnitude_uncertainty, unit, shared
        rows.append(row(schema.REFERENCE_SENSITIVITY, *known, **more, frequency_hz=at.frequency_hz))
    for name, one in result.parameters.items():
        shared = shared_sources(result, parameter=name)
        more = {"identifiable": one.identifiable, "derived": one.derived}
        rows.append(row(name, one.value, one.standard_uncertainty, one.unit, shared, **more))
    return rows


def _points(result: Result) -> list[DatabaseRow]:
    """Return the nominal points of a calibration; a tracked result is none."""
    points = () if result.is_tracked else nominal_points(result)
    return [
        {
            "nominal_hz": float(point.nominal),
            "frequency_hz": point.frequency_hz,
            "magnitude": point.magnitude,
            "magnitude_uncertainty": plain(point.magnitude_uncertainty),
            "phase_deg": plain(point.phase_deg),
            "phase_deg_uncertainty": plain(point.phase_deg_uncertainty),
        }
        for point in points
        if math.isfinite(point.magnitude)
    ]


class Added(NamedTuple):
    """What came of adding a result."""

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
    """Add results, and yield what came of each.

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
    same = _stored(connection, sensor_id, rows.calibration)
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
    for table, found in ((schema.parameter, rows.parameters), (schema.point, rows.points)):
        if found:
            connection.execute(sa.insert(table), [row | {"calibration_id": key} for row in found])
    record(connection, {"sensor_id": sensor_id, "calibration_id": key, "kind": "added"})
    return Added(True, key)


def _stored(connection: sa.Connection, sensor_id: int, row: DatabaseRow) -> int | None:
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
    known = rows.calibration
    columns = calibration.c
    if not known["certificate_number"]:
        return
    asked = (
        sa.select(columns.id, columns.data_files, *schema.sensor.c)
        .join(schema.sensor, columns.sensor_id == schema.sensor.c.id)
        .where(columns.certificate_number == known["certificate_number"])
        .where(columns.laboratory == known["laboratory"])
    )
    files = set(json.loads(known["data_files"]))
    for row in connection.execute(asked).mappings():
        same_device = all(row[key] == rows.sensor[key] for key in _SENSOR_KEYS if key != "axis")
        other_axis = same_device and row["axis"] != rows.sensor["axis"]
        if other_axis or files & set(json.loads(row["data_files"])):
            continue
        raise InputError(
            "Another calibration has this certificate number.",
            expected="a number of its own for each certificate",
            found=(
                f"{known['certificate_number']}, as calibration {row[columns.id]} of sensor "
                f"{row['serial_number']}"
            ),
            where=store.shown,
            remedy="correct [certificate] number in the calibration file and identify again",
        )


def _redate(
    connection: sa.Connection, sensor_id: int, number: int, date: datetime.date
) -> datetime.date | None:
    """Correct the date of a calibration by an event; return the former one, None if it is the same."""
    asked = sa.select(query.corrected_date()).where(calibration.c.id == number)
    former = connection.execute(asked).scalar_one()
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


def _sensor_id(store: Store, connection: sa.Connection, identity: Mapping[str, str]) -> int:
    wanted = sa.select(schema.sensor.c.id).where(
        sa.and_(*(schema.sensor.c[key] == value for key, value in identity.items()))
    )
    found = connection.execute(wanted).scalar_one_or_none()
    if found is not None:
        return found
    new = (
        store.insert(schema.sensor)
        .values(identity)
        .on_conflict_do_nothing()
        .returning(schema.sensor.c.id)
    )
    found = connection.execute(new).scalar_one_or_none()
    return connection.execute(wanted).scalar_one() if found is None else found


def record(connection: sa.Connection, event: Mapping[str, Any]) -> None:
    """Add an event with the time and user of its entry; the date is today's unless given."""
    now = datetime.datetime.now(datetime.UTC)
    known = {
        "date": now.date(),
        "recorded": now.isoformat(timespec="seconds"),
        "by": user(),
        "note": "",
    }
    connection.execute(
        sa.insert(schema.event), [known | {k: v for k, v in event.items() if v is not None}]
    )


def user() -> str:
    """Name of the account that runs the program; empty if the system gives no name."""
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
            asked = sa.select(calibration.c.id).where(
                calibration.c.id == calibration_id, calibration.c.sensor_id == sensor.id
            )
            if connection.execute(asked).scalar_one_or_none() is None:
                raise query.no_calibration(store, calibration_id)
        told = {
            "sensor_id": sensor.id,
            "calibration_id": calibration_id,
            "kind": kind,
            "date": date,
        }
        record(connection, told | {"by": by, "note": note})
