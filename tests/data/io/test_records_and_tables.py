"""From files to Calibration: units, cuts, globs, rates, and what is refused."""

import hashlib

import numpy as np
import pytest
import soundfile

from vibrident.data.io import read

TIME = np.arange(100) / 1000
REFERENCE = np.sin(2 * np.pi * 50 * TIME)
RESPONSE = 0.5 * np.cos(2 * np.pi * 50 * TIME)

HEAD = """
[reference]
column = "ref"
scale = 2.0
full_scale = 4.0
[response]
column = "resp"
scale = -10.0
unit = "mV"
full_scale = 3.0
"""
RATE = "[sampling]\nrate_hz = 1000.0\n"
TIMES = '[sampling]\ntime_column = "t"\n'


def entry(file="a.csv", **keys) -> str:
    lines = [f"{key} = {value!r}" for key, value in {"file": file, "excitation": "sine", **keys}.items()]
    return "\n".join(("[[records]]", *lines, ""))


def save(path, time=TIME, reference=REFERENCE, response=RESPONSE):
    rows = [f"{t!r},{a!r},{b!r}" for t, a, b in zip(time.tolist(), reference.tolist(), response.tolist(), strict=True)]
    path.write_text("t,ref,resp\n" + "\n".join(rows) + "\n")
    untimed = (row.partition(",")[2] for row in rows)
    path.with_name("untimed.txt").write_text("ref,resp\n" + "\n".join(untimed) + "\n")


@pytest.fixture
def load(tmp_path):
    """Write cal.toml with this text and read it."""
    save(tmp_path / "a.csv")

    def call(text):
        (tmp_path / "cal.toml").write_text(text)
        return read(tmp_path / "cal.toml")

    return call


def test_units_hash_and_history(load, tmp_path):
    calibration = load(HEAD + RATE + entry(frequency_hz=50.0) + "[certificate]\nnumber = 3\n")

    (record,) = calibration.records
    np.testing.assert_array_equal(record.reference, 2.0 * REFERENCE)
    np.testing.assert_array_equal(record.response, -10.0 * RESPONSE)
    assert (record.reference_full_scale, record.response_full_scale) == (8.0, 30.0)
    assert (record.name, record.frequency_hz, record.sampling_rate_hz) == ("a.csv", 50.0, 1000.0)
    assert record.provenance.sha256 == hashlib.sha256((tmp_path / "a.csv").read_bytes()).hexdigest()
    history = "; ".join(record.provenance.history)
    assert "column 2 ('ref') × 2.0 → m/s^2" in history
    assert "column 3 ('resp') × -10.0 → mV" in history
    assert calibration.certificate == {"number": "3"}
    assert calibration.source == str(tmp_path / "cal.toml")


def test_cut_counts_from_the_first_sample_and_keeps_the_clock(load, tmp_path):
    save(tmp_path / "a.csv", time=TIME + 7.0)
    (record,) = load(HEAD + TIMES + entry(start_s=0.01, stop_s=0.05)).records

    np.testing.assert_array_equal(record.response, -10.0 * RESPONSE[10:50])
    assert record.start_time_s == pytest.approx(7.01, rel=1e-12)
    assert "cut: samples 11 to 50 of 100" in record.provenance.history


def test_two_parts_of_one_file_are_two_records(load):
    calibration = load(HEAD + RATE + entry(stop_s=0.05) + entry(start_s=0.05, stop_s=9.0))

    assert [(r.name, r.samples) for r in calibration.records] == [("a.csv from 0 s", 50), ("a.csv from 0.05 s", 50)]


def test_glob_in_natural_order(load, tmp_path):
    (tmp_path / "d" / "folder 3Hz.csv").mkdir(parents=True)
    for hertz in (10, 2, 1):
        save(tmp_path / "d" / f"{hertz}Hz.csv")
    calibration = load(HEAD + RATE + entry("d/*.csv"))

    assert [r.name for r in calibration.records] == ["d/1Hz.csv", "d/2Hz.csv", "d/10Hz.csv"]


def test_brackets_in_a_file_name(load, tmp_path):
    save(tmp_path / "run [1].csv")
    assert load(HEAD + RATE + entry("run [1].csv")).records[0].name == "run [1].csv"


def test_reference_in_another_file(load, tmp_path):
    save(tmp_path / "b.csv", reference=3 * REFERENCE)
    (record,) = load(HEAD + RATE + entry(reference_file="b.csv", name="both")).records

    np.testing.assert_array_equal(record.reference, 2.0 * (3 * REFERENCE))
    assert record.name == "both"
    assert hashlib.sha256((tmp_path / "b.csv").read_bytes()).hexdigest() in " ".join(record.provenance.history)


def test_decay_needs_no_reference(load):
    text = '[response]\ncolumn = "resp"\n' + RATE + entry(excitation="decay")
    (record,) = load(text).records

    assert record.reference is None


@pytest.mark.parametrize(("jitter", "relative"), [(0.0, 1e-13), (1e-6, 1e-6)])
def test_rate_from_rounded_times(load, tmp_path, jitter, relative):
    times = 1.4e3 + np.arange(100) * 7.68e-3
    if jitter:
        times = np.round(times / jitter) * jitter
    save(tmp_path / "a.csv", time=times)
    (record,) = load(HEAD + TIMES + entry()).records

    assert record.sampling_rate_hz == pytest.approx(1 / 7.68e-3, rel=max(relative, 1e-11))
    assert record.start_time_s == times[0]


def test_wav_gives_the_rate(load, tmp_path, refused):
    soundfile.write(tmp_path / "a.wav", np.column_stack([REFERENCE, RESPONSE]) / 2, 1000, subtype="DOUBLE")
    head = HEAD.replace('"ref"', "1").replace('"resp"', "2")

    (record,) = load(head + entry("a.wav")).records
    assert record.sampling_rate_hz == 1000.0
    np.testing.assert_array_equal(record.reference, REFERENCE)
    refused(
        lambda: load(head + RATE.replace("1000.0", "1001.0") + entry("a.wav")),
        problem="contradicts",
        expected="1000.0",
        found="1001.0",
        where="a.wav",
    )


def test_integers_of_a_wav_file_need_a_scale(load, tmp_path, refused):
    """Parts of the full scale are no m/s², and what full scale is the file does not say."""
    soundfile.write(tmp_path / "a.wav", np.column_stack([REFERENCE, RESPONSE]) / 2, 1000, subtype="PCM_24")
    columns = "[reference]\ncolumn = 1\n{}[response]\ncolumn = 2\n"
    refused(lambda: load(columns.format("") + entry("a.wav")), found="full scale", remedy="set scale")
    assert load(columns.format("scale = 1.0\n") + entry("a.wav")).response_unit == "full scale"


def test_a_column_is_not_both_channels(load, refused):
    head = HEAD.replace('"ref"', '"resp"')
    refused(lambda: load(head + RATE + entry()), problem="same column", found="'resp'", remedy="column under")


def test_rate_of_one_entry(load, tmp_path):
    save(tmp_path / "b.csv", time=2 * TIME)
    calibration = load(HEAD + RATE + entry() + entry("b.csv", rate_hz=500.0, start_time_s=2.5))

    assert [r.sampling_rate_hz for r in calibration.records] == [1000.0, 500.0]
    assert [r.start_time_s for r in calibration.records] == [0.0, 2.5]


def test_nan_outside_the_cut_is_no_harm(load, tmp_path, refused):
    response = RESPONSE.copy()
    response[60] = np.nan
    save(tmp_path / "a.csv", response=response)

    assert load(HEAD + RATE + entry(stop_s=0.05)).records[0].samples == 50
    refused(
        lambda: load(HEAD + RATE + entry()), found="NaN", where="a.csv, line 62, column 3 ('resp')", remedy="start_s"
    )


RECORD_MISTAKES = {
    "no match": (HEAD + RATE + entry("*.tsv"), {"problem": "No file", "found": "'*.tsv'", "where": "entry 1, file"}),
    "missing data file": (HEAD + RATE + entry("b.csv"), {"found": "no file", "where": "b.csv"}),
    "unknown ending": (HEAD + RATE + entry("cal.toml"), {"found": "'.toml'", "where": "cal.toml"}),
    "same file twice": (
        HEAD + RATE + entry() + entry("*.csv"),
        {"problem": "same samples", "found": "entry 1", "where": "entry 2", "remedy": "glob"},
    ),
    "overlapping parts": (HEAD + RATE + entry(stop_s=0.06) + entry(start_s=0.05), {"problem": "same samples"}),
    "frequency above Nyquist": (
        HEAD + RATE + entry(frequency_hz=500.0),
        {"expected": "below 500 Hz", "where": "entry 1, frequency_hz"},
    ),
    "no rate": (HEAD + entry("untimed.txt"), {"problem": "not given", "where": "[sampling]", "remedy": "rate_hz"}),
    "start behind the end": (HEAD + RATE + entry(start_s=1.0), {"problem": "empty", "expected": "0 to 0.1 s"}),
    "too short": (HEAD + RATE + entry(stop_s=0.005), {"problem": "too short", "where": "a.csv"}),
    "no such column": (HEAD.replace('"ref"', '"reff"') + RATE + entry(), {"remedy": "'ref'", "where": "[reference]"}),
    "no such reference file": (HEAD + RATE + entry(reference_file="c.csv"), {"found": "no file", "where": "c.csv"}),
    "unit in g": (
        HEAD.replace("scale = 2.0", 'unit = "g"\nscale = 2.0') + RATE + entry(),
        {"found": "'g'", "remedy": "unit"},
    ),
    "unit of a velocity": (HEAD.replace("scale = 2.0", 'scale = 2.0\nunit = "m/s"') + RATE + entry(), {"found": "m/s"}),
}


@pytest.mark.parametrize("mistake", RECORD_MISTAKES)
def test_record_mistake(load, refused, mistake):
    text, labels = RECORD_MISTAKES[mistake]
    refused(lambda: load(text), **labels)


def test_keys_for_one_file_with_a_glob_of_two(load, tmp_path, refused):
    save(tmp_path / "b.csv")
    for key in ("name", "reference_file"):
        refused(lambda key=key: load(HEAD + RATE + entry("*.csv", **{key: "b.csv"})), found="2 files", where=key)


def test_same_name_twice(load, tmp_path, refused):
    save(tmp_path / "b.csv")
    refused(lambda: load(HEAD + RATE + entry(name="x") + entry("b.csv", name="x")), found="'x'", where="entry 2")


def test_reference_file_of_another_length(load, tmp_path, refused):
    """With times in both files they are aligned; without, nothing says what belongs together."""
    (tmp_path / "b").mkdir()
    save(tmp_path / "b" / "b.csv", TIME[:50], REFERENCE[:50], RESPONSE[:50])
    (record,) = load(HEAD + RATE + entry(reference_file="b/b.csv")).records
    assert record.samples == 50
    text = HEAD + RATE + entry("untimed.txt", reference_file="b/untimed.txt")
    refused(lambda: load(text), expected="100", found="50", where="b/untimed.txt")


def test_data_file_that_is_a_folder(load, tmp_path, refused):
    (tmp_path / "b.csv").mkdir()
    refused(lambda: load(HEAD + RATE + entry("b.csv")), found="a folder", where="b.csv")


def uneven(change):
    times = TIME.copy()
    change(times)
    return times


UNEVEN = {
    "back": (uneven(lambda t: t.__setitem__(40, 0.01)), {"problem": "do not increase", "where": "line 42"}),
    "repeated": (uneven(lambda t: t.__setitem__(40, t[39])), {"problem": "same time", "where": "line 42"}),
    "gap": (np.concatenate((TIME[:50], TIME[50:] + 1.0)), {"problem": "gap", "found": "1.001", "where": "line 52"}),
    "drift": (TIME + TIME**2, {"problem": "drifts", "found": "intervals", "where": "line"}),
    "nan": (uneven(lambda t: t.__setitem__(40, np.nan)), {"problem": "not a number", "where": "line 42, column 1"}),
}


@pytest.mark.parametrize("kind", UNEVEN)
def test_uneven_times(load, tmp_path, refused, kind):
    times, labels = UNEVEN[kind]
    save(tmp_path / "a.csv", time=times)
    refused(lambda: load(HEAD + TIMES + entry()), **labels)


def test_unit_of_the_file_with_a_scale_becomes_si(load):
    text = HEAD.replace("scale = 2.0", 'scale = 9.80665\nunit = "g"') + RATE + entry()
    assert load(text).reference_unit == "m/s^2"
    assert load(HEAD.replace("scale = 2.0", 'unit = "m/s²"') + RATE + entry()).reference_unit == "m/s^2"


FRF = "f,mag,ph,u_mag,u_ph\n10,2.0,-90,0.02,0.5\n20,1.0,-180,0.01,1\n"
TABLE = """
[reference]
scale = 2.0
[response]
scale = 1e-3
unit = "V"
[table]
file = "frf.csv"
frequency = "f"
magnitude = 2
phase = "ph"
magnitude_uncertainty = "u_mag"
phase_uncertainty = 5
phase_unit = "deg"
"""


@pytest.fixture
def load_table(tmp_path):
    """Write a table and cal.toml, and read them."""

    def call(text=TABLE, table=FRF):
        (tmp_path / "frf.csv").write_text(table)
        (tmp_path / "cal.toml").write_text(text)
        return read(tmp_path / "cal.toml")

    return call


def test_table_in_degrees(load_table):
    table = load_table().table

    np.testing.assert_array_equal(table.frequency_hz, [10, 20])
    np.testing.assert_allclose(table.magnitude, [1e-3, 0.5e-3], rtol=1e-15)
    np.testing.assert_allclose(table.magnitude_uncertainty, [1e-5, 0.5e-5], rtol=1e-15)
    np.testing.assert_allclose(table.phase_rad, [-np.pi / 2, -np.pi], rtol=1e-15)
    np.testing.assert_allclose(table.phase_uncertainty_rad, np.radians([0.5, 1]), rtol=1e-15)
    assert len(table.provenance.sha256) == 64
    assert any("phase read in deg" in step for step in table.provenance.history)


def test_table_of_magnitudes_alone(load_table):
    text = '[table]\nfile = "frf.csv"\nfrequency = 1\nmagnitude = 2\n'
    table = load_table(text).table

    np.testing.assert_array_equal(table.magnitude, [2, 1])
    assert table.phase_rad is None


TABLE_MISTAKES = {
    "negative scale": (TABLE.replace("1e-3", "-1e-3"), FRF, {"where": "[response] scale", "remedy": "180"}),
    "uncertainty without phase": (TABLE.replace('phase = "ph"', ""), FRF, {"where": "[table]", "remedy": "phase"}),
    "magnitude in dB": (TABLE, FRF.replace("1.0", "-3"), {"expected": "dB", "where": "line 3, column 2 ('mag')"}),
    "frequency zero": (TABLE, FRF.replace("10,2", "0,2"), {"found": "0.0", "where": "line 2, column 1 ('f')"}),
    "uncertainty zero": (TABLE, FRF.replace("0.02", "0"), {"where": "line 2, column 4 ('u_mag')"}),
    "missing value": (TABLE, FRF.replace("-180", ""), {"found": "empty", "where": "line 3, column 3 ('ph')"}),
    "no such column": (
        TABLE.replace('"u_mag"', '"umag"'),
        FRF,
        {"remedy": "'u_mag'", "where": "[table] magnitude_unc"},
    ),
    "no such file": (TABLE.replace("frf.csv", "fr.csv"), FRF, {"found": "no file", "where": "fr.csv"}),
}


@pytest.mark.parametrize("mistake", TABLE_MISTAKES)
def test_table_mistake(load_table, refused, mistake):
    text, table, labels = TABLE_MISTAKES[mistake]
    refused(lambda: load_table(text, table), **labels)
