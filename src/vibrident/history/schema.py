"""The tables, as queries use them. The migrations create them; a test compares both.

Rows are added, never changed or removed: triggers of the database enforce that.
"""

from __future__ import annotations

from sqlalchemy import (
    Boolean,
    Column,
    Date,
    Float,
    ForeignKey,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Table,
    Text,
    UniqueConstraint,
)

#: The newest migration; a store at another one is refused.
REVISION = "0002"
VERSION_TABLE = "vibrident_schema"
#: Kinds of event of a sensor or of one of its calibrations.
KINDS = ("added", "approved", "superseded", "repaired", "recalled")
#: Name among the parameters of the magnitude of the sensitivity at the reference frequency.
REFERENCE_SENSITIVITY = "reference_sensitivity"

metadata = MetaData()

sensor = Table(
    "sensor",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("manufacturer", String(200), nullable=False),
    Column("type", String(200), nullable=False),
    Column("serial_number", String(200), nullable=False),
    Column("axis", String(50), nullable=False),
    UniqueConstraint("serial_number", "manufacturer", "type", "axis", name="sensor_identity"),
)

calibration = Table(
    "calibration",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("sensor_id", Integer, ForeignKey("sensor.id"), nullable=False),
    Column("sha256", String(64), nullable=False, unique=True),
    Column("date", Date, nullable=False),
    Column("date_stated", Boolean, nullable=False),
    Column("model", String(200), nullable=False),
    Column("estimator", String(50), nullable=False),
    Column("adequate", Boolean, nullable=False),
    Column("chi2_reduced", Float),
    Column("warnings", Text, nullable=False),
    Column("laboratory", Text, nullable=False),
    Column("certificate_number", Text, nullable=False),
    Column("data_files", Text, nullable=False, server_default="[]"),
    Column("document", LargeBinary, nullable=False),
    Index("calibration_by_sensor", "sensor_id", "date"),
)

parameter = Table(
    "parameter",
    metadata,
    Column("calibration_id", Integer, ForeignKey("calibration.id"), primary_key=True),
    Column("name", String(60), primary_key=True),
    Column("value", Float),
    Column("unit", String(60), nullable=False),
    Column("standard_uncertainty", Float),
    Column("identifiable", Boolean, nullable=False),
    Column("derived", Boolean, nullable=False),
    Column("frequency_hz", Float),
    Column("shared", Text, nullable=False, server_default="{}"),
    Index("parameter_by_name", "name", "calibration_id"),
)

point = Table(
    "point",
    metadata,
    Column("calibration_id", Integer, ForeignKey("calibration.id"), primary_key=True),
    Column("nominal_hz", Float, primary_key=True),
    Column("frequency_hz", Float, nullable=False),
    Column("magnitude", Float, nullable=False),
    Column("magnitude_uncertainty", Float),
    Column("phase_deg", Float),
    Column("phase_deg_uncertainty", Float),
)

event = Table(
    "event",
    metadata,
    Column("id", Integer, primary_key=True),
    Column("sensor_id", Integer, ForeignKey("sensor.id"), nullable=False),
    Column("calibration_id", Integer, ForeignKey("calibration.id")),
    Column("kind", String(20), nullable=False),
    Column("date", Date, nullable=False),
    Column("recorded", String(32), nullable=False),
    Column("by", Text, nullable=False),
    Column("note", Text, nullable=False),
    Index("event_by_sensor", "sensor_id", "kind"),
    Index("event_by_calibration", "calibration_id"),
)
