"""What must hold in SQLite and in a real PostgreSQL alike: queries, writers at once, a kill, append-only, upgrades."""

from __future__ import annotations

import signal
import time
from dataclasses import replace
from functools import partial

import pytest
import sqlalchemy as sa
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from tests.support.databases import add, count, filled, postgresql, writers
from tests.support.lives import calibrated

from vibrident.base.errors import InputError
from vibrident.lab.history import document, query, schema
from vibrident.lab.history.entry import add_all, rows_of
from vibrident.lab.history.store import Store


@pytest.fixture(scope="module")
def server():
    """A PostgreSQL."""
    with postgresql() as url:
        yield url


@pytest.fixture
def database(server, request):
    """A database of its own on the server."""
    name = request.node.name.partition("[")[0][:60]
    engine = sa.create_engine(server.replace("postgresql:", "postgresql+psycopg:"), isolation_level="AUTOCOMMIT")
    with engine.connect() as connection:
        connection.execute(sa.text(f'CREATE DATABASE "{name}"'))
    engine.dispose()
    return server.replace("/postgres?", f"/{name}?")


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request, tmp_path):
    """A store of either kind."""
    return str(tmp_path / "h.db") if request.param == "sqlite" else request.getfixturevalue("database")


def test_the_statements_of_a_query_do_not_grow_with_the_store(url):
    """Of one sensor and of all; the seconds are `python -m bench --only waits`."""
    filled(url, 2, 3)
    few = _statements(url)
    with Store(url) as store:
        assert sum(one.new for one in add_all(store, [calibrated(serial=f"other {i}") for i in range(50)])) == 50
    assert _statements(url) == few


def _statements(url: str) -> dict[str, list[str]]:
    with Store(url) as store:
        sensor = query.overviews(store)[0].sensor
        asked = {
            "list": partial(query.overviews, store),
            "find": partial(query.find, store, sensor.serial_number),
            "calibrations of one": partial(query.entries, store, sensor.id),
            "calibrations of all": partial(query.entries, store),
            "events of all": partial(query.events, store),
            "quantities": partial(query.known_values, store, sensor.id, schema.parameter.c.name),
        }
        return {name: _made_by(ask) for name, ask in asked.items()}


def _made_by(ask) -> list[str]:
    made: list[str] = []

    def note(connection, cursor, statement, *_):
        made.append(statement)

    sa.event.listen(sa.Engine, "before_cursor_execute", note)
    try:
        ask()
    finally:
        sa.event.remove(sa.Engine, "before_cursor_execute", note)
    return made


def test_writers_at_once_lose_nothing_and_a_kill_leaves_the_store_whole(url):
    running = writers(url, (0, 20), (10, 30))  # they overlap: some are there already
    added = [int(process.communicate(timeout=120)[0]) for process in running]
    assert sum(added) == count(url) == 30
    killed = writers(url, (1000, 100000))[0]
    while count(url) < 40:
        time.sleep(0.02)
    killed.send_signal(signal.SIGKILL)
    killed.communicate(timeout=120)
    halves = (
        "SELECT count(*) FROM calibration c WHERE (SELECT count(*) FROM parameter WHERE calibration_id = c.id) != 3"
        " OR NOT EXISTS (SELECT 1 FROM event WHERE calibration_id = c.id)"
    )
    with Store(url) as store, store.reading() as connection:
        assert connection.execute(sa.text(halves)).scalar_one() == 0
        if store.url.startswith("sqlite"):
            assert connection.execute(sa.text("PRAGMA integrity_check")).scalar_one() == "ok"
    before = count(url)
    assert add(url, [calibrated(0.3)]) == 1
    assert count(url) == before + 1


def test_what_postgresql_cannot_keep_is_said(database):
    for serial in ("7" * 300, "a\0b"):
        with pytest.raises(InputError, match="cannot be kept"):
            add(database, [calibrated(serial=serial)])


def test_postgresql_keeps_its_rows_as_they_are(database):
    add(database, [calibrated()])
    for table in schema.metadata.sorted_tables:
        column = list(table.columns)[-1].name
        for order in (
            f'UPDATE {table.name} SET "{column}" = "{column}"',
            f"DELETE FROM {table.name}",
            f"TRUNCATE {table.name} CASCADE",
        ):
            with pytest.raises(InputError, match="cannot be changed"):
                _execute(database, order)
    assert count(database) == 1


def _execute(url, order):
    with Store(url) as store, store.writing() as connection:
        connection.execute(sa.text(order))


def test_an_old_store_is_refused_until_it_is_upgraded_with_its_data(url, tmp_path):
    result = replace(calibrated(data="records"), sensor={"manufacturer": "maker", "type": "type A"})
    rows = rows_of(result, "4711")  # the name was given with it, and is not in the result
    with Store(url) as store:
        store.upgrade("0001")
        with store._engine.begin() as connection:
            connection.execute(sa.text("INSERT INTO sensor VALUES (1, 'maker', 'type A', '4711', '')"))
            old = {name: value for name, value in rows.calibration.items() if name != "data_files"}
            values = ", ".join(f":{name}" for name in old)
            order = f"INSERT INTO calibration (id, sensor_id, {', '.join(old)}) VALUES (1, 1, {values})"
            connection.execute(sa.text(order), old)
            order = "INSERT INTO parameter VALUES (1, 'sensitivity', 0.1, 'V/(m/s^2)', 1e-4, {0}, {1})"
            connection.execute(sa.text(order.format(*(1, 0) if store.url.startswith("sqlite") else ("true", "false"))))
        with pytest.raises(InputError, match="history upgrade"), store.reading():
            pass
        with pytest.raises(InputError, match="history upgrade"):
            add(url, [result], serial_number="4711")
        assert store.upgrade() == ("0001", schema.REVISION)
        with store.reading() as connection:
            context = MigrationContext.configure(connection, opts={"version_table": schema.VERSION_TABLE})
            assert compare_metadata(context, schema.metadata) == []
        assert query.result(store, 1) == result
    fresh = str(tmp_path / "fresh.db")
    add(fresh, [result], serial_number="4711")
    for table in (schema.sensor, schema.calibration, schema.parameter, schema.point):
        found = []
        for each in (url, fresh):
            with Store(each) as store, store.reading() as connection:
                found.append(connection.execute(sa.select(table).order_by(*table.primary_key.columns)).all())
        assert found[0] == found[1]
    assert add(url, [result], serial_number="4711") == 0


def test_postgresql_keeps_the_same_as_sqlite(database, tmp_path):
    results = [calibrated(0.1 + i / 1e4, f"{2010 + i}-01-01", data=str(i)) for i in range(4)]
    shown = []
    for url in (database, str(tmp_path / "h.db")):
        add(url, results)
        with Store(url) as store:
            told = document.of_sensor(store, query.find(store, "4711"))
            shown.append(
                {key: told[key] for key in ("sensor", "quantity", "calibrations", "series", "drift", "control")}
            )
    assert shown[0] == shown[1]
