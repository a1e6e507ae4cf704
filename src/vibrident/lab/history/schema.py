"""The tables, as queries use them. The migrations create them; a test compares both.

Rows are added, never changed or removed: triggers of the database enforce that.
"""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa

REVISION = "0002"  # the newest migration; a store at another one is refused
VERSION_TABLE = "vibrident_schema"
#: Name among the parameters of the magnitude of the sensitivity at the reference frequency.
REFERENCE_SENSITIVITY = "reference_sensitivity"

#: Kind of the event that corrects the date of a calibration: its ``date`` is the right one.
REDATED = "redated"

metadata = sa.MetaData()


def _filled(kind: Any, *names: str) -> list[sa.Column[Any]]:
    """Columns in which every row has a value."""
    return [sa.Column(name, kind, nullable=False) for name in names]


sensor = sa.Table(
    "sensor",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    *_filled(sa.String(200), "manufacturer", "type", "serial_number"),
    *_filled(sa.String(50), "axis"),
    sa.UniqueConstraint("serial_number", "manufacturer", "type", "axis", name="sensor_identity"),
)

calibration = sa.Table(
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

parameter = sa.Table(
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

point = sa.Table(
    "point",
    metadata,
    sa.Column("calibration_id", sa.Integer, sa.ForeignKey("calibration.id"), primary_key=True),
    sa.Column("nominal_hz", sa.Float, primary_key=True),
    *_filled(sa.Float, "frequency_hz", "magnitude"),
    *(sa.Column(name, sa.Float) for name in ("magnitude_uncertainty", "phase_deg", "phase_deg_uncertainty")),
)

event = sa.Table(
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
