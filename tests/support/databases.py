"""A PostgreSQL of one's own for a test, and a store with many calibrations in little time."""

from __future__ import annotations

import contextlib
import datetime
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from tests.support.lives import calibrated

from vibrident.lab.histories import History
from vibrident.lab.history import schema
from vibrident.lab.history.result_rows import rows_of
from vibrident.lab.history.store import Store
from vibrident.result import Result


def _programs() -> Path | None:
    """Folder of PostgreSQL's programs: Debian keeps them out of the PATH."""
    on_path = shutil.which("initdb")
    folders = [Path(on_path).parent] if on_path else sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)
    return next((folder for folder in folders if (folder / "initdb").exists()), None)


@contextlib.contextmanager
def postgresql() -> Iterator[str]:
    """URL of a new database on a server that ends with the block; skips the test where there can be none."""
    pytest.importorskip("psycopg", reason="psycopg is not installed: pip install 'vibrident[postgres]'")
    programs = _programs()
    if programs is None:
        pytest.skip("PostgreSQL is not installed (on Debian: apt-get install postgresql)")
    account = {"user": "postgres"} if hasattr(os, "geteuid") and os.geteuid() == 0 else {}  # it refuses to be root
    folder = Path(tempfile.mkdtemp(prefix="vibrident-pg-"))
    try:
        if account:
            shutil.chown(folder, "postgres")
        run = {"check": True, "capture_output": True, "cwd": "/", "timeout": 60, **account}
        data = str(folder / "data")
        subprocess.run([programs / "initdb", "-D", data, "-A", "trust", "-U", "laboratory", "-N"], **run)
        options = f"-c listen_addresses= -c unix_socket_directories={folder} -c fsync=off"
        control = [str(programs / "pg_ctl"), "-D", data, "-w"]
        subprocess.run([*control, "-l", str(folder / "log"), "-o", options, "start"], **run)
        try:
            yield f"postgresql://laboratory@/postgres?host={folder}"
        finally:
            subprocess.run([*control, "-m", "immediate", "stop"], **run)
    except (OSError, KeyError, LookupError, subprocess.CalledProcessError) as error:
        pytest.skip(f"PostgreSQL does not start here: {error}")
    finally:
        shutil.rmtree(folder, ignore_errors=True)


WRITER = """
import sys
sys.path.insert(0, sys.argv[1])
from tests.support.lives import calibrated
from vibrident.lab.histories import History
numbers = range(*map(int, sys.argv[3:5]))
lives = (calibrated(0.1 + i / 1e5, f"20{10 + i % 10}-01-01", serial=f"{i // 10}") for i in numbers)
with History(sys.argv[2]) as history:
    print(history.add(lives))
"""


def writers(url: str, *ranges: tuple[int, int]) -> list[subprocess.Popen[str]]:
    """Processes that add calibrations at once, each its range of numbers."""
    root = str(Path(__file__).parents[2])
    return [
        subprocess.Popen(
            [sys.executable, "-c", WRITER, root, url, *map(str, numbers)], stdout=subprocess.PIPE, text=True
        )
        for numbers in ranges
    ]


def add(url: str | None, results: Iterable[Result], **stated: Any) -> int:
    """Add results to a store; the number of new ones."""
    with History(url) as history:
        return history.add(results, **stated)


def count(url: str, table: sa.Table = schema.calibration) -> int:
    """Rows of a table."""
    with Store(url) as store, store.reading() as connection:
        return connection.execute(sa.select(sa.func.count()).select_from(table)).scalar_one()


def filled(url: str, sensors: int, times: int) -> None:
    """A store with many sensors, each calibrated so many times; as rows, because results would take minutes."""
    rows = rows_of(calibrated())
    with Store(url) as store:
        store.begin()
        with store.writing() as connection:
            names = [f"{i:05d}" for i in range(sensors)]
            connection.execute(sa.insert(schema.sensor), [rows.sensor | {"serial_number": name} for name in names])
            keys = connection.execute(sa.select(schema.sensor.c.id).order_by(schema.sensor.c.id)).scalars().all()
            numbers = [(key, year) for key in keys for year in range(times)]
            connection.execute(
                sa.insert(schema.calibration),
                [
                    rows.calibration
                    | {
                        "sensor_id": key,
                        "sha256": f"{key:032d}{year:032d}",
                        "date": datetime.date(2010 + year, 1, 1 + key % 28),
                        "data_files": f'["{key}-{year}"]',
                    }
                    for key, year in numbers
                ],
            )
            added = connection.execute(sa.select(schema.calibration.c.id, schema.calibration.c.sensor_id)).all()
            parameters = [
                row | {"calibration_id": c.id, "value": row["value"] * (1 + 1e-4 * (c.id % 7))}
                for c in added
                for row in rows.parameters
            ]
            connection.execute(sa.insert(schema.parameter), parameters)
            points = [row | {"calibration_id": c.id} for c in added for row in rows.points]
            connection.execute(sa.insert(schema.point), points)
            event = {"kind": "added", "date": datetime.date.today(), "recorded": "", "by": "", "note": ""}
            events = [event | {"sensor_id": c.sensor_id, "calibration_id": c.id} for c in added]
            connection.execute(sa.insert(schema.event), events)
