"""Points, shared sources and the reference sensitivity, from the stored results.

Rows are read-only.
"""

from __future__ import annotations

import datetime
import json
import zlib

import sqlalchemy as sa
from alembic import op

from vibrident.lab.history.migrations import forbid_changes

revision = "0002"
down_revision = "0001"


def upgrade() -> None:
    """Add the tables and columns, fill them, then forbid changes of rows."""
    op.create_table(
        "point",
        sa.Column("calibration_id", sa.Integer, sa.ForeignKey("calibration.id"), primary_key=True),
        sa.Column("nominal_hz", sa.Float, primary_key=True),
        sa.Column("frequency_hz", sa.Float, nullable=False),
        sa.Column("magnitude", sa.Float, nullable=False),
        sa.Column("magnitude_uncertainty", sa.Float),
        sa.Column("phase_deg", sa.Float),
        sa.Column("phase_deg_uncertainty", sa.Float),
    )
    op.add_column(
        "calibration", sa.Column("data_files", sa.Text, nullable=False, server_default="[]")
    )
    op.add_column("parameter", sa.Column("frequency_hz", sa.Float))
    op.add_column("parameter", sa.Column("shared", sa.Text, nullable=False, server_default="{}"))
    op.create_index("calibration_by_sensor", "calibration", ["sensor_id", "date"])
    op.create_index("parameter_by_name", "parameter", ["name", "calibration_id"])
    op.create_index("event_by_sensor", "event", ["sensor_id", "kind"])
    op.create_index("event_by_calibration", "event", ["calibration_id"])
    _fill(op.get_bind())
    forbid_changes(_SAME_ROW)


def _fill(connection: sa.Connection) -> None:
    """Fill the new columns and tables for existing calibrations."""
    from vibrident.lab.history.result_rows import rows_of
    from vibrident.result import Result
    from vibrident.show.history import date_of

    table = {name: sa.table(name, *map(sa.column, columns)) for name, columns in _COLUMNS.items()}
    calibration = table["calibration"]
    parameter = table["parameter"]
    for (key,) in connection.execute(sa.select(calibration.c.id).order_by(calibration.c.id)).all():
        packed = connection.execute(
            sa.select(calibration.c.document).where(calibration.c.id == key)
        ).scalar_one()
        result = Result.from_dict(json.loads(zlib.decompress(packed)))
        unnamed = (
            None if result.sensor.get("serial_number") else "unnamed"
        )  # name and date may have been given with it
        rows_of_result = rows_of(
            result, unnamed, datetime.date.min if date_of(result) is None else None
        )
        files = {"data_files": rows_of_result.calibration["data_files"]}
        connection.execute(sa.update(calibration).where(calibration.c.id == key).values(files))
        connection.execute(sa.delete(parameter).where(parameter.c.calibration_id == key))
        for name, rows in (
            ("parameter", rows_of_result.parameters),
            ("point", rows_of_result.points),
        ):
            new_rows = [
                {k: row[k] for k in _COLUMNS[name] if k in row} | {"calibration_id": key}
                for row in rows
            ]
            if new_rows:
                connection.execute(sa.insert(table[name]), new_rows)


_PARAMETER = (
    "calibration_id name value unit standard_uncertainty identifiable derived frequency_hz shared"
)
_POINT = (
    "calibration_id nominal_hz frequency_hz magnitude magnitude_uncertainty phase_deg "
    "phase_deg_uncertainty"
)
_COLUMNS = {
    "calibration": ["id", "document", "data_files"],
    "parameter": _PARAMETER.split(),
    "point": _POINT.split(),
}

_SAME_ROW = {
    "sensor": (
        "id = NEW.id OR (serial_number = NEW.serial_number AND manufacturer = NEW.manufacturer "
        "AND type = NEW.type AND axis = NEW.axis)"
    ),
    "calibration": "id = NEW.id OR sha256 = NEW.sha256",
    "parameter": "calibration_id = NEW.calibration_id AND name = NEW.name",
    "point": "calibration_id = NEW.calibration_id AND nominal_hz = NEW.nominal_hz",
    "event": "id = NEW.id",
}
