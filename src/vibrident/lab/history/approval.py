"""Approval: which evaluation of a calibration's data counts."""

from __future__ import annotations

import json

import sqlalchemy as sa

from vibrident.base.errors import InputError
from vibrident.lab.history import query
from vibrident.lab.history.entry import record
from vibrident.lab.history.schema import calibration, event
from vibrident.lab.history.store import Store
from vibrident.result import TRACKED


def approve(
    store: Store, calibration_id: int, *, by: str | None = None, note: str = ""
) -> list[int]:
    """Approve a calibration; return the numbers of others of the same data, now superseded.

    ``by``: who approves; None for whom the certificate states, else the account.

    Raises:
        InputError: there is no such calibration, it is a tracked result, or it was recalled.
    """
    with store.writing() as connection:
        return approve_within(connection, store, calibration_id, by=by, note=note)


def approve_within(
    connection: sa.Connection, store: Store, calibration_id: int, *, by: str | None, note: str
) -> list[int]:
    """Approve a calibration as :func:`approve` does, within its caller's transaction."""
    columns = calibration.c
    selected = columns.sensor_id, columns.data_files, columns.estimator, columns.document
    selection = sa.select(*selected).where(columns.id == calibration_id)
    row = connection.execute(selection).one_or_none()
    if row is None:
        raise query.no_calibration(store, calibration_id)
    if row.estimator == TRACKED:
        raise InputError(
            "A tracked result is no calibration, and cannot be approved as one.",
            expected="the number of a calibration",
            found=f"{calibration_id}, which a sensor's tracking wrote",
            where=store.printed,
            remedy="approve the calibration that it began with",
        )
    newest = (
        sa.select(event.c.kind)
        .where(event.c.calibration_id == calibration_id)
        .order_by(event.c.id.desc())
    )
    if connection.execute(newest.limit(1)).scalar_one_or_none() == "recalled":
        raise InputError(
            "This calibration was recalled.",
            expected="a calibration that counts",
            found=f"calibration {calibration_id}, recalled",
            where=store.printed,
            remedy="calibrate again, and add the new result",
        )
    if by is None:
        by = query.unpacked(row.document).certificate.get("approved_by")
    files = set(json.loads(row.data_files))
    rivals = connection.execute(
        sa.select(columns.id, columns.data_files).where(
            columns.sensor_id == row.sensor_id, columns.id != calibration_id
        )
    ).all()
    same = [rival.id for rival in rivals if files & set(json.loads(rival.data_files))]
    common = {"sensor_id": row.sensor_id, "by": by}
    for number in same:
        why = f"calibration {calibration_id} of the same data was approved"
        record(connection, common | {"calibration_id": number, "kind": "superseded", "note": why})
    record(
        connection, common | {"calibration_id": calibration_id, "kind": "approved", "note": note}
    )
    return same
