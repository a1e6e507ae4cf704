"""What is written reads back exactly; what is described is what was read."""

import os
import tomllib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vibrident.data.io import describe, read, write_calibration
from vibrident.data.io.toml_text import toml_section
from vibrident.data.records import Calibration, Record, ResponseTable


def record(name="160 Hz", samples=64, rate_hz=51200.0, excitation="sine", **fields) -> Record:
    rng = np.random.default_rng(samples)
    reference = None if excitation == "decay" else rng.normal(size=samples) * 1e-7
    return Record(name, reference, rng.normal(size=samples), rate_hz, excitation=excitation, **fields)


def assert_same_record(read_back: Record, original: Record) -> None:
    np.testing.assert_array_equal(read_back.response, original.response)
    if original.reference is None:
        assert read_back.reference is None
    else:
        np.testing.assert_array_equal(read_back.reference, original.reference)
    for field in ("name", "sampling_rate_hz", "excitation", "frequency_hz", "start_time_s", "response_full_scale"):
        assert getattr(read_back, field) == getattr(original, field), field


def test_records_read_back_exactly(tmp_path):
    records = (
        record(frequency_hz=160.0, response_full_scale=5.0),
        record("160/Hz", samples=100, rate_hz=1 / 7.68e-3, start_time_s=1406723001.299, response_full_scale=5.0),
        record("swing…", excitation="decay", response_full_scale=5.0),
    )
    calibration = Calibration(
        records=records,
        model="velocity-pickup+delay",
        quantity="velocity",
        reference_standard_uncertainty=1 / 3,
        response_unit='m"V',
        sensor={"type": "line 1\nline\t2 \\ \x7f é", "serial number": "1"},
        certificate={"laboratory": "L", "temperature_c": 23.0, "instruments": [{"name": "I"}], "remarks": ["a", "b"]},
    )
    path = write_calibration(tmp_path / "new" / "out", calibration)
    again = read(path)

    assert path == tmp_path / "new" / "out" / "calibration.toml"
    assert sorted(p.name for p in path.parent.iterdir()) == [
        "160_Hz.csv",
        "160_Hz_2.csv",
        "calibration.toml",
        "swing.csv",
    ]
    assert (path.parent / "160_Hz.csv").read_text().startswith("time_s,reference_velocity,response\n0.0,")
    for read_back, original in zip(again.records, records, strict=True):
        assert_same_record(read_back, original)
    for field in ("model", "quantity", "reference_unit", "reference_standard_uncertainty", "response_unit"):
        assert getattr(again, field) == getattr(calibration, field), field
    assert dict(again.sensor) == dict(calibration.sensor)
    assert dict(again.certificate) == dict(calibration.certificate)


def test_decays_alone_read_back(tmp_path):
    calibration = Calibration(records=(record(excitation="decay"),))
    assert_same_record(read(write_calibration(tmp_path, calibration)).records[0], calibration.records[0])


@pytest.mark.parametrize("full", [True, False])
def test_table_reads_back_exactly(tmp_path, full):
    f = np.array([10.0, 12.5, 1 / 3])
    more = {"phase_rad": -f, "magnitude_uncertainty": f / 100, "phase_uncertainty_rad": f / 7} if full else {}
    calibration = Calibration(table=ResponseTable(f, 1 / f, **more))
    table = read(write_calibration(tmp_path, calibration)).table

    assert table is not None
    for field in ("frequency_hz", "magnitude", *more):
        np.testing.assert_array_equal(getattr(table, field), getattr(calibration.table, field))
    assert (table.phase_rad is None) == (not full)


def test_a_failure_leaves_nothing_behind(tmp_path, refused, monkeypatch):
    calibration = Calibration(records=(record("a"), record("b")))

    def full_disk(*_args):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("vibrident.data.io.writer._document", full_disk)
    refused(lambda: write_calibration(tmp_path / "out", calibration), found="No space left", where="out")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_a_file(tmp_path, refused):
    (tmp_path / "out").write_text("")
    refused(lambda: write_calibration(tmp_path / "out", Calibration(records=(record(),))), where="out")
    assert os.listdir(tmp_path) == ["out"]


def test_what_the_files_cannot_say_is_refused(tmp_path, refused):
    bad = np.arange(64) < 3
    masked = Calibration(records=(record().without(bad, "clipped"),))
    refused(lambda: write_calibration(tmp_path, masked), found="3 of 64", where="160 Hz")
    differing = Calibration(records=(record("a", response_full_scale=1.0), record("b", response_full_scale=2.0)))
    refused(lambda: write_calibration(tmp_path, differing), expected="response_full_scale")
    assert list(tmp_path.iterdir()) == []


def test_writing_again_replaces(tmp_path):
    write_calibration(tmp_path, Calibration(records=(record(),)))
    calibration = Calibration(records=(record(samples=100),))
    assert_same_record(read(write_calibration(tmp_path, calibration)).records[0], calibration.records[0])


plain = st.one_of(st.text(), st.integers(-(2**60), 2**60), st.floats(allow_nan=False), st.booleans())
values = st.one_of(plain, st.lists(plain, max_size=3), st.dictionaries(st.text(), plain, max_size=3))


@settings(derandomize=True, max_examples=150, deadline=None)
@given(st.dictionaries(st.text(), values, max_size=4))
def test_toml_text_reads_back(section):
    assert tomllib.loads(toml_section("a", section)) == {"a": section}


def test_describe_records():
    samples = np.array([1.0, -3.0] * 8)
    calibration = Calibration(
        records=(
            Record("a", samples, 2 * samples, 100.0, frequency_hz=10.0),
            Record("b", None, samples, 50.0, excitation="decay"),
        ),
        response_unit="mV",
    )
    first, second = describe(calibration)

    assert {name: first[name] for name in ("record", "samples", "rate / Hz", "duration / s")} == {
        "record": "a",
        "samples": 16,
        "rate / Hz": 100.0,
        "duration / s": 0.16,
    }
    assert first["reference offset / m/s²"] == -1.0
    assert first["response rms / mV"] == pytest.approx(4.0, rel=1e-15)  # of the motion: the offset stands apart
    assert first["response offset / mV"] == -2.0
    assert (second["excitation"], second["left out"]) == ("decay", 0)
    assert not any(label.startswith("reference") for label in second)


def test_describe_table():
    calibration = Calibration(table=ResponseTable(np.array([10.0, 5.0]), np.array([1.0, 2.0])))
    (row,) = describe(calibration)
    assert (row["points"], row["from / Hz"], row["to / Hz"], row["phase"]) == (2, 5.0, 10.0, False)
    assert (row["least / V/(m/s²)"], row["largest / V/(m/s²)"]) == (1.0, 2.0)
