"""Drafts and certificates as a table."""

from __future__ import annotations

from collections.abc import Sequence

from vibrident.lab.issue.drafts import Draft
from vibrident.show.views import Column, Table

_HEADS = (
    "draft",
    "sensor",
    "handed in",
    "by",
    "state",
    "reviewed by",
    "note",
    "certificate",
    "date",
)


def listed(drafts: Sequence[Draft]) -> Table:
    """Return a row for each draft: who made it, its review, and its certificate."""
    replaced = {draft.replaces: draft.number for draft in drafts if draft.number and draft.replaces}
    rows = []
    for draft in drafts:
        later = replaced.get(draft.number) if draft.number else None
        state = f"replaced by {later}" if later else draft.state
        date = "" if draft.date is None else str(draft.date)
        handed_in = draft.recorded[:10]
        row = (str(draft.id), draft.sensor, handed_in, draft.author, state)
        rows.append((*row, draft.reviewer, draft.note, draft.number, date))
    return Table(tuple(Column(head) for head in _HEADS), tuple(rows)).telling()
