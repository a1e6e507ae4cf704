"""What users enter by hand: events of a sensor, and the approval of a calibration."""

from __future__ import annotations

import datetime
import json

import sqlalchemy as sa

from vibrident.errors import InputError
from vibrident.history import query
from vibrident.history.entry import record
from vibrident.history.query import StoredSensor
from vibrident.history.schema import calibration, event
from vibrident.history.store import Store


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
    """Record that a sensor was repaired or recalled, or one of its calibrations recalled or superseded.

    Raises:
        InputError: the calibration is not one of this sensor, or the kind needs one.
    """
    if kind == "superseded" and calibration_id is None:
        raise InputError(
            "It is not said which calibration is superseded.",
            expected="the number of a calibration",
            found="none",
            where="--calibration",
            remedy="vibrident history show SERIAL lists the numbers",
        )
    with store.writing() as connection:
        if calibration_id is not None:
            asked = sa.select(calibration.c.id).where(
                calibration.c.id == calibration_id, calibration.c.sensor_id == sensor.id
            )
            if connection.execute(asked).scalar_one_or_none() is None:
                raise query.no_calibration(store, calibration_id)
        told = {"sensor_id": sensor.id, "calibration_id": calibration_id, "kind": kind, "date": date}
        record(connection, told | {"by": by, "note": note})


def approve(store: Store, calibration_id: int, *, by: str | None = None, note: str = "") -> list[int]:
    """Approve a calibration; other evaluations of the same data are superseded, and their numbers returned.

    Raises:
        InputError: there is no such calibration, or it was recalled.
    """
    with store.writing() as connection:
        columns = calibration.c
        asked = sa.select(columns.sensor_id, columns.data_files).where(columns.id == calibration_id)
        row = connection.execute(asked).one_or_none()
        if row is None:
            raise query.no_calibration(store, calibration_id)
        newest = sa.select(event.c.kind).where(event.c.calibration_id == calibration_id).order_by(event.c.id.desc())
        if connection.execute(newest.limit(1)).scalar_one_or_none() == "recalled":
            raise InputError(
                "This calibration was recalled.",
                expected="a calibration that counts",
                found=f"calibration {calibration_id}, recalled",
                where=store.shown,
                remedy="calibrate again, and add the new result",
            )
        files = set(json.loads(row.data_files))
        others = connection.execute(
            sa.select(columns.id, columns.data_files).where(
                columns.sensor_id == row.sensor_id, columns.id != calibration_id
            )
        ).all()
        same = [other.id for other in others if files & set(json.loads(other.data_files))]
        common = {"sensor_id": row.sensor_id, "by": by}
        for other in same:
            why = f"calibration {calibration_id} of the same data was approved"
            record(connection, common | {"calibration_id": other, "kind": "superseded", "note": why})
        record(connection, common | {"calibration_id": calibration_id, "kind": "approved", "note": note})
    return same
