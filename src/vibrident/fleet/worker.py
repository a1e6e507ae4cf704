"""The process that identifies: a calibration a line on stdin, its row a line on stdout.

It ends when its stdin ends, in the middle of whatever it does: whoever started it is gone. What it writes is written
under another name first, so that nothing half-written stays under its own.
"""

from __future__ import annotations

import json
import os
import queue
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Any

from vibrident.errors import VibridentError
from vibrident.fleet import row as rows
from vibrident.fleet.key import look, sensor_text
from vibrident.fleet.orders import Orders
from vibrident.fleet.parts import write_whole
from vibrident.io.columns import unreadable
from vibrident.sandbox import set_limits

#: Seconds without a line after which it ends: on a cluster the parent may be lost unnoticed.
_IDLE_S = 120.0
#: How often a calibration is begun again whose files change while it is read.
_MOST_TRIES = 3


def work() -> None:
    """A worker's life: first its orders, then a calibration a line."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole process group; the parent ends this process
    stream = os.fdopen(os.dup(1), "w", encoding="ascii")
    os.dup2(2, 1)  # what libraries print is no answer
    first = json.loads(sys.stdin.readline())
    orders, memory_bytes = Orders(**first["orders"]), first["memory_bytes"]
    lines: queue.SimpleQueue[str] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(lines,), daemon=True).start()
    if memory_bytes is not None:
        set_limits(memory_bytes)
    import vibrident.identification
    import vibrident.io  # noqa: F401  all that linear sensors need

    answer: dict[str, Any] = {"ready": True}
    while True:
        stream.write(json.dumps(answer) + "\n")
        stream.flush()
        try:
            task = json.loads(lines.get(timeout=_IDLE_S))
        except queue.Empty:
            os._exit(0)
        answer = _answer(task["path"], task["key"], orders)


def _listen(lines: queue.SimpleQueue[str]) -> None:
    for line in sys.stdin:
        lines.put(line)
    os._exit(0)


def _answer(path: str, key: str, orders: Orders) -> dict[str, Any]:
    try:
        for _ in range(_MOST_TRIES):
            row = _identified(path, key, orders)
            now = look(path, orders).key
            if now == key:
                break
            key = now  # the files changed while they were read
        return {"row": row, "memory_bytes": _held_bytes()}
    except MemoryError:
        pass  # said outside, when what it held is gone
    except OSError as error:
        return {"unwritable": f"{type(error).__name__}: {error}"}
    return {"memory": True}


def _identified(path: str, key: str, orders: Orders) -> rows.Row:
    """Read, identify, write the result. The outcome does not depend on the folder of the files."""
    from vibrident.identification import identify
    from vibrident.io import read

    begin = time.perf_counter()
    folder, name = os.path.split(path)
    try:
        _enter(folder, path)
        result = identify(read(name), orders.model, orders.estimator)  # type: ignore[arg-type]
    except MemoryError:
        raise
    except VibridentError as error:
        return rows.refused(key, error, sensor_text(path), orders.model, time.perf_counter() - begin)
    except Exception as error:
        return rows.failed(key, rows.fault(error), sensor_text(path), orders.model, time.perf_counter() - begin)
    if orders.results:
        text = json.dumps(result.to_dict(), allow_nan=False, separators=(",", ":"))
        write_whole(orders.results_folder / f"{key}.json", text.encode("ascii"))
    return rows.identified(key, result, time.perf_counter() - begin)


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
