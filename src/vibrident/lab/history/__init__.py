"""Sensors over their lives: a store of all calibrations, with drift, agreement and due dates.

The store is a SQL database (SQLite or PostgreSQL) that only grows. SQLAlchemy is loaded when a
store is opened.
"""

from __future__ import annotations

from vibrident.base.extras import require

for _library in ("sqlalchemy", "alembic"):
    require(
        _library,
        "history",
        "A history of sensors needs a library that is not installed.",
        "⟦command = history⟧",
    )
