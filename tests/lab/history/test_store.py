"""The store: it keeps all, once, whole, as it was; and says in words what is wrong with it."""

from __future__ import annotations

import datetime
import sqlite3
import sys
import zlib
from dataclasses import replace

import pytest
import sqlalchemy as sa
from tests.support.databases import add, count
from tests.support.lives import at_reference, calibrated
from tests.support.sample_results import table2

from vibrident.base.errors import InputError
from vibrident.lab.history import entry, location, query, schema
from vibrident.lab.history.store import Store


def test_a_result_is_kept_whole_and_once(tmp_path):
    url = str(tmp_path / "new folder" / "100% ?.db")
    result = calibrated(data="records")
    assert add(url, [result, calibrated(0.11, "2022-01-01")]) == 2
    assert add(url, [result]) == 0
    with Store(url) as store, store.reading() as connection:
        row = connection.execute(sa.select(schema.calibration).order_by(schema.calibration.c.id)).first()
        assert zlib.decompress(row.document).decode() == result.to_json()
        assert row.date == datetime.date(2020, 1, 1)
        wanted = schema.parameter.c.name == schema.REFERENCE_SENSITIVITY
        at = connection.execute(sa.select(schema.parameter).where(wanted)).first()
        assert at.value == pytest.approx(at_reference(result), rel=1e-12)
    assert (count(url, schema.sensor), count(url, schema.event)) == (1, 2)
    assert (tmp_path / "new folder" / "100% ?.db").exists()


def test_a_date_that_cannot_be_read_is_not_replaced_by_that_of_the_evaluation(tmp_path):
    written = replace(calibrated(date="30.06.2022"), provenance={"time": "2023-01-01T00:00:00Z"})
    with pytest.raises(InputError) as refused:
        add(str(tmp_path / "h.db"), [written])
    assert refused.value.found == "'30.06.2022'"
    assert add(str(tmp_path / "h.db"), [written], date=datetime.date(2022, 6, 30)) == 1


@pytest.mark.parametrize(
    ("result", "option"),
    [
        (replace(calibrated(), sensor={}), "give serial_number"),
        (calibrated(date=None), "give date"),
    ],
)
def test_a_result_without_name_or_date_is_refused_unless_both_are_given(tmp_path, result, option):
    url = str(tmp_path / "h.db")
    with pytest.raises(InputError, match=option):
        add(url, [result])
    stated = datetime.date(2020, 1, 1) if result.certificate else datetime.date(2020, 5, 1)
    assert add(url, [result], serial_number="4711", date=stated) == 1
    with pytest.raises(InputError, match="not that of the result"):
        add(url, [calibrated()], serial_number="12")


def numbered(data, number="2020-7", **more):
    stated = {"number": number, "laboratory": more.pop("laboratory", "L")}
    return calibrated(data=data, certificate=stated, **more)


def test_a_certificate_number_belongs_to_one_measurement(tmp_path):
    url = str(tmp_path / "h.db")
    assert add(url, [numbered("one"), numbered("one", noise=0.002), numbered("one")]) == 2
    for other in (numbered("two"), numbered("", date="2021-01-01"), numbered("three", serial="4712")):
        with pytest.raises(InputError, match=r"(?s)2020-7, as calibration 1 of sensor\s+4711"):
            add(url, [other])
    assert count(url, schema.calibration) == 2
    allowed = [
        numbered("two", "2020-8"),
        numbered("two", "2020-7", laboratory="another"),
        numbered("x", sensor={"axis": "x"}),
        calibrated(date="2022-01-01"),
        calibrated(date="2023-01-01"),
    ]
    assert add(url, allowed) == 5


def dated(url, day):
    """What the store says of its only sensor, asked in its three ways."""
    with Store(url) as store:
        (overview,) = query.overviews(store)
        ((known,),) = query.entries(store, overview.sensor.id).values()
        (row,) = query.rows(store)
    assert overview.first == overview.last == known.date == row["date"] == day
    assert known.facts["date_stated"] is row["date_stated"] is True


def test_the_date_of_a_stored_result_is_corrected_by_events_and_the_last_one_counts(tmp_path):
    url, undated = str(tmp_path / "h.db"), calibrated(date=None)
    first, second, third = (datetime.date(2020, month, 1) for month in (5, 7, 6))
    assert add(url, [undated], date=first) == 1
    for day in (first, second, third, third):
        assert add(url, [undated], date=day) == 0
        dated(url, day)
    with Store(url) as store:
        (events,) = query.events(store).values()
        told = [(each.kind, each.date, each.note) for each in events]
        assert query.result(store, 1) == undated
    assert sorted(told) == [
        ("redated", third, f"the date was {second}"),
        ("redated", second, f"the date was {first}"),
    ]
    assert count(url, schema.calibration) == 1


def test_a_date_that_contradicts_the_stated_one_is_refused(tmp_path):
    url = str(tmp_path / "h.db")
    for _ in range(2):  # a new result, and a stored one
        with pytest.raises(InputError, match=r"(?s)The date is not that.*2020-01-01.*2021-02-03"):
            add(url, [calibrated()], date=datetime.date(2021, 2, 3))
        add(url, [calibrated()], date=datetime.date(2020, 1, 1))
    dated(url, datetime.date(2020, 1, 1))


def test_a_correction_needs_a_calibration_and_a_date(tmp_path):
    url = str(tmp_path / "h.db")
    add(url, [calibrated()])
    with Store(url) as store:
        sensor = query.find(store, "4711")
        for lacking in ({"date": datetime.date(2021, 1, 1)}, {"calibration_id": 1}):
            with pytest.raises(InputError, match="not said"):
                entry.add_event(store, sensor, "redated", **lacking)
        entry.add_event(store, sensor, "redated", date=datetime.date(2021, 1, 1), calibration_id=1)
    dated(url, datetime.date(2021, 1, 1))


def test_a_calibration_of_another_sensor_is_said_to_be_one(tmp_path):
    url = str(tmp_path / "h.db")
    add(url, [calibrated(), replace(calibrated(0.11, "2022-01-01"), sensor={"serial_number": "4712"})])
    with Store(url) as store:
        sensor = query.find(store, "4711")
        with pytest.raises(InputError, match="is one of another sensor") as refusal:
            entry.add_event(store, sensor, "recalled", calibration_id=2)
    assert "4712" in refusal.value.found


def test_a_result_is_the_same_without_excerpts_and_where_an_earlier_version_stored_it(tmp_path):
    url, result = str(tmp_path / "h.db"), table2()
    with Store(url) as store:
        store.begin()
        rows = entry.rows_of(result)
        older = rows.calibration | {"sha256": "of the text, as earlier versions hashed it"}
        with store.writing() as connection:
            entry._insert(store, connection, replace(rows, calibration=older), None)
    assert add(url, [result, result.without_excerpts()]) == 0
    assert add(url, [replace(result, estimator="ml"), table2(seed=2)]) == 2
    assert add(url, [replace(result, estimator="ml").without_excerpts()]) == 0


#: A draft, its review, its number and its certificate.
ISSUED = (
    "INSERT INTO draft VALUES (1, 1, 'a', '', '[]', NULL, NULL, NULL)",
    "INSERT INTO review VALUES (1, 1, 'b', '', 1, '')",
    "INSERT INTO certificate_number VALUES (1, 'b', '', 2026, 1, '2026-0001', '2026-01-01', NULL)",
    "INSERT INTO certificate VALUES (1, 'b', '', x'', x'', x'', x'')",
)


def test_rows_can_be_neither_changed_nor_removed_nor_replaced(tmp_path):
    file = tmp_path / "h.db"
    add(str(file), [calibrated()])
    with sqlite3.connect(file) as other:  # any program, with none of our manners
        for row in ISSUED:
            other.execute(row)
        for table in schema.metadata.sorted_tables:
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


def test_a_store_that_another_program_holds_is_said_to_be_held(tmp_path, monkeypatch):
    add(str(tmp_path / "h.db"), [calibrated()])
    monkeypatch.setattr("vibrident.lab.history.store.PATIENCE_S", 0.1)
    other = sqlite3.connect(tmp_path / "h.db", isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    with pytest.raises(InputError, match="held by another program"):
        add(str(tmp_path / "h.db"), [calibrated(0.2)])
    other.close()


def test_a_store_that_can_only_be_read_is_read(tmp_path, monkeypatch):
    file = tmp_path / "h.db"
    add(str(file), [calibrated()])
    monkeypatch.setattr("vibrident.lab.history.store.os.access", lambda *_: False)
    monkeypatch.chdir(tmp_path)
    assert count(str(file)) == count("sqlite:///h.db") == 1
    with pytest.raises(InputError, match="can only be read"):
        add(str(file), [calibrated(0.2)])
    assert [path.name for path in tmp_path.iterdir()] == ["h.db"]


def test_a_driver_that_is_missing_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.raises(InputError, match=r"vibrident\[postgres\]"):
        add("postgresql://laboratory@127.0.0.1:1/db", [calibrated()])


def test_a_newer_store_is_left_alone(tmp_path):
    file = tmp_path / "new.db"
    add(str(file), [calibrated()])
    with sqlite3.connect(file) as other:
        other.execute(f"UPDATE {schema.VERSION_TABLE} SET version_num = '9999'")
    other.close()
    for act in (lambda: add(str(file), [calibrated(0.2)]), lambda: Store(str(file)).upgrade()):
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
        add(url, [calibrated()])
    text = str(caught.value)
    assert said in text
    assert "geheim" not in text
    assert "eim@" not in text
    assert "Traceback" not in text


def test_a_file_that_is_no_store_and_a_store_that_is_not_there(tmp_path):
    (tmp_path / "x.db").write_text("no database " * 100)
    with pytest.raises(InputError, match="cannot be used"):
        add(str(tmp_path / "x.db"), [calibrated()])
    absent = tmp_path / "none of 100 %.db"
    store = Store(str(absent))
    with pytest.raises(InputError, match="no history here") as caught, store.reading():
        pass
    assert str(absent) in str(caught.value)  # not as a URL escapes it
    assert not absent.exists()


def test_the_default_is_the_environment_s_then_the_user_s_folder(tmp_path, monkeypatch):
    monkeypatch.setenv(location.VARIABLE, f"sqlite:///{tmp_path}/by variable.db")
    add(None, [calibrated()])
    assert (tmp_path / "by variable.db").exists()
    monkeypatch.delenv(location.VARIABLE)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    if sys.platform.startswith("linux"):
        assert location.store_url(None) == f"sqlite:///{tmp_path}/vibrident/history.sqlite"
    assert location.store_url("postgresql://lab@host/db").startswith("postgresql+psycopg://")
