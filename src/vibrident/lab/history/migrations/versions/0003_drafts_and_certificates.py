"""Drafts of certificates, their reviews, numbers and certificates; rows are read-only."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

from vibrident.lab.history.migrations import forbid_changes

revision = "0003"
down_revision = "0002"

_SAME_ROW = {
    "draft": "id = NEW.id",
    "review": "id = NEW.id",
    "certificate_number": (
        "draft_id = NEW.draft_id OR number = NEW.number OR replaces = NEW.replaces OR (year = "
        "NEW.year AND sequence = NEW.sequence)"
    ),
    "certificate": "draft_id = NEW.draft_id",
}


def upgrade() -> None:
    """Create the tables, then forbid changes of their rows."""
    op.create_table(
        "draft",
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("calibration_id", sa.Integer, sa.ForeignKey("calibration.id"), nullable=False),
        *_stamped(),
        sa.Column("fonts", sa.Text, nullable=False),
        *(sa.Column(name, sa.LargeBinary) for name in ("logo", "template", "before")),
    )
    op.create_index("draft_by_calibration", "draft", ["calibration_id"])
    op.create_table(
        "review",
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("draft_id", sa.Integer, sa.ForeignKey("draft.id"), nullable=False),
        *_stamped(),
        sa.Column("accepted", sa.Boolean, nullable=False),
        sa.Column("note", sa.Text, nullable=False),
    )
    op.create_index("review_by_draft", "review", ["draft_id"])
    op.create_table(
        "certificate_number",
        sa.Column("draft_id", sa.Integer, sa.ForeignKey("draft.id"), primary_key=True),
        *_stamped(),
        sa.Column("year", sa.Integer, nullable=False),
        sa.Column("sequence", sa.Integer, nullable=False),
        sa.Column("number", sa.String(200), nullable=False, unique=True),
        sa.Column("date", sa.Date, nullable=False),
        sa.Column("replaces", sa.String(200), unique=True),
        sa.UniqueConstraint("year", "sequence", name="certificate_sequence"),
    )
    op.create_table(
        "certificate",
        sa.Column("draft_id", sa.Integer, sa.ForeignKey("draft.id"), primary_key=True),
        *_stamped(),
        *(
            sa.Column(name, sa.LargeBinary, nullable=False)
            for name in ("result", "result_signature", "pdf", "dcc")
        ),
    )
    forbid_changes(_SAME_ROW)


def _stamped() -> list[sa.Column]:
    return [
        sa.Column("by", sa.Text, nullable=False),
        sa.Column("recorded", sa.String(32), nullable=False),
    ]
