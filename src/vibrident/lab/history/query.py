"""Queries of the store: sensors, calibrations, events and results; and all as a table."""

from __future__ import annotations

import datetime
import json
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import sqlalchemy as sa

from vibrident.base.errors import InputError, did_you_mean
from vibrident.base.fields import Fields, NamedNumbers
from vibrident.base.nominal import SAME
from vibrident.lab.history.life import Entry, Event
from vibrident.lab.history.schema import (
    REDATED,
    REFERENCE_SENSITIVITY,
    calibration,
    certificate_number,
    draft,
    event,
    parameter,
    point,
    sensor,
)
from vibrident.lab.history.store import Store
from vibrident.result import Result
from vibrident.show.numbers import sensor_name

_STANDINGS = ("approved", "superseded", "recalled")


@dataclass(frozen=True)
class StoredSensor:
    """Sensor, as its results name it."""

    id: int
    manufacturer: str
    type: str
    serial_number: str
    axis: str

    @property
    def name(self) -> str:
        """Return manufacturer, type, serial number and axis in one line."""
        name = sensor_name(vars(self))
        return f"{name}, axis {self.axis}" if self.axis else name

    def as_dict(self) -> dict[str, str]:
        """Return the sensor as a result states it."""
        return {key: text for key, text in vars(self).items() if text and key != "id"}


class Overview(NamedTuple):
    """Sensor in the list of all: number of its calibrations, and the first and last date."""

    sensor: StoredSensor
    calibrations: int
    first: datetime.date
    last: datetime.date


def overviews(store: Store, type_name: str | None = None) -> list[Overview]:
    """Return all sensors, by type and serial number."""
    columns = sensor.c
    date = corrected_date()
    query = (
        sa.select(*columns, sa.func.count(), sa.func.min(date), sa.func.max(date))
        .join(calibration, calibration.c.sensor_id == columns.id)
        .group_by(*columns)
        .order_by(columns.type, columns.serial_number, columns.manufacturer, columns.axis)
    )
    if type_name is not None:
        query = query.where(columns.type == type_name)
    with store.reading() as connection:
        return [
            Overview(StoredSensor(*identity), times, first, last)
            for *identity, times, first, last in map(tuple, connection.execute(query))
        ]


def find(
    store: Store,
    serial_number: str,
    type_name: str | None = None,
    axis: str | None = None,
    manufacturer: str | None = None,
) -> StoredSensor:
    """Return the sensor of a serial number; of several by type, axis and manufacturer.

    Raises:
        InputError: no sensor has this serial number, or more than one has it.
    """
    query = sa.select(sensor).where(sensor.c.serial_number == serial_number.strip())
    named = (
        (sensor.c.type, type_name),
        (sensor.c.axis, axis),
        (sensor.c.manufacturer, manufacturer),
    )
    for column, value in named:
        query = query if value is None else query.where(column == value)
    with store.reading() as connection:
        sensors = [StoredSensor(*row) for row in connection.execute(query)]
        if len(sensors) == 1:
            return sensors[0]
        serial_numbers = (
            [] if sensors else connection.execute(sa.select(sensor.c.serial_number)).scalars().all()
        )
    if sensors:
        raise InputError(
            f"{len(sensors)} sensors have this serial number.",
            expected="one of " + "; ".join(candidate.name for candidate in sensors),
            found=serial_number,
            where=store.printed,
            remedy="give ⟦history.type_name⟧, ⟦history.axis⟧ or ⟦history.manufacturer⟧ as well",
        )
    raise InputError(
        "The store holds no such sensor.",
        expected=f"one of its {len(serial_numbers)} serial numbers",
        found=serial_number,
        where=store.printed,
        remedy=did_you_mean(serial_number, serial_numbers, "see ⟦command = history list⟧"),
    )


def stored_sensor(store: Store, identity: Mapping[str, object]) -> StoredSensor | None:
    """Return the sensor that a result states; None if no store holds a calibration of it."""
    if store.revision() is None:
        return None
    named = [
        column == str(identity.get(column.name) or "").strip()
        for column in sensor.c
        if column.name != "id"
    ]
    with store.reading() as connection:
        row = connection.execute(sa.select(sensor).where(*named)).one_or_none()
    return None if row is None else StoredSensor(*row)


def entries(
    store: Store,
    sensor_id: int | None = None,
    quantity: str = REFERENCE_SENSITIVITY,
    frequency_hz: float | None = None,
) -> dict[int, list[Entry]]:
    """Return the calibrations of a sensor with all columns, or of all sensors with few, by sensor.

    Args:
        store: the store.
        sensor_id: of the sensor; None: all.
        quantity: name of the parameter whose value and uncertainty the entries hold.
        frequency_hz: nominal frequency, for the magnitude of the sensitivity there instead.
    """
    query = _query(quantity, frequency_hz, with_facts=sensor_id is not None)
    query = query if sensor_id is None else query.where(calibration.c.sensor_id == sensor_id)
    standings = _standings(store, sensor_id)
    entries_of: dict[int, list[Entry]] = {}
    with store.reading() as connection:
        for row in map(tuple, connection.execute(query).all()):
            sensor_key, key, date, files, value, u, unit, frequency, shared, base, *fact_values = (
                row
            )
            facts: dict[str, object] = (
                dict(zip(_FACT_COLUMNS, fact_values, strict=True)) if fact_values else {}
            )
            if fact_values:
                facts["warnings"] = json.loads(fact_values[-1])
            sources = _shared(shared or "{}")
            if base != value and base and value is not None:  # relative contributions are equal
                sources = {name: abs(size * value / base) for name, size in sources.items()}
            standing = standings.get(key, "")
            entry = Entry(
                key, date, value, u, unit or "", frequency, sources, files, standing, facts
            )
            entries_of.setdefault(sensor_key, []).append(entry)
    return entries_of


def corrected_date() -> Any:
    """Return a query's column of the date of a calibration.

    It is that of the newest event that corrects it.
    """
    return sa.func.coalesce(_correction(), calibration.c.date, type_=sa.Date())


def _correction() -> Any:
    """Return the date in the newest event that corrects that of a calibration; null without one."""
    corrects = sa.and_(event.c.calibration_id == calibration.c.id, event.c.kind == REDATED)
    newest = sa.select(event.c.date).where(corrects).order_by(event.c.id.desc()).limit(1)
    return newest.correlate(calibration).scalar_subquery()


def _drawn_number() -> Any:
    """Return the number that a draft of a calibration was given; null without one."""
    numbers = sa.select(certificate_number.c.number).join(
        draft, draft.c.id == certificate_number.c.draft_id
    )
    newest = (
        numbers.where(draft.c.calibration_id == calibration.c.id)
        .order_by(draft.c.id.desc())
        .limit(1)
    )
    return newest.correlate(calibration).scalar_subquery()


def _facts(names: Sequence[str]) -> list[Any]:
    """Return columns of a calibration; a corrected date is a stated one, a drawn number its own."""
    c = calibration.c
    corrected = {"date": corrected_date().label("date")}
    number = sa.func.coalesce(_drawn_number(), c.certificate_number)
    corrected["certificate_number"] = number.label("certificate_number")
    corrected["date_stated"] = sa.or_(c.date_stated, _correction().is_not(None)).label(
        "date_stated"
    )
    return [corrected.get(name, c[name]) for name in names]


def _query(quantity: str, frequency_hz: float | None, *, with_facts: bool) -> Any:
    """Return a query of each calibration: value, uncertainty, sources, and the sources' value."""
    c = calibration.c
    p = parameter.c
    at = point.c
    joined = calibration.outerjoin(parameter, sa.and_(p.calibration_id == c.id, p.name == quantity))
    values = [p.value, p.standard_uncertainty, p.unit, p.frequency_hz]
    if frequency_hz is not None:
        near = at.nominal_hz.between(frequency_hz * (1 - SAME), frequency_hz * (1 + SAME))
        joined = joined.outerjoin(point, sa.and_(at.calibration_id == c.id, near))
        values = [at.magnitude, at.magnitude_uncertainty, p.unit, at.frequency_hz]
    more = _facts(_FACT_COLUMNS) if with_facts else []
    selected = [
        c.sensor_id,
        c.id,
        *_facts(["date", "data_files"]),
        *values,
        p.shared,
        p.value.label("base"),
        *more,
    ]
    return sa.select(*selected).select_from(joined)


_FACT_COLUMNS = (
    "sha256",
    "date_stated",
    "model",
    "estimator",
    "adequate",
    "laboratory",
    "certificate_number",
    "warnings",
)


@lru_cache(maxsize=10_000)
def _shared(text: str) -> NamedNumbers:
    return json.loads(text)


def _standings(store: Store, sensor_id: int | None) -> dict[int, str]:
    """Return the newest event that decides whether a calibration is valid, by calibration."""
    query = sa.select(event.c.calibration_id, event.c.kind).where(
        event.c.kind.in_(_STANDINGS), event.c.calibration_id.is_not(None)
    )
    query = query if sensor_id is None else query.where(event.c.sensor_id == sensor_id)
    with store.reading() as connection:
        return {
            row.calibration_id: row.kind for row in connection.execute(query.order_by(event.c.id))
        }


def events(store: Store, sensor_id: int | None = None) -> dict[int, list[Event]]:
    """Return the events of a sensor, or of all, by sensor."""
    query = sa.select(event).order_by(event.c.date, event.c.id)
    if sensor_id is None:
        # as many as calibrations, and nothing follows from them
        query = query.where(event.c.kind != "added")
    else:
        query = query.where(event.c.sensor_id == sensor_id)
    events_of: dict[int, list[Event]] = {}
    with store.reading() as connection:
        for row in connection.execute(query).mappings():
            columns = dict(row)
            events_of.setdefault(columns.pop("sensor_id"), []).append(Event(**columns))
    return events_of


def known_values(store: Store, sensor_id: int, column: Any) -> list[Any]:
    """Return the values of a sensor's calibrations in a column, sorted.

    ``column``: of ``parameter`` or ``point``.
    """
    query = (
        sa.select(column).join(calibration).where(calibration.c.sensor_id == sensor_id).distinct()
    )
    with store.reading() as connection:
        return sorted(connection.execute(query).scalars())


def result(store: Store, calibration_id: int) -> Result:
    """Return a stored result.

    Raises:
        InputError: no calibration has this number.
    """
    query = sa.select(calibration.c.document).where(calibration.c.id == calibration_id)
    with store.reading() as connection:
        packed = connection.execute(query).scalar_one_or_none()
    if packed is None:
        raise no_calibration(store, calibration_id)
    return unpacked(packed)


def unpacked(document: bytes) -> Result:
    """Return the result that a row of the store holds."""
    return Result.from_dict(json.loads(zlib.decompress(document)))


def no_calibration(store: Store, calibration_id: int) -> InputError:
    """Return the error for a number without a calibration."""
    return InputError(
        "The store holds no such calibration.",
        expected="the number of a calibration",
        found=str(calibration_id),
        where=store.printed,
        remedy="⟦command = history show SERIAL⟧ lists the numbers",
    )


def require_calibration_of(
    connection: sa.Connection, store: Store, calibration_id: int, owner: StoredSensor
) -> None:
    """Refuse a calibration that is not one of the sensor, or of none.

    Raises:
        InputError: names the sensor that it is of.
    """
    query = (
        sa.select(sensor)
        .join(calibration, calibration.c.sensor_id == sensor.c.id)
        .where(calibration.c.id == calibration_id)
    )
    row = connection.execute(query).one_or_none()
    if row is None:
        raise no_calibration(store, calibration_id)
    calibrated = StoredSensor(*row)
    if calibrated.id != owner.id:
        raise InputError(
            f"Calibration {calibration_id} is one of another sensor.",
            expected=f"a calibration of {owner.name}",
            found=f"one of {calibrated.name}",
            where=store.printed,
            remedy=(
                f"give the serial number {calibrated.serial_number}, or another calibration: "
                "⟦command = history show SERIAL⟧ lists the numbers"
            ),
        )


def rows(store: Store) -> Iterator[Fields]:
    """Yield a row a calibration for export.

    It holds sensor, calibration, and parameters as NAME and NAME_u.
    """
    c = calibration.c
    s = sensor.c
    facts = _facts(
        [column.name for column in c if column.name not in ("document", "data_files", "sensor_id")]
    )
    named = [s.manufacturer, s.type, s.serial_number, s.axis]
    standings = _standings(store, None)
    with store.reading() as connection:
        values: dict[int, Fields] = {}
        for row in connection.execute(sa.select(parameter)):
            numbers = values.setdefault(row.calibration_id, {})
            numbers |= {row.name: row.value, f"{row.name}_u": row.standard_uncertainty}
            if row.frequency_hz is not None:
                numbers["reference_frequency_hz"] = row.frequency_hz
        query = (
            sa.select(*named, *facts)
            .join(calibration, c.sensor_id == s.id)
            .order_by(s.serial_number, corrected_date(), c.id)
        )
        for row in connection.execute(query).mappings():
            warnings = {
                "warnings": json.loads(row["warnings"]),
                "standing": standings.get(row["id"], "added"),
            }
            yield dict(row) | warnings | values.get(row["id"], {})
