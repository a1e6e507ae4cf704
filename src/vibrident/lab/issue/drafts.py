"""Drafts of certificates in the store: handed in by one account, reviewed by another.

A draft is a calibration of the store with all that its certificate states but number and date of
issue. Its row cannot change, so what was reviewed is what is issued; another text is another draft.
"""

from __future__ import annotations

import datetime
import json
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from vibrident.base.errors import InputError
from vibrident.data.io.certificate import check_dates
from vibrident.lab.history import query
from vibrident.lab.history.entry import add_all, user
from vibrident.lab.history.schema import (
    calibration,
    certificate,
    certificate_number,
    draft,
    review,
    sensor,
)
from vibrident.lab.history.store import Store
from vibrident.lab.issue.documents import DraftContent, unsigned_documents
from vibrident.result import Result
from vibrident.show.coverage import document_kind
from vibrident.show.issue import Issue, missing
from vibrident.show.numbers import sensor_name

#: Keys of [certificate] that issuing fills in; what a draft states of the first two is not used.
DRAWN = ("number", "date_of_issue")
_FILLED_IN = (*DRAWN, "approved_by")
DRAFTED = "draft"
RETURNED = "returned"
REVIEWED = "reviewed"
ISSUED = "issued"


@dataclass(frozen=True)
class Draft:
    """A draft and how far it has come."""

    id: int
    calibration_id: int
    sensor: str  # manufacturer, type and serial number
    author: str
    recorded: str  # when it was handed in, ISO 8601 in UTC
    state: str  # ``draft``, ``returned``, ``reviewed`` or ``issued``
    reviewer: str  # of the newest review; empty without one
    note: str  # of that review
    number: str  # of the certificate; empty where none is drawn
    date: datetime.date | None  # of issue
    replaces: str  # number of the certificate that it replaces; empty if of none
    issuer: str  # who issued it; empty until then


def hand_in(store: Store, result: Result, issue: Issue, *, by: str | None = None) -> int:
    """Add a result to the store, and a draft of its certificate; return the draft's number.

    Args:
        store: that keeps both.
        result: with all that the certificate states.
        issue: logo, template, fonts, and the result before an adjustment.
        by: who hands it in; None for the account that runs the program.

    Raises:
        InputError: the result is none that is certified, the certificate would lack a statement, or
            a document of it cannot be made.
    """
    check_complete(result)
    certificate = {key: value for key, value in result.certificate.items() if key not in DRAWN}
    template = None if issue.template is None else issue.template.read_bytes()
    draft_content = DraftContent(
        replace(result, certificate=certificate), replace(issue, template=None), template
    )
    unsigned_documents(
        draft_content, completed(draft_content.result, "0", datetime.date.today(), "nobody")
    )
    (added,) = add_all(store, [draft_content.result])
    before = None if issue.before is None else zlib.compress(issue.before.to_json().encode())
    values = {
        "calibration_id": added.number,
        "fonts": json.dumps([str(folder.absolute()) for folder in issue.fonts]),
        "logo": issue.logo,
        "template": template,
        "before": before,
    }
    with store.writing() as connection:
        row = connection.execute(sa.insert(draft).values(values | stamp(by)).returning(draft.c.id))
        return row.scalar_one()


def check_complete(result: Result) -> None:
    """Refuse a result whose certificate could not be issued.

    Raises:
        InputError: it is tracked, its U does not cover the measuring chain, or statements lack.
    """
    if document_kind(result) != "certificate":
        raise InputError(
            "This result cannot be certified.",
            expected="a calibration whose U covers the measuring chain",
            found="values that were tracked" if result.is_tracked else "a U of the scatter alone",
            where="result.json, uncertainty",
            remedy="state the uncertainty of the reference and the chain, and identify again",
        )
    lacking = [key for key in missing(result) if key not in _FILLED_IN]
    lacking += [] if result.certificate.get("country") else ["country"]
    if lacking:
        raise InputError(
            "The draft lacks what its certificate must state.",
            expected=", ".join(lacking),
            found="nothing",
            where="[certificate] and [sensor]",
            remedy="write it into a file and give that with ⟦export.certificate⟧",
        )
    check_dates(result.certificate, "result.json and certificate files")


def completed(result: Result, number: str, date: datetime.date, approver: str) -> Result:
    """Return a draft's result with number, date of issue and, unless stated, who approved it."""
    certificate = result.certificate
    drawn = {"number": number, "date_of_issue": str(date)}
    approved_by = certificate.get("approved_by") or approver
    return replace(result, certificate={**certificate, **drawn, "approved_by": approved_by})


def review_draft(
    store: Store, draft_id: int, *, accepted: bool, by: str | None = None, note: str = ""
) -> None:
    """Record a review; the newest one counts, but a draft that was returned stays so.

    Args:
        store: that holds the draft.
        draft_id: of the draft.
        accepted: whether the draft may be issued; False returns it to its author.
        by: who reviews; None for the account that runs the program.
        note: what was found.

    Raises:
        InputError: there is no such draft, it is issued or returned, or its author reviews it.
    """
    row = stamp(by)
    with store.writing() as connection:
        reviewed = read_draft(connection, store, draft_id)
        if same_account(reviewed.author, row["by"]):
            raise InputError(
                "Nobody reviews a draft of their own.",
                expected="an account other than the author's",
                found=f"{row['by'] or 'no name'}, who handed it in",
                where=f"draft {draft_id}, {store.printed}",
                remedy="have another account review it",
            )
        if reviewed.number:
            raise _issued_already(store, reviewed)
        if reviewed.state == RETURNED:
            raise _returned_already(store, reviewed)
        values = {"draft_id": draft_id, "accepted": accepted, "note": note}
        connection.execute(sa.insert(review).values(values | row))


def drafts(store: Store) -> list[Draft]:
    """Return all drafts, the newest first."""
    with store.reading() as connection:
        return _read(connection, sa.true())


def read_draft(connection: sa.Connection, store: Store, draft_id: int) -> Draft:
    """Return a draft as it is now.

    Raises:
        InputError: there is none of this number.
    """
    for stored in _read(connection, draft.c.id == draft_id):
        return stored
    raise InputError(
        "The store holds no such draft.",
        expected="the number of a draft",
        found=str(draft_id),
        where=store.printed,
        remedy="⟦command = issue list⟧ lists them",
    )


def content(store: Store, draft_id: int) -> DraftContent:
    """Return what a draft holds.

    Raises:
        InputError: there is none of this number.
    """
    with store.reading() as connection:
        read_draft(connection, store, draft_id)
        files = draft.c.logo, draft.c.template, draft.c.before, draft.c.fonts
        selection = (
            sa.select(calibration.c.document, *files)
            .join(calibration, calibration.c.id == draft.c.calibration_id)
            .where(draft.c.id == draft_id)
        )
        row = connection.execute(selection).one()
    before = None if row.before is None else query.unpacked(row.before)
    fonts = tuple(Path(folder) for folder in json.loads(row.fonts))
    issue = Issue(before, row.logo, fonts=fonts)
    return DraftContent(query.unpacked(row.document), issue, row.template)


def stamp(by: str | None) -> dict[str, str]:
    """Return who makes a row, and when."""
    now = datetime.datetime.now(datetime.UTC)
    return {"by": user() if by is None else by, "recorded": now.isoformat(timespec="seconds")}


def same_account(a: str, b: str) -> bool:
    """Return whether two names may be of one account; an empty one may be anybody's."""
    return not b.strip() or a.strip().casefold() == b.strip().casefold()


def _returned_already(store: Store, returned: Draft) -> InputError:
    return InputError(
        "A returned draft is not reviewed again.",
        expected="a draft that was handed in since",
        found=f"returned by {returned.reviewer}: {returned.note}".rstrip(": "),
        where=f"draft {returned.id}, {store.printed}",
        remedy="correct it and hand it in again: it becomes another draft",
    )


def _issued_already(store: Store, issued: Draft) -> InputError:
    return InputError(
        "An issued certificate cannot be changed.",
        expected="a draft that is not issued",
        found=f"draft {issued.id}, certificate {issued.number}",
        where=store.printed,
        remedy=(
            f'hand in an amendment: [certificate] replaces = "{issued.number}", with its changes'
        ),
    )


def _read(connection: sa.Connection, condition: Any) -> list[Draft]:
    newest = (
        sa.select(sa.func.max(review.c.id))
        .where(review.c.draft_id == draft.c.id)
        .correlate(draft)
        .scalar_subquery()
    )
    joined = (
        draft.join(calibration, calibration.c.id == draft.c.calibration_id)
        .join(sensor, sensor.c.id == calibration.c.sensor_id)
        .outerjoin(review, review.c.id == newest)
        .outerjoin(certificate_number, certificate_number.c.draft_id == draft.c.id)
        .outerjoin(certificate, certificate.c.draft_id == draft.c.id)
    )
    selection = (
        sa.select(
            *(draft.c.id, draft.c.calibration_id, draft.c.by, draft.c.recorded),
            *(sensor.c.manufacturer, sensor.c.type, sensor.c.serial_number),
            *(review.c.accepted, review.c.note, review.c.by.label("reviewer")),
            *(certificate_number.c.number, certificate_number.c.date),
            *(certificate_number.c.replaces, certificate.c.by.label("issuer")),
        )
        .select_from(joined)
        .where(condition)
        .order_by(draft.c.id.desc())
    )
    return [_draft(row) for row in connection.execute(selection).mappings()]


def _draft(row: Mapping[Any, Any]) -> Draft:
    state = DRAFTED if row["accepted"] is None else REVIEWED if row["accepted"] else RETURNED
    return Draft(
        id=row["id"],
        calibration_id=row["calibration_id"],
        sensor=sensor_name(dict(row)),
        author=row["by"],
        recorded=row["recorded"],
        state=state if row["issuer"] is None else ISSUED,
        reviewer=row["reviewer"] or "",
        note=row["note"] or "",
        number=row["number"] or "",
        date=row["date"],
        replaces=row["replaces"] or "",
        issuer=row["issuer"] or "",
    )
