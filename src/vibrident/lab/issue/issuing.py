"""A reviewed draft becomes a certificate: numbered, signed, and locked in the store.

The number is drawn in one transaction and belongs to its draft from then on. What is signed is
stored in a second one. A process that ends between the two leaves a number without a certificate;
issuing the same draft again completes it under that number, so that none is lost or given twice.
"""

from __future__ import annotations

import datetime
import json
from typing import Any

import sqlalchemy as sa

from vibrident.base.errors import InputError
from vibrident.lab.history.approval import approve_within
from vibrident.lab.history.schema import calibration, certificate, certificate_number, draft
from vibrident.lab.history.store import Store
from vibrident.lab.issue.documents import Documents, signed_documents
from vibrident.lab.issue.drafts import (
    REVIEWED,
    Draft,
    check_complete,
    completed,
    content,
    read_draft,
    stamp,
)
from vibrident.lab.issue.keys import SigningKey
from vibrident.result import Result

#: Number of PostgreSQL's advisory lock for drawing a number.
_NUMBER_LOCK = 8_247_163_906


def issue_draft(
    store: Store, draft_id: int, key: SigningKey, *, by: str | None = None
) -> tuple[Draft, Documents]:
    """Issue a reviewed draft; one that is issued already is returned as it is.

    Args:
        store: that holds the draft.
        draft_id: of the draft.
        key: of the laboratory.
        by: who issues; None for the account that runs the program.

    Raises:
        InputError: the draft is not reviewed, its data have a certificate that it does not
            replace, or a document cannot be made.
    """
    stored = issued_documents(store, draft_id)
    if stored is not None:
        return stored
    draft_content = content(store, draft_id)
    check_complete(draft_content.result)
    numbered = _numbered(store, draft_id, draft_content.result, by)
    assert numbered.date is not None
    result = completed(draft_content.result, numbered.number, numbered.date, numbered.reviewer)
    documents = signed_documents(draft_content, result, key)
    with store.writing() as connection:
        values = {"draft_id": draft_id, **vars(documents)}
        row = (
            store.insert(certificate)
            .values(values | stamp(by))
            .on_conflict_do_nothing()
            .returning(certificate.c.draft_id)
        )
        if connection.execute(row).scalar_one_or_none() is not None:
            note = f"certificate {numbered.number}"
            approve_within(
                connection, store, numbered.calibration_id, by=numbered.reviewer, note=note
            )
    stored = issued_documents(store, draft_id)  # of another issuer, where that was faster
    assert stored is not None
    return stored


def issued_documents(store: Store, draft_id: int) -> tuple[Draft, Documents] | None:
    """Return an issued draft with its documents as they were signed; None if it is not issued.

    Raises:
        InputError: there is no such draft.
    """
    columns = certificate.c
    document_columns = columns.pdf, columns.dcc, columns.result, columns.result_signature
    with store.reading() as connection:
        issued_draft = read_draft(connection, store, draft_id)
        row = connection.execute(
            sa.select(*document_columns).where(columns.draft_id == draft_id)
        ).one_or_none()
    return None if row is None else (issued_draft, Documents(*row))


def _numbered(store: Store, draft_id: int, result: Result, by: str | None) -> Draft:
    """Return a draft with its number, drawn in this transaction if it had none."""
    replaces = str(result.certificate.get("replaces") or "") or None
    with store.writing() as connection:
        if connection.dialect.name == "postgresql":  # SQLite lets one write at a time
            lock = sa.text("SELECT pg_advisory_xact_lock(:key)")
            connection.execute(lock, {"key": _NUMBER_LOCK})
        stored = read_draft(connection, store, draft_id)
        if stored.number:
            return stored
        _require_review(store, stored)
        _check_replaces(connection, store, stored, replaces)
        today = datetime.datetime.now(datetime.UTC).date()
        sequence = _next_sequence(connection, today.year)
        values = {
            "draft_id": draft_id,
            "year": today.year,
            "sequence": sequence,
            "number": f"{today.year}-{sequence:04d}",
            "date": today,
            "replaces": replaces,
        }
        connection.execute(sa.insert(certificate_number).values(values | stamp(by)))
        return read_draft(connection, store, draft_id)


def _next_sequence(connection: sa.Connection, year: int) -> int:
    """Return the next number of a year that no calibration in the store states already."""
    columns = certificate_number.c
    newest = sa.select(sa.func.max(columns.sequence)).where(columns.year == year)
    sequence = (connection.execute(newest).scalar_one() or 0) + 1
    selection = sa.select(calibration.c.certificate_number).where(
        calibration.c.certificate_number.startswith(f"{year}-")
    )
    numbers = set(connection.execute(selection).scalars())
    while f"{year}-{sequence:04d}" in numbers:
        sequence += 1
    return sequence


def _require_review(store: Store, pending: Draft) -> None:
    if pending.state == REVIEWED:
        return
    raise InputError(
        "Only a reviewed draft can be issued.",
        expected="a review that accepts it, by an account other than its author's",
        found=f"returned by {pending.reviewer}: {pending.note}"
        if pending.reviewer
        else "no review",
        where=f"draft {pending.id}, {store.printed}",
        remedy="correct it and hand it in again"
        if pending.reviewer
        else "have another account review it: ⟦command = issue review⟧",
    )


def _check_replaces(
    connection: sa.Connection, store: Store, pending: Draft, replaces: str | None
) -> None:
    """Refuse a second certificate of the same data, and an amendment of another sensor's.

    Raises:
        InputError: the data have a valid certificate that this draft does not replace, or the one
            that it names is of another sensor or was replaced before.
    """
    columns = calibration.c
    selection = sa.select(columns.sensor_id).where(columns.id == pending.calibration_id)
    sensor_id = connection.execute(selection).scalar_one()
    valid = list[str]()
    data = _data(connection, pending.calibration_id)
    for row in connection.execute(_certificates(sensor_id, replaces)):
        if row.number == replaces and row.sensor_id != sensor_id:
            raise _wrong_amendment(store, row.number, "a certificate of another sensor")
        if row.number == replaces and row.replaced:
            raise _wrong_amendment(store, row.number, f"one that {row.replaced} replaced")
        same_data = row.id == pending.calibration_id or data & set(json.loads(row.data_files))
        if same_data and not row.replaced:
            valid.append(row.number)
    unnamed = [number for number in valid if number != replaces]
    if unnamed:
        raise InputError(
            "These data have a certificate already.",
            expected=f'an amendment, with [certificate] replaces = "{unnamed[0]}" and its changes',
            found=f"replaces = {replaces!r}" if replaces else "a first certificate",
            where=f"draft {pending.id}, {store.printed}",
            remedy="hand in a draft that states which certificate it replaces, and why",
        )


def _data(connection: sa.Connection, calibration_id: int) -> set[str]:
    """Return what the data files of a calibration are known by."""
    selection = sa.select(calibration.c.data_files).where(calibration.c.id == calibration_id)
    return set(json.loads(connection.execute(selection).scalar_one()))


def _certificates(sensor_id: int, number: str | None) -> Any:
    """Return the query of all certificates of a sensor and the one of a number.

    Each row has its calibration, that one's sensor and data, and the number that replaced it.
    """
    columns = certificate_number.c
    later = certificate_number.alias("later")
    facts = calibration.c.id, calibration.c.sensor_id, calibration.c.data_files
    return (
        sa.select(columns.number, *facts, later.c.number.label("replaced"))
        .join(draft, draft.c.id == columns.draft_id)
        .join(calibration, calibration.c.id == draft.c.calibration_id)
        .outerjoin(later, later.c.replaces == columns.number)
        .where(sa.or_(calibration.c.sensor_id == sensor_id, columns.number == number))
    )


def _wrong_amendment(store: Store, number: str, amended: str) -> InputError:
    return InputError(
        "The draft cannot replace this certificate.",
        expected="the valid certificate of the same sensor",
        found=amended,
        where=f'[certificate] replaces = "{number}", {store.printed}',
        remedy="correct [certificate] replaces, and hand it in again",
    )
