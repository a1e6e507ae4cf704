"""The calibration file alone: what is accepted, and what each mistake is told."""

import pytest

from vibrident.data.io.calibration_file import read_calibration_file

RECORDS = """
[sensor]
manufacturer = "M"
serial_number = 17
calibrated = 2024-05-06
model = "velocity-pickup"
[reference]
column = 2
quantity = "velocity"
scale = 2
unit = "m/s"
standard_uncertainty = 0.001
full_scale = 10
[response]
column = "out"
scale = -0.5
unit = "mV"
[sampling]
rate_hz = 51200
[certificate]
number = 17
laboratory = "L"
date_of_calibration = 2025-03-31
instruments = ["Laser vibrometer", { name = "Shaker", serial_number = 3, calibrated_until = "2026-01-01" }]
remarks = "one"
temperature_c = 23
[[records]]
file = "*.csv"
excitation = "sine"
frequency_hz = 160
start_s = 0
stop_s = 1.0
"""
TABLE = """
[table]
file = "frf.csv"
frequency = 1
magnitude = 2
"""


def written(tmp_path, text):
    path = tmp_path / "cal.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_every_key(tmp_path):
    calibration = read_calibration_file(written(tmp_path, RECORDS))

    assert calibration.sensor.model == "velocity-pickup"
    assert calibration.sensor_text == {"manufacturer": "M", "serial_number": "17", "calibrated": "2024-05-06"}
    assert (calibration.reference.column, calibration.reference.scale) == (2, 2.0)
    assert (calibration.response.column, calibration.response.scale) == ("out", -0.5)
    assert calibration.sampling.rate_hz == 51200.0
    assert calibration.records[0].frequency_hz == 160.0
    assert calibration.certificate.stated() == {
        "number": "17",
        "laboratory": "L",
        "date_of_calibration": "2025-03-31",
        "instruments": [
            {"name": "Laser vibrometer"},
            {"name": "Shaker", "serial_number": "3", "calibrated_until": "2026-01-01"},
        ],
        "remarks": ["one"],
        "temperature_c": 23.0,
    }


def test_least_table(tmp_path):
    calibration = read_calibration_file(written(tmp_path, "\ufeff" + TABLE.replace("\n", "\r\n")))

    assert calibration.table is not None
    assert calibration.table.phase_unit == "deg"
    assert calibration.sensor.model == "accelerometer"
    assert calibration.reference.quantity == "acceleration"


MISTAKES = {
    "misspelt key": ("rate_hz =", "rate_herz =", {"remedy": "'rate_hz'", "where": "[sampling]", "found": "rate_herz"}),
    "misspelt required key": (
        "excitation =",
        "exitation =",
        {"remedy": "'excitation'", "where": "[[records]] entry 1"},
    ),
    "misspelt section": ("[response]", "[respons]", {"remedy": "'response'", "where": "top level"}),
    "key of another section": ('unit = "m/s"', "rate_hz = 3", {"remedy": "[sampling]", "where": "[reference]"}),
    "misspelt model": ("model =", "Modell =", {"remedy": "'model'", "where": "[sensor]"}),
    "nested sensor text": ("serial_number = 17", "serial_number = [17]", {"where": "[sensor] serial_number"}),
    "missing file": ('file = "*.csv"', "", {"problem": "'file' is missing", "where": "[[records]] entry 1"}),
    "missing excitation": ('excitation = "sine"', "", {"expected": "sine | multisine", "remedy": "add excitation"}),
    "unknown excitation": (
        '"sine"',
        '"sinus"',
        {"expected": "shock", "found": "'sinus'", "where": "entry 1 excitation"},
    ),
    "unknown quantity": ('"velocity"', '"speed"', {"expected": "displacement", "found": "'speed'"}),
    "scale zero": (
        "scale = 2",
        "scale = 0.0",
        {"expected": "other than 0", "found": "0.0", "where": "[reference] scale"},
    ),
    "scale infinite": ("scale = 2", "scale = inf", {"expected": "finite", "found": "inf"}),
    "scale not a number": ("scale = 2", "scale = nan", {"expected": "finite", "found": "nan"}),
    "scale as text": ("scale = 2", 'scale = "2"', {"expected": "number", "found": "'2'"}),
    "scale as truth value": ("scale = 2", "scale = true", {"expected": "number", "found": "True"}),
    "negative uncertainty": ("0.001", "-0.001", {"expected": "0 or above", "where": "standard_uncertainty"}),
    "rate zero": ("51200", "0", {"expected": "above 0", "where": "[sampling] rate_hz"}),
    "column zero": ("column = 2", "column = 0", {"expected": "from 1", "where": "[reference] column"}),
    "column fraction": ("column = 2", "column = 2.5", {"expected": "column number", "found": "column = 2.5"}),
    "column true": ("column = 2", "column = true", {"expected": "column number", "found": "True"}),
    "empty column name": ('"out"', '""', {"expected": "header name", "where": "[response] column"}),
    "no response column": ('column = "out"', "", {"problem": "[response] column", "remedy": "add column"}),
    "no reference column": ("column = 2", "", {"problem": "[reference] column", "where": "[reference]"}),
    "rate and times": ("rate_hz = 51200", "rate_hz = 5\ntime_column = 1", {"problem": "twice", "where": "[sampling]"}),
    "stop before start": ("start_s = 0", "start_s = 2", {"problem": "empty", "found": "start_s = 2"}),
    "frequency of a shock": ('"sine"', '"shock"', {"problem": "frequency", "where": "[[records]] entry 1"}),
    "single brackets": ("[[records]]", "[records]", {"expected": "double brackets", "where": "[[records]]"}),
    "records and table": ("[[records]]", TABLE + "[[records]]", {"found": "both"}),
    "misspelt certificate key": (
        "temperature_c",
        "temprature_c",
        {"remedy": "'temperature_c'", "where": "[certificate]", "found": "temprature_c"},
    ),
    "misspelt instrument key": (
        "serial_number = 3",
        "serialnumber = 3",
        {"remedy": "'serial_number'", "where": "[certificate] instruments entry 2", "found": "serialnumber"},
    ),
    "no date": ("2025-03-31", '"31 March"', {"expected": "such as 2025-03-31", "where": "date_of_calibration"}),
    "time of day as date": ("2025-03-31", "2025-03-31T10:00:00", {"expected": "such as 2025-03-31"}),
    "instrument without a name": ('name = "Shaker", ', "", {"problem": "'name' is missing", "where": "entry 2"}),
    "temperature as text": ("temperature_c = 23", 'temperature_c = "23"', {"expected": "finite", "found": "'23'"}),
    "section as value": ("[sensor]", "sampling = 3\n[sensor]", {"expected": "[sampling]", "found": "3"}),
    "syntax": ("column = 2", "column 2", {"problem": "TOML", "where": "line 8"}),
    "unquoted text": ('"velocity"', "velocity", {"problem": "TOML", "where": "line 9"}),
    "key twice": ("column = 2", "column = 2\ncolumn = 3", {"problem": "TOML", "where": "line"}),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistake(tmp_path, refused, mistake):
    old, new, labels = MISTAKES[mistake]
    assert old in RECORDS
    text = RECORDS.replace(old, new, 1)
    if mistake == "section as value":
        text = text.replace("[sampling]\nrate_hz = 51200\n", "")

    error = refused(lambda: read_calibration_file(written(tmp_path, text)), **labels)
    assert "cal.toml" in error.where


def test_neither_records_nor_table(tmp_path, refused):
    refused(lambda: read_calibration_file(written(tmp_path, "")), found="neither", remedy="[[records]]")


def test_unknown_phase_unit(tmp_path, refused):
    text = TABLE + 'phase = 3\nphase_unit = "grad"\n'
    refused(lambda: read_calibration_file(written(tmp_path, text)), expected="deg | rad", found="'grad'")


def test_files_that_cannot_be_read(tmp_path, refused):
    refused(lambda: read_calibration_file(tmp_path / "none.toml"), found="no file", where="none.toml")
    refused(lambda: read_calibration_file(tmp_path), found="a folder")
    latin = written(tmp_path, 'a = 1\nb = "µ"\n'.encode("latin-1"))
    refused(lambda: read_calibration_file(latin), problem="UTF-8", found="0xb5", where="line 2")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("run.csv", b"time_s,a,b\n0,1,2\n"),
        ("run.txt", b"1 2\n"),
        ("long.csv", b"1,2\n" * 300_000),
        ("run.wav", b"RIFF\xb5"),
    ],
)
def test_a_data_file_in_place_of_a_calibration_file_is_told_what_to_write(name, content, tmp_path, refused):
    """Its first line was called invalid TOML."""
    (tmp_path / name).write_bytes(content)
    error = refused(lambda: read_calibration_file(tmp_path / name), problem="data file", found=name)
    assert f"file = '{name}' under [[records]]" in error.remedy


def test_a_calibration_file_may_have_any_ending(tmp_path):
    (tmp_path / "cal.txt").write_text(RECORDS)
    assert read_calibration_file(tmp_path / "cal.txt").records


@pytest.mark.parametrize(
    ("text", "spelling", "meant"),
    [('"sine"', '"sinus"', "sine"), ('"sine"', '"Sine"', "sine"), ('"velocity"', '"Velocity"', "velocity")],
)
def test_a_value_that_is_nearly_right_is_suggested(text, spelling, meant, tmp_path, refused):
    assert text in RECORDS
    path = written(tmp_path, RECORDS.replace(text, spelling))
    refused(lambda: read_calibration_file(path), remedy=f"did you mean {meant!r}?")
