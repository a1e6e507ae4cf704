"""Sensors over their lives: a store of all calibrations, with drift, agreement and due dates.

    vibrident.lab.history.add("sqlite:///laboratory.db", results)

The store is a SQL database (SQLite or PostgreSQL) that only grows. SQLAlchemy is loaded when a
store is opened.
"""

from __future__ import annotations

import datetime
from collections.abc import Iterable
from typing import TYPE_CHECKING

from vibrident.base.extras import require

if TYPE_CHECKING:
    from vibrident.result import Result

for _library in ("sqlalchemy", "alembic"):
    require(
        _library,
        "history",
        "A history of sensors needs a library that is not installed.",
        "⟦command = history⟧",
    )

__all__ = ["add"]


def add(
    store_url: str | None,
    results: Iterable[Result],
    *,
    serial_number: str | None = None,
    date: datetime.date | None = None,
) -> int:
    """Add results to a store; existing ones stay unchanged.

    A new store is created on first use. Each result is added whole or not at all. The results are
    read one after another, so that a generator keeps only a few in memory.

    Args:
        store_url: SQLAlchemy URL or path of a SQLite file; None for the environment's
            VIBRIDENT_STORE, else a SQLite file in the user's data folder.
        results: of one sensor or many.
        serial_number: for results without one.
        date: of the calibration, for results without one.

    Returns:
        How many were new.

    Raises:
        InputError: the store cannot be used, or a result states no serial number or no date.
    """
    from vibrident.lab.history.entry import add_all
    from vibrident.lab.history.store import Store

    with Store(store_url) as store:
        return sum(
            outcome.new
            for outcome in add_all(store, results, serial_number=serial_number, date=date)
        )
