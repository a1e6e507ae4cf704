"""Work of a process that identifies: calibrations in, their rows out.

A file is written under another name first, so that no unfinished file has its final name.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vibrident.base.errors import VibridentError
from vibrident.base.files import atomic_write
from vibrident.data.io.columns import unreadable
from vibrident.lab.fleet import row as rows
from vibrident.lab.fleet.key import Fingerprint, fingerprint, sensor_text
from vibrident.lab.fleet.orders import Orders
from vibrident.lab.fleet.parts import unwritable

_MAX_TRIES = 3  # how often a calibration is begun again whose files change while it is read
Task = tuple[str, str]  # path and key


def ready() -> None:
    """Load all that linear sensors need, before the time limit of a calibration runs."""
    import vibrident.data.io
    import vibrident.use.identification  # noqa: F401


def fingerprints(paths: Sequence[str], orders: Orders) -> list[Fingerprint]:
    """Return key and shape of each calibration."""
    return [fingerprint(path, orders) for path in paths]


def identified(task: Task, orders: Orders) -> tuple[rows.Row, int]:
    """Return the row of a calibration, and the bytes that this process holds.

    Raises:
        InputError: a result cannot be written.
    """
    path, key = task
    try:
        for _ in range(_MAX_TRIES):
            begin = time.perf_counter()
            row = _row(path, key, _outcome(path, orders), orders, time.perf_counter() - begin)
            if (now := fingerprint(path, orders).key) == key:
                break
            key = now  # the files changed while they were read
    except OSError as error:
        raise unwritable(error, orders.folder) from error
    return row, _held_bytes()


def _outcome(path: str, orders: Orders) -> Any:
    """Return the result, or the exception that was raised.

    It does not depend on the folder of the files.
    """
    from vibrident.data.io import read
    from vibrident.use.identification import identify

    folder, name = os.path.split(path)
    try:
        os.chdir(folder)
    except OSError as error:
        return unreadable(path, error, "a calibration file")
    try:
        return identify(read(name), orders.model, orders.estimator)
    except MemoryError:
        raise
    except Exception as error:
        return error


def _row(path: str, key: str, outcome: Any, orders: Orders, seconds: float) -> rows.Row:
    """Return the row of a result or an exception."""
    if isinstance(outcome, VibridentError):
        return rows.refused(key, outcome, sensor_text(path), orders.model, seconds)
    if isinstance(outcome, Exception):
        return rows.failed(key, rows.fault(outcome), sensor_text(path), orders.model, seconds)
    if orders.results:
        text = json.dumps(outcome.to_dict(), allow_nan=False, separators=(",", ":"))
        with atomic_write(orders.results_folder / f"{key}.json") as partial:
            partial.write_text(text, encoding="ascii")
    return rows.identified(key, outcome, seconds)


def _held_bytes() -> int:
    """Return the memory that this process holds, where the system tells it."""
    try:
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * os.sysconf(
            "SC_PAGE_SIZE"
        )
    except (OSError, ValueError, AttributeError):
        return 0
