"""Excel workbooks as data files, and tables in dB."""

import datetime
import zipfile

import numpy as np
import pytest

import vibrident
from vibrident.base.errors import InputError
from vibrident.data.io import read, read_guarded
from vibrident.data.io.reader import open_columns

F = np.geomspace(10.0, 1000.0, 30)
S = 0.01 / (1 - (F / 700.0) ** 2 + 0.06j * F / 700.0)
TABLE = """
[sensor]
type = "T"
[table]
file = "{file}"
frequency = 1
magnitude = 2
phase = 3
magnitude_uncertainty = 4
phase_uncertainty = 5
"""


def workbook(path, rows):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(row)
    book.create_sheet("second").append([1.0, 2.0])
    book.save(path)
    return path


def test_records_of_a_workbook(tmp_path):
    time_s = np.arange(2000) / 8000.0
    a, v = 10 * np.sin(2 * np.pi * 160 * time_s), 0.1 * np.sin(2 * np.pi * 160 * time_s)
    columns = np.stack([time_s, a, v], axis=1).tolist()
    workbook(tmp_path / "x.xlsx", [["Calibration of 3 March"], ["t (s)", "a (m/s^2)", "v (V)", "note"], *columns])
    path = tmp_path / "c.toml"
    path.write_text(
        '[reference]\ncolumn = "a (m/s^2)"\n[response]\ncolumn = "v (V)"\n[sampling]\ntime_column = "t (s)"\n'
        '[[records]]\nfile = "x.xlsx"\nexcitation = "sine"\n'
    )
    for way in (read, read_guarded):
        (record,) = way(path).records
        assert record.sampling_rate_hz == pytest.approx(8000.0)
        np.testing.assert_allclose(record.reference, a, rtol=1e-15, atol=1e-20)  # openpyxl writes 16 digits
        np.testing.assert_allclose(record.response, v, rtol=1e-15, atol=1e-20)


def test_times_and_gaps(tmp_path):
    start = datetime.datetime(2026, 3, 3, 12)
    rows = [[start + datetime.timedelta(milliseconds=10 * n), float(n)] for n in range(20)]
    rows[7][1] = None
    source = open_columns(workbook(tmp_path / "x.xlsx", [["when", "y"], *rows]))
    times, values = source.load((0, 1))
    assert source.in_seconds(0)
    np.testing.assert_allclose(times, np.arange(20) * 0.01, atol=1e-6)
    assert np.isnan(values[7])
    assert values[8] == 8.0


def test_damaged_and_bomb(tmp_path):
    pytest.importorskip("openpyxl")
    (tmp_path / "x.xlsx").write_bytes(b"no workbook")
    with pytest.raises(InputError, match="Excel"):
        open_columns(tmp_path / "x.xlsx")
    with zipfile.ZipFile(tmp_path / "bomb.xlsx", "w", zipfile.ZIP_DEFLATED) as packed:
        for number in range(4):
            packed.writestr(f"{number}.xml", b"0" * 50_000_000)
    with pytest.raises(InputError, match="than it may hold"):
        open_columns(tmp_path / "bomb.xlsx")


def test_a_table_in_decibels_is_the_same_table(tmp_path):
    u = np.full(F.size, 0.002)
    plain = np.stack([F, abs(S), np.rad2deg(np.angle(S)), u * abs(S), np.rad2deg(u)], axis=1)
    level = plain.copy()
    level[:, 1], level[:, 3] = 20 * np.log10(abs(S)), u * 20 / np.log(10)
    found = []
    for name, rows, more in (("plain", plain, ""), ("level", level, 'magnitude_unit = "dB"\n')):
        head = "f (Hz),magnitude,phase (deg),u,u phase" if not more else "f (Hz),level (dB),phase (deg),u (dB),u phase"
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header=head, comments="")
        path = tmp_path / f"{name}.toml"
        path.write_text(TABLE.format(file=f"{name}.csv") + more)
        found.append(vibrident.identify(path, "accelerometer"))
    for name, parameter in found[0].parameters.items():
        other = found[1].parameters[name]
        assert other.value == pytest.approx(parameter.value, rel=1e-9)
        assert other.standard_uncertainty == pytest.approx(parameter.standard_uncertainty, rel=1e-6)
    bare = tmp_path / "bare.toml"
    bare.write_text(TABLE.format(file="level.csv"))
    np.testing.assert_allclose(read(bare).table.magnitude, abs(S), rtol=1e-12)  # by the header
