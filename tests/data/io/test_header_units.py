"""A unit in a header: taken where the calibration file states none, refused where it contradicts it."""

import numpy as np
import pytest

from vibrident.base.errors import InputError
from vibrident.data.io import read
from vibrident.data.io.guess import guess_columns
from vibrident.data.io.header_units import is_time, unit_in_name

RATE_HZ = 2000.0
TIMES = {
    "Time (ms)": 1e-3, "t [ms]": 1e-3, "time_us": 1e-6, "Zeit (s)": 1.0, "time/min": 60.0, "t / µs": 1e-6,
    "timeMs": 1e-3, "time in ms": 1e-3, "Elapsed Time (sec)": 1.0, "t": 1.0, "time": 1.0, "TIME_NS": 1e-9,
    "seconds": 1.0, "Time(h)": 3600.0, "时间（毫秒）": 1e-3, "时间[秒]": 1.0, "时间_微秒": 1e-6, "Время (мс)": 1e-3,
}  # fmt: skip


def write_records(folder, time_name, seconds, *, names=("ref", "out"), head="", sampling, units_row=""):
    rows = "".join(f"{k / RATE_HZ / seconds:.12g},{np.sin(0.3 * k):.6f},{np.cos(0.3 * k):.6f}\n" for k in range(200))
    (folder / "a.csv").write_text(f"{time_name},{','.join(names)}\n{units_row}{rows}")
    (folder / "c.toml").write_text(
        f"[reference]\ncolumn = 2\n{head}[sampling]\n{sampling}\n"
        '[[records]]\nfile = "a.csv"\nexcitation = "random"\n[response]\ncolumn = 3\n'
    )
    return folder / "c.toml"


@pytest.mark.parametrize("name", TIMES)
def test_times_are_read_in_the_unit_of_their_header(tmp_path, name):
    (record,) = read(write_records(tmp_path, name, TIMES[name], sampling="time_column = 1")).records
    assert record.sampling_rate_hz == pytest.approx(RATE_HZ, rel=1e-9)
    assert is_time(name)
    assert guess_columns(tmp_path / "a.csv").time == name


@pytest.mark.parametrize("name", ["Time (samples)", "t [V]", "time (rad)", "Time (m)", "time (mm/s)"])
def test_a_time_column_in_another_unit_is_asked_for(tmp_path, name):
    with pytest.raises(InputError, match="contradicts") as caught:
        read(write_records(tmp_path, name, 1.0, sampling="time_column = 1"))
    assert "rate_hz" in caught.value.remedy


@pytest.mark.parametrize("name", ["time_ref", "tension", "Time(HMS)", "throttle", "t_out"])
def test_other_names_are_no_times(name):
    assert not is_time(name)


def test_a_row_of_units_counts_as_header(tmp_path):
    path = write_records(tmp_path, "t", 1e-3, sampling="time_column = 1", units_row="[ms],[m/s^2],[V]\n")
    assert read(path).records[0].sampling_rate_hz == pytest.approx(RATE_HZ, rel=1e-9)


@pytest.mark.parametrize(
    ("names", "head", "words"),
    [
        (("ref (mm/s)", "out"), "", "velocity"),
        (("ref (g)", "out"), "scale = 9.81\n", "remove scale"),
        (("ref (µm)", "out"), 'quantity = "displacement"\nscale = 1e-6\n', "remove scale"),
        (("ref (m/s^2)", "out"), "scale = 9.80665\n", "scale = 1.0"),
        (("ref [V]", "out [mV]"), "", "scale to m/s^2 per V"),
        (("ref (m)", "out"), 'quantity = "velocity"\n', "displacement"),
    ],
)
def test_a_unit_that_contradicts_a_channel_is_refused(tmp_path, names, head, words):
    with pytest.raises(InputError, match=r"contradicts|converted") as caught:
        read(write_records(tmp_path, "t", 1.0, names=names, head=head, sampling="rate_hz = 2000.0"))
    assert words in caught.value.remedy


@pytest.mark.parametrize("name", ["out (pC)", "out [counts]", "out (mA)", "out [%]", "out [mV/V]"])
def test_a_response_in_another_unit_than_stated_needs_a_scale(tmp_path, name):
    """Charge, a ratio, or a converter's counts, for volts. Another scale may be any gain."""
    path = write_records(tmp_path, "t", 1.0, names=("ref", name), sampling="rate_hz = 2000.0")
    stated = path.read_text() + 'unit = "V"\n'
    path.write_text(stated)
    with pytest.raises(InputError, match="contradicts"):
        read(path)
    path.write_text(stated + "scale = 0.0123\n")
    assert read(path).response_unit == "V"


@pytest.mark.parametrize(
    ("name", "unit"), [("out (pC)", "pC"), ("out [counts]", "counts"), ("out (V)", "V"), ("out [%]", "%")]
)
def test_the_header_tells_the_unit_of_a_response_where_none_is_stated(tmp_path, name, unit):
    """Charge became volts without a word."""
    path = write_records(tmp_path, "t", 1.0, names=("ref", name), sampling="rate_hz = 2000.0")
    assert read(path).response_unit == unit


@pytest.mark.parametrize(
    ("names", "word"),
    [
        (("ref_g", "out"), "'g'"), (("[g] ref", "out"), "'g'"), (("ref [g] (filtered)", "out"), "'g'"),
        (("ref [g RMS]", "out"), "'g RMS'"), (("ref: mg", "out"), "'mg'"), (("ref.g", "out"), "'g'"),
        (("ref [foo]", "out"), "'foo'"),
        (("ref", "out_mV"), "'mV'"), (("ref", "out - MV"), "'MV'"), (("ref", "out [æV]"), "'æV'"),
        (("ref", "out"), ""), (("ref [ch1]", "out [x]"), ""), (("ref, m/s²", "out_V"), ""),
    ],
)  # fmt: skip
def test_a_word_that_may_be_a_unit_is_refused_unless_a_scale_is_given(tmp_path, names, word):
    """Each went through without its factor."""
    path = write_records(tmp_path, "t", 1.0, names=names, head="", sampling="rate_hz = 2000.0")
    stated = path.read_text() + 'unit = "V"\n'
    path.write_text(stated)
    if word:
        with pytest.raises(InputError, match=r"unit|contradicts") as caught:
            read(path)
        assert word in str(caught.value)
        assert "scale" in caught.value.remedy
    path.write_text(stated.replace("column = 2", "column = 2\nscale = 1.0") + "scale = 2.0\n")
    (record,) = read(path).records
    np.testing.assert_allclose(record.reference, np.sin(0.3 * np.arange(200)), atol=1e-6)


def test_a_unit_behind_a_comma(tmp_path):
    path = write_records(tmp_path, "t", 1.0, names=('"ref, mg"', '"out, mV"'), sampling="rate_hz = 2000.0")
    (record,) = read(path).records
    np.testing.assert_allclose(record.reference, 9.80665e-3 * np.sin(0.3 * np.arange(200)), atol=1e-6)
    np.testing.assert_allclose(record.response, 1e-3 * np.cos(0.3 * np.arange(200)), atol=1e-6)


@pytest.mark.parametrize(
    ("names", "head"),
    [
        (("ref (V)", "out (V)"), "scale = 10.0\n"),
        (("ref (g)", "out [V]"), "scale = 2.5\n"),
        (("ref (m/s²)", "out / V"), ""),
        (("ref (µm)", "out (pC)"), 'quantity = "displacement"\n'),
        (("ref (V)", "U/V"), 'quantity = "velocity"\nscale = 0.05\n'),
        (("ref (A)", "out"), 'quantity = "drive"\n'),
        (("b/c", "left/right"), ""),
        (("ref (raw)", "out (ch 2)"), ""),
    ],
)
def test_a_unit_that_agrees_or_says_nothing_passes(tmp_path, names, head):
    assert read(write_records(tmp_path, "t", 1.0, names=names, head=head, sampling="rate_hz = 2000.0")).records


@pytest.mark.parametrize(
    ("name", "seconds", "rate", "contradicts"),
    [
        ("t (s)", 1.0, 2048.0, True),
        ("t (ms)", 1e-3, 2001.0, True),
        ("t", 1.0, 2048.0, True),
        ("t (s)", 1e-3, 2000.0, True),
        ("t (s)", 1.0, 2000.1, True),
        ("t", 1e-3, 2000.0, False),
        ("t", 1 / RATE_HZ, 2048.0, False),
        ("x", 1.0, 2048.0, False),
    ],
)
def test_a_rate_that_contradicts_the_times_is_refused(tmp_path, name, seconds, rate, contradicts):
    """Rows that are counted, and columns of another name, state no time; without a unit a ratio of
    units is no contradiction."""
    path = write_records(tmp_path, name, seconds, sampling=f"rate_hz = {rate}")
    if contradicts:
        with pytest.raises(InputError, match="rate contradicts"):
            read(path)
    else:
        assert read(path).records[0].sampling_rate_hz == rate


@pytest.mark.parametrize("name", ["(" * 200_000, " " * 200_000 + "x", "a" + "_" * 200_000, "a/" * 100_000])
def test_a_name_without_end_takes_no_time(name):
    assert unit_in_name(name) == ""
    assert not is_time(name)


def test_what_stands_last_in_a_name_is_its_unit():
    assert unit_in_name("Sensitivity [mV/(m/s²)]") == "mV/(m/s²)"
    assert unit_in_name("a in mm/s²") == "mm/s²"
    assert unit_in_name("U/V") == "V"
    assert unit_in_name("plain") == ""
