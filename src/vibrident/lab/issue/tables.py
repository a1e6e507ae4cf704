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
    replaced = {each.replaces: each.number for each in drafts if each.number and each.replaces}
    rows = []
    for each in drafts:
        later = replaced.get(each.number) if each.number else None
        state = f"replaced by {later}" if later else each.state
        date = "" if each.date is None else str(each.date)
        handed_in = each.recorded[:10]
        row = (str(each.id), each.sensor, handed_in, each.author, state)
        rows.append((*row, each.reviewer, each.note, each.number, date))
    return Table(tuple(Column(head) for head in _HEADS), tuple(rows)).telling()
