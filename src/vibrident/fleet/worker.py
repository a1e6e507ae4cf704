"""What happens in a process that identifies: calibrations in, their rows out.

What it writes is written under another name first, so that nothing half-written stays under its own.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from vibrident.errors import VibridentError
from vibrident.fleet import row as rows
from vibrident.fleet.key import Fingerprint, fingerprint, sensor_text
from vibrident.fleet.orders import Orders
from vibrident.fleet.parts import unwritable, write_whole
from vibrident.io.columns import unreadable

_MOST_TRIES = 3  # how often a calibration is begun again whose files change while it is read
#: Path and key.
Task = tuple[str, str]


def ready(device: str) -> None:
    """Load all that linear sensors need.

    Raises:
        InputError: the device is not there.
    """
    import vibrident.identification
    import vibrident.io  # noqa: F401

    if device == "gpu":
        from vibrident.batched.program import gpu

        gpu()


def fingerprints(paths: Sequence[str], orders: Orders) -> list[Fingerprint]:
    """Key and shape of each calibration."""
    return [fingerprint(path, orders) for path in paths]


def identified(tasks: Sequence[Task], orders: Orders) -> tuple[list[rows.Row], int]:
    """The rows of calibrations, and the bytes that this process holds.

    Raises:
        InputError: a result cannot be written.
    """
    found: dict[str, rows.Row] = {}
    try:
        for _ in range(_MOST_TRIES):
            found |= {path: row for (path, _), row in zip(tasks, _identified(tasks, orders), strict=True)}
            now = [(path, fingerprint(path, orders).key) for path, _ in tasks]
            tasks = [task for task in now if task not in tasks]  # the files changed while they were read
            if not tasks:
                break
    except OSError as error:
        raise unwritable(error, orders.folder) from error
    return list(found.values()), _held_bytes()


def _identified(tasks: Sequence[Task], orders: Orders) -> list[rows.Row]:
    """Read, identify, write the results. The outcome does not depend on the folder of the files."""
    from vibrident.many import identify_many

    begin = time.perf_counter()
    found: list[Any] = [_read(path) for path, _ in tasks]
    whole = [one for one in found if not isinstance(one, Exception)]
    try:
        made = identify_many(whole, orders.model, orders.estimator, refused="return", device=orders.device)
        ended: Iterator[Any] = iter(list(made))
    except MemoryError:
        raise
    except Exception as error:
        if len(tasks) > 1:  # which one it was shows one by one
            return [row for task in tasks for row in _identified([task], orders)]
        ended = iter([error])
    found = [one if isinstance(one, Exception) else next(ended) for one in found]
    seconds = (time.perf_counter() - begin) / len(tasks)
    return [_row(*task, one, orders, seconds) for task, one in zip(tasks, found, strict=True)]


def _read(path: str) -> Any:
    """The calibration, or the exception that reading it raised."""
    from vibrident.io import read

    folder, name = os.path.split(path)
    try:
        _enter(folder, path)
        return read(name)
    except MemoryError:
        raise
    except Exception as error:
        return error


def _row(path: str, key: str, found: Any, orders: Orders, seconds: float) -> rows.Row:
    """The row of a result or an exception."""
    if isinstance(found, VibridentError):
        return rows.refused(key, found, sensor_text(path), orders.model, seconds)
    if isinstance(found, Exception):
        return rows.failed(key, rows.fault(found), sensor_text(path), orders.model, seconds)
    if orders.results:
        text = json.dumps(found.to_dict(), allow_nan=False, separators=(",", ":"))
        write_whole(orders.results_folder / f"{key}.json", text.encode("ascii"))
    return rows.identified(key, found, seconds)


def _enter(folder: str, path: str) -> None:
    try:
        os.chdir(folder)
    except OSError as error:
        raise unreadable(path, error, "a calibration file") from error


def _held_bytes() -> int:
    """Memory of this process now, where the system says it."""
    try:
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError, AttributeError):
        return 0
