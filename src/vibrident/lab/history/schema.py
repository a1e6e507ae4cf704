"""The tables, as queries use them. The migrations create them; a test compares both.

Rows are added, never changed or removed: triggers of the database enforce that.
"""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa

REVISION = "0003"  # the newest migration; a store at another one is refused
VERSION_TABLE = "vibrident_schema"
#: Name among the parameters of the magnitude of the sensitivity at the reference frequency.
REFERENCE_SENSITIVITY = "reference_sensitivity"

#: Kind of the event that corrects the date of a calibration: its ``date`` is the right one.
REDATED = "redated"

metadata: sa.MetaData = sa.MetaData()


def _filled(kind: Any, *names: str) -> list[sa.Column[Any]]:
    """Return the columns in which every row has a value."""
    return [sa.Column(name, kind, nullable=False) for name in names]


sensor: sa.Table = sa.Table(
    "sensor",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    *_filled(sa.String(200), "manufacturer", "type", "serial_number"),
    *_filled(sa.String(50), "axis"),
    sa.UniqueConstraint("serial_number", "manufacturer", "type", "axis", name="sensor_identity"),
)

calibration: sa.Table = sa.Table(
    "calibration",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("sensor_id", sa.Integer, sa.ForeignKey("sensor.id"), nullable=False),
    sa.Column("sha256", sa.String(64), nullable=False, unique=True),
    *_filled(sa.Date, "date"),
    *_filled(sa.Boolean, "date_stated"),
    *_filled(sa.String(200), "model"),
    *_filled(sa.String(50), "estimator"),
    *_filled(sa.Boolean, "adequate"),
    sa.Column("chi2_reduced", sa.Float),
    *_filled(sa.Text, "warnings", "laboratory", "certificate_number"),
    sa.Column("data_files", sa.Text, nullable=False, server_default="[]"),
    sa.Column("document", sa.LargeBinary, nullable=False),
    sa.Index("calibration_by_sensor", "sensor_id", "date"),
)

parameter: sa.Table = sa.Table(
    "parameter",
    metadata,
    sa.Column("calibration_id", sa.Integer, sa.ForeignKey("calibration.id"), primary_key=True),
    sa.Column("name", sa.String(60), primary_key=True),
    sa.Column("value", sa.Float),
    sa.Column("unit", sa.String(60), nullable=False),
    sa.Column("standard_uncertainty", sa.Float),
    *_filled(sa.Boolean, "identifiable", "derived"),
    sa.Column("frequency_hz", sa.Float),
    sa.Column("shared", sa.Text, nullable=False, server_default="{}"),
    sa.Index("parameter_by_name", "name", "calibration_id"),
)

point: sa.Table = sa.Table(
    "point",
    metadata,
    sa.Column("calibration_id", sa.Integer, sa.ForeignKey("calibration.id"), primary_key=True),
    sa.Column("nominal_hz", sa.Float, primary_key=True),
    *_filled(sa.Float, "frequency_hz", "magnitude"),
    *(
        sa.Column(name, sa.Float)
        for name in ("magnitude_uncertainty", "phase_deg", "phase_deg_uncertainty")
    ),
)

event: sa.Table = sa.Table(
    "event",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("sensor_id", sa.Integer, sa.ForeignKey("sensor.id"), nullable=False),
    sa.Column("calibration_id", sa.Integer, sa.ForeignKey("calibration.id")),
    sa.Column("kind", sa.String(20), nullable=False),
    sa.Column("date", sa.Date, nullable=False),
    sa.Column("recorded", sa.String(32), nullable=False),
    *_filled(sa.Text, "by", "note"),
    sa.Index("event_by_sensor", "sensor_id", "kind"),
    sa.Index("event_by_calibration", "calibration_id"),
)


def _stamped() -> list[sa.Column[Any]]:
    """Return the columns of who made a row, and when."""
    return [*_filled(sa.Text, "by"), *_filled(sa.String(32), "recorded")]


#: A calibration with its statements, to be reviewed and issued: its row cannot change any more.
draft: sa.Table = sa.Table(
    "draft",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("calibration_id", sa.Integer, sa.ForeignKey("calibration.id"), nullable=False),
    *_stamped(),
    *_filled(sa.Text, "fonts"),
    *(sa.Column(name, sa.LargeBinary) for name in ("logo", "template", "before")),
    sa.Index("draft_by_calibration", "calibration_id"),
)

review: sa.Table = sa.Table(
    "review",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("draft_id", sa.Integer, sa.ForeignKey("draft.id"), nullable=False),
    *_stamped(),
    *_filled(sa.Boolean, "accepted"),
    *_filled(sa.Text, "note"),
    sa.Index("review_by_draft", "draft_id"),
)

#: The number that a draft was given; of a year they have no gaps.
certificate_number: sa.Table = sa.Table(
    "certificate_number",
    metadata,
    sa.Column("draft_id", sa.Integer, sa.ForeignKey("draft.id"), primary_key=True),
    *_stamped(),
    *_filled(sa.Integer, "year", "sequence"),
    sa.Column("number", sa.String(200), nullable=False, unique=True),
    *_filled(sa.Date, "date"),
    sa.Column("replaces", sa.String(200), unique=True),
    sa.UniqueConstraint("year", "sequence", name="certificate_sequence"),
)

#: What was issued, as its files are.
certificate: sa.Table = sa.Table(
    "certificate",
    metadata,
    sa.Column("draft_id", sa.Integer, sa.ForeignKey("draft.id"), primary_key=True),
    *_stamped(),
    *_filled(sa.LargeBinary, "result", "result_signature", "pdf", "dcc"),
)
