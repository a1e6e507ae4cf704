"""Sensors, their calibrations with the whole result, parameters and events."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None


def upgrade() -> None:
    """Create the tables."""
    op.create_table(
        "sensor",
        sa.Column("id", sa.Integer, primary_key=True),
        *(
            sa.Column(name, sa.String(200), nullable=False)
            for name in ("manufacturer", "type", "serial_number")
        ),
        sa.Column("axis", sa.String(50), nullable=False),
        sa.UniqueConstraint(
            "serial_number", "manufacturer", "type", "axis", name="sensor_identity"
        ),
    )
    op.create_table(
        "calibration",
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("sensor_id", sa.Integer, sa.ForeignKey("sensor.id"), nullable=False),
        sa.Column("sha256", sa.String(64), nullable=False, unique=True),
        sa.Column("date", sa.Date, nullable=False),
        sa.Column("date_stated", sa.Boolean, nullable=False),
        sa.Column("model", sa.String(200), nullable=False),
        sa.Column("estimator", sa.String(50), nullable=False),
        sa.Column("adequate", sa.Boolean, nullable=False),
        sa.Column("chi2_reduced", sa.Float),
        *(
            sa.Column(name, sa.Text, nullable=False)
            for name in ("warnings", "laboratory", "certificate_number")
        ),
        sa.Column("document", sa.LargeBinary, nullable=False),
    )
    op.create_table(
        "parameter",
        sa.Column("calibration_id", sa.Integer, sa.ForeignKey("calibration.id"), primary_key=True),
        sa.Column("name", sa.String(60), primary_key=True),
        sa.Column("value", sa.Float),
        sa.Column("unit", sa.String(60), nullable=False),
        sa.Column("standard_uncertainty", sa.Float),
        *(sa.Column(name, sa.Boolean, nullable=False) for name in ("identifiable", "derived")),
    )
    op.create_table(
        "event",
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("sensor_id", sa.Integer, sa.ForeignKey("sensor.id"), nullable=False),
        sa.Column("calibration_id", sa.Integer, sa.ForeignKey("calibration.id")),
        sa.Column("kind", sa.String(20), nullable=False),
        sa.Column("date", sa.Date, nullable=False),
        sa.Column("recorded", sa.String(32), nullable=False),
        *(sa.Column(name, sa.Text, nullable=False) for name in ("by", "note")),
    )
