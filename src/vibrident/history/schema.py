"""The tables, as queries use them. The migrations create them; a test compares both.

Rows are added, never changed or removed: triggers of the database enforce that.
"""

from __future__ import annotations

import sqlalchemy as sa

#: The newest migration; a store at another one is refused.
REVISION = "0002"
VERSION_TABLE = "vibrident_schema"
#: Name among the parameters of the magnitude of the sensitivity at the reference frequency.
REFERENCE_SENSITIVITY = "reference_sensitivity"

metadata = sa.MetaData()

sensor = sa.Table(
    "sensor",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("manufacturer", sa.String(200), nullable=False),
    sa.Column("type", sa.String(200), nullable=False),
    sa.Column("serial_number", sa.String(200), nullable=False),
    sa.Column("axis", sa.String(50), nullable=False),
    sa.UniqueConstraint("serial_number", "manufacturer", "type", "axis", name="sensor_identity"),
)

calibration = sa.Table(
    "calibration",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("sensor_id", sa.Integer, sa.ForeignKey("sensor.id"), nullable=False),
    sa.Column("sha256", sa.String(64), nullable=False, unique=True),
    sa.Column("date", sa.Date, nullable=False),
    sa.Column("date_stated", sa.Boolean, nullable=False),
    sa.Column("model", sa.String(200), nullable=False),
    sa.Column("estimator", sa.String(50), nullable=False),
    sa.Column("adequate", sa.Boolean, nullable=False),
    sa.Column("chi2_reduced", sa.Float),
    sa.Column("warnings", sa.Text, nullable=False),
    sa.Column("laboratory", sa.Text, nullable=False),
    sa.Column("certificate_number", sa.Text, nullable=False),
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
    sa.Column("identifiable", sa.Boolean, nullable=False),
    sa.Column("derived", sa.Boolean, nullable=False),
    sa.Column("frequency_hz", sa.Float),
    sa.Column("shared", sa.Text, nullable=False, server_default="{}"),
    sa.Index("parameter_by_name", "name", "calibration_id"),
)

point = sa.Table(
    "point",
    metadata,
    sa.Column("calibration_id", sa.Integer, sa.ForeignKey("calibration.id"), primary_key=True),
    sa.Column("nominal_hz", sa.Float, primary_key=True),
    sa.Column("frequency_hz", sa.Float, nullable=False),
    sa.Column("magnitude", sa.Float, nullable=False),
    sa.Column("magnitude_uncertainty", sa.Float),
    sa.Column("phase_deg", sa.Float),
    sa.Column("phase_deg_uncertainty", sa.Float),
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
    sa.Column("by", sa.Text, nullable=False),
    sa.Column("note", sa.Text, nullable=False),
    sa.Index("event_by_sensor", "sensor_id", "kind"),
    sa.Index("event_by_calibration", "calibration_id"),
)
