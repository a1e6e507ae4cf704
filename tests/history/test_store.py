"""The store: it keeps all, once, whole, as it was; and says in words what is wrong with it."""

from __future__ import annotations

import datetime
import json
import signal
import sqlite3
import sys
import time
import zlib
from dataclasses import replace

import pytest
import sqlalchemy as sa
from tests.support.databases import count, writers
from tests.support.lives import at_reference, calibrated

from vibrident import history
from vibrident.errors import InputError
from vibrident.history import location, schema
from vibrident.history.store import Store
from vibrident.result import Result


def test_a_result_is_kept_whole_and_once(tmp_path):
    url = str(tmp_path / "new folder" / "100% ?.db")
    result = calibrated(data="records")
    assert history.add(url, [result, calibrated(0.11, "2022-01-01")]) == 2
    assert history.add(url, [result]) == 0
    with Store(url) as store, store.reading() as connection:
        row = connection.execute(sa.select(schema.calibration).order_by(schema.calibration.c.id)).first()
        assert zlib.decompress(row.document).decode() == result.to_json()
        assert row.date == datetime.date(2020, 1, 1)
        wanted = schema.parameter.c.name == schema.REFERENCE_SENSITIVITY
        at = connection.execute(sa.select(schema.parameter).where(wanted)).first()
        assert at.value == pytest.approx(at_reference(result), rel=1e-12)
    assert (count(url, schema.sensor), count(url, schema.event)) == (1, 2)
    assert (tmp_path / "new folder" / "100% ?.db").exists()


@pytest.mark.parametrize(
    ("result", "option"),
    [
        (replace(calibrated(), sensor={}), "--serial"),
        (calibrated(date=None), "--date"),
    ],
)
def test_a_result_without_name_or_date_is_refused_unless_both_are_given(tmp_path, result, option):
    url = str(tmp_path / "h.db")
    with pytest.raises(InputError, match=option):
        history.add(url, [result])
    assert history.add(url, [result], serial_number="4711", date=datetime.date(2020, 5, 1)) == 1
    with pytest.raises(InputError, match="not that of the result"):
        history.add(url, [calibrated()], serial_number="12")


def test_rows_can_be_neither_changed_nor_removed_nor_replaced(tmp_path):
    file = tmp_path / "h.db"
    history.add(str(file), [calibrated()])
    with sqlite3.connect(file) as other:  # any program, with none of our manners
        for table in schema.TABLES:
            column = table.columns.keys()[-1]
            for order in (f"UPDATE {table.name} SET {column} = {column}", f"DELETE FROM {table.name}"):
                with pytest.raises(sqlite3.IntegrityError, match="append-only"):
                    other.execute(order)
        before = other.execute("SELECT * FROM calibration").fetchall()
        columns = [name for name in [c.name for c in schema.calibration.columns] if name not in ("date", "model")]
        other.execute(
            f"INSERT OR REPLACE INTO calibration ({', '.join(columns)}, date, model) "
            f"SELECT {', '.join(columns)}, '1999-01-01', 'another' FROM calibration"
        )
        assert other.execute("SELECT * FROM calibration").fetchall() == before
    other.close()


def test_an_old_store_is_refused_until_it_is_upgraded_with_its_data(tmp_path):
    from alembic.autogenerate import compare_metadata
    from alembic.migration import MigrationContext

    from vibrident.history.entry import rows_of

    url = str(tmp_path / "old.db")
    result = replace(calibrated(data="records"), sensor={"manufacturer": "maker", "type": "type A"})
    rows = rows_of(result, "4711")  # the name was given with it, and is not in the result
    with Store(url) as store:
        store.upgrade("0001")
        with sqlite3.connect(tmp_path / "old.db") as old:
            old.execute("INSERT INTO sensor VALUES (1, 'maker', 'type A', '4711', '')")
            names = (
                "sha256",
                "date_stated",
                "model",
                "estimator",
                "adequate",
                "chi2_reduced",
                "warnings",
                "laboratory",
                "document",
            )
            values = [rows.calibration[name] for name in names]
            old.execute(
                f"INSERT INTO calibration (id, sensor_id, date, certificate_number, {', '.join(names)}) "
                f"VALUES (1, 1, '2020-01-01', '', {', '.join('?' * len(names))})",
                values,
            )
            old.execute("INSERT INTO parameter VALUES (1, 'sensitivity', 0.1, 'V/(m/s^2)', 1e-4, 1, 0)")
        old.close()
        with pytest.raises(InputError, match="history upgrade"), store.reading():
            pass
        with pytest.raises(InputError, match="history upgrade"):
            history.add(url, [result], serial_number="4711")
        assert store.upgrade() == ("0001", schema.REVISION)
        with store.reading() as connection:
            context = MigrationContext.configure(connection, opts={"version_table": schema.VERSION_TABLE})
            assert compare_metadata(context, schema.metadata) == []
    fresh = str(tmp_path / "fresh.db")
    history.add(fresh, [result], serial_number="4711")
    for table in (schema.sensor, schema.calibration, schema.parameter, schema.point):
        found = []
        for each in (url, fresh):
            with Store(each) as store, store.reading() as connection:
                found.append(connection.execute(sa.select(table).order_by(*table.primary_key.columns)).all())
        assert found[0] == found[1]
    assert history.add(url, [result], serial_number="4711") == 0


def test_a_store_that_another_program_holds_is_said_to_be_held(tmp_path, monkeypatch):
    history.add(str(tmp_path / "h.db"), [calibrated()])
    monkeypatch.setattr("vibrident.history.store.PATIENCE_S", 0.1)
    other = sqlite3.connect(tmp_path / "h.db", isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    with pytest.raises(InputError, match="held by another program"):
        history.add(str(tmp_path / "h.db"), [calibrated(0.2)])
    other.close()


def test_a_driver_that_is_missing_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.raises(InputError, match=r"vibrident\[postgres\]"):
        history.add("postgresql://laboratory@127.0.0.1:1/db", [calibrated()])


def test_a_newer_store_is_left_alone(tmp_path):
    file = tmp_path / "new.db"
    history.add(str(file), [calibrated()])
    with sqlite3.connect(file) as other:
        other.execute(f"UPDATE {schema.VERSION_TABLE} SET version_num = '9999'")
    other.close()
    for act in (lambda: history.add(str(file), [calibrated(0.2)]), lambda: Store(str(file)).upgrade()):
        with pytest.raises(InputError, match="newer version"):
            act()


@pytest.mark.parametrize(
    ("url", "said"),
    [
        ("mysql://lab:geheim@host/db", "kind"),
        ("postgresql://lab:geheim@127.0.0.1:1/db", "cannot be used"),
        ("postgresql://lab:ge@h/eim@127.0.0.1:1/db", "store"),
        ("postgresql://127.0.0.1:1/db?user=lab&password=geheim", "cannot be used"),
        ("postgresql://lab:geheim@[broken/db", "store"),
        ("somewhere", "read"),
        ("sqlite://", "in memory"),
        ("sqlite:////proc/nowhere/h.db", "cannot be used"),
    ],
)
def test_a_store_that_cannot_be_used_is_named_without_its_password(url, said):
    with pytest.raises(InputError) as caught:
        history.add(url, [calibrated()])
    text = str(caught.value)
    assert said in text
    assert "geheim" not in text
    assert "eim@" not in text
    assert "Traceback" not in text


def test_a_file_that_is_no_store_and_a_store_that_is_not_there(tmp_path):
    (tmp_path / "x.db").write_text("no database " * 100)
    with pytest.raises(InputError, match="cannot be used"):
        history.add(str(tmp_path / "x.db"), [calibrated()])
    store = Store(str(tmp_path / "none.db"))
    with pytest.raises(InputError, match="no history here"), store.reading():
        pass
    assert not (tmp_path / "none.db").exists()


def test_the_default_is_the_environment_s_then_the_user_s_folder(tmp_path, monkeypatch):
    monkeypatch.setenv(location.VARIABLE, f"sqlite:///{tmp_path}/by variable.db")
    history.add(None, [calibrated()])
    assert (tmp_path / "by variable.db").exists()
    monkeypatch.delenv(location.VARIABLE)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    if sys.platform.startswith("linux"):
        assert location.chosen(None) == f"sqlite:///{tmp_path}/vibrident/history.sqlite"
    assert location.chosen("postgresql://lab@host/db").startswith("postgresql+psycopg://")


def test_four_writers_at_once_lose_nothing_and_a_kill_leaves_the_store_whole(tmp_path):
    url = str(tmp_path / "h.db")
    running = writers(url, (0, 60), (40, 100), (80, 140), (120, 160))  # they overlap: some are there already
    added = [int(process.communicate(timeout=120)[0]) for process in running]
    assert sum(added) == count(url) == 160
    killed = writers(url, (1000, 100000))[0]
    while count(url) < 180:
        time.sleep(0.02)
    killed.send_signal(signal.SIGKILL)
    killed.communicate(timeout=30)
    with sqlite3.connect(tmp_path / "h.db") as other:
        assert other.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        halves = (
            "SELECT count(*) FROM calibration c WHERE (SELECT count(*) FROM parameter WHERE calibration_id = c.id) != 3"
            " OR NOT EXISTS (SELECT 1 FROM event WHERE calibration_id = c.id)"
        )
        assert other.execute(halves).fetchone() == (0,)
    other.close()
    (before,) = {count(url)}
    assert history.add(url, [calibrated(0.3)]) == 1
    assert count(url) == before + 1


def test_what_is_stored_is_a_result_again(tmp_path):
    history.add(str(tmp_path / "h.db"), [calibrated()])
    with Store(str(tmp_path / "h.db")) as store, store.reading() as connection:
        packed = connection.execute(sa.select(schema.calibration.c.document)).scalar_one()
    assert Result.from_dict(json.loads(zlib.decompress(packed))) == calibrated()
