"""Units, rates and starts that binary files state, under each of their names: handed on, or refused."""

import datetime
import itertools
import json

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.io.wavfile
from tests.support import file_formats as formats

from vibrident.base import memory
from vibrident.base.errors import InputError
from vibrident.data.io.clocks import file_clock
from vibrident.data.io.columns import StartTime
from vibrident.data.io.reader import open_columns
from vibrident.data.io.stated import meaning_of, seconds_since

SIGNAL = np.linspace(-1, 1, 20)
RATE_HZ = 51200.0
OWN_START = StartTime(250_000_000, epoch=False)
DATE = "2026-03-03T12:00:00.125"
EPOCH_START = StartTime(int(np.datetime64(DATE, "ns").astype(np.int64)), epoch=True)


def hdf5(path, unit, rate_hz, start):
    with h5py.File(path, "w") as file:
        data = file.create_dataset("run/a", data=SIGNAL)
        named = {"units": unit, "sample_rate": rate_hz, "t0": start}
        data.attrs.update({name: value for name, value in named.items() if value is not None})
    return "run/a"


def matlab(path, unit, rate_hz, start):
    named = {"unit": unit, "Fs": rate_hz, "t0": start}
    beside = {name: value for name, value in named.items() if value is not None}
    scipy.io.savemat(path, {"run": {"a": SIGNAL, **beside}})
    return "run.a"


def matlab_73(path, unit, rate_hz, start):
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in {"a": SIGNAL, "Fs": rate_hz, "t0": start}.items():
            if isinstance(value, str):
                write_text(file, f"run/{name}", value)
            elif value is not None:
                file[f"run/{name}"] = np.atleast_2d(value)
        if unit is not None:
            write_text(file, "run/unit", unit)
    return "run.a"


def write_text(file, name, text):
    file[name] = np.array([[ord(letter)] for letter in text], dtype=np.uint16)
    file[name].attrs["MATLAB_class"] = np.bytes_("char")


def parquet(path, unit, rate_hz, start):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet as pq

    named = {"unit": unit, "sampling_rate_hz": rate_hz, "start_time": start}
    metadata = {name: str(value) for name, value in named.items() if value is not None}
    field = pyarrow.field("a", pyarrow.float64(), metadata=metadata)
    pq.write_table(pyarrow.table([pyarrow.array(SIGNAL)], schema=pyarrow.schema([field])), path)
    return "a"


def tdms(path, unit, rate_hz, start):
    nptdms = pytest.importorskip("nptdms")
    named = {"unit_string": unit, "wf_increment": None if rate_hz is None else 1 / rate_hz}
    if isinstance(start, str):
        named["wf_start_time"] = np.datetime64(start)
    else:
        named["wf_start_offset"] = start
    properties = {name: value for name, value in named.items() if value is not None}
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([nptdms.ChannelObject("run", "a", SIGNAL, properties)])
    return "run/a"


WRITERS = {
    "x.h5": hdf5,
    "x.nc": hdf5,
    "5.mat": matlab,
    "73.mat": matlab_73,
    "x.parquet": parquet,
    "x.tdms": tdms,
}
everywhere = pytest.mark.parametrize("name", WRITERS)


@pytest.mark.parametrize(
    ("unit", "rate_hz", "start"),
    [*itertools.product([None, "g", " mm/s² "], [None, RATE_HZ], [None, 0.25, DATE])],
)
@everywhere
def test_what_is_stated_is_handed_on(tmp_path, name, unit, rate_hz, start):
    column = WRITERS[name](tmp_path / name, unit, rate_hz, start)
    source = open_columns(tmp_path / name)
    position = source.position_of(column, "key")
    clock = source.clock(position)
    expected_start = {None: None, 0.25: OWN_START, DATE: EPOCH_START}[start]
    assert source.stated_unit(position) == (unit or "").strip()
    assert (clock is None) == (rate_hz is None)
    if clock is not None:
        assert clock.rate_hz == pytest.approx(RATE_HZ, rel=1e-12)
        assert clock.start == source.start(position)
    if expected_start is None:
        assert source.start(position) is None
    else:
        assert source.start(position).epoch == expected_start.epoch
        assert abs(source.start(position).ns - expected_start.ns) <= 1  # TDMS has 2^-64 s
    np.testing.assert_array_equal(source.load([position])[0], SIGNAL)


@pytest.mark.parametrize("rate_hz", [0.0, -5.0, np.nan, np.inf])
@pytest.mark.parametrize("name", ["x.h5", "5.mat", "73.mat", "x.parquet"])
def test_a_rate_that_is_none_is_refused(tmp_path, refused, name, rate_hz):
    WRITERS[name](tmp_path / name, None, rate_hz, None)
    problem, remedy = "sampling rate", "rate_hz"
    refused(lambda: open_columns(tmp_path / name), problem=problem, where=name, remedy=remedy)


@pytest.mark.parametrize(
    ("name", "value", "rate_hz"),
    [
        *((name, 1000, 1000.0) for name in ("fs", "Fs", "sample_rate", "SamplingRate", "rate_hz")),
        *((name, 0.001, 1000.0) for name in ("dt", "Ts", "sampling_interval", "Sample Period")),
        ("sample_rate_khz", 1.0, 1000.0),
        ("Sampling Rate [kHz]", np.float32(1.0), 1000.0),
        ("dt_ms", 1.0, 1000.0),
        ("sampling_interval_us", 1000.0, 1000.0),
        ("sample_rate", "1 kHz", 1000.0),
        ("sample_rate", np.bytes_("1000"), 1000.0),
        ("sample_rate", np.array([1000.0]), 1000.0),
        ("dt", np.float32(1 / 51200), 51200.0),  # four bytes are rounded: the plainest rate
        ("FS", 10.0, None),  # a full scale
        ("ts", 1.7e9, None),  # a time stamp
        ("rate", 60.0, None),  # of what
    ],
)
def test_names_of_a_rate(tmp_path, name, value, rate_hz):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["a"] = SIGNAL
        file["a"].attrs[name] = value
    clock = open_columns(tmp_path / "x.h5").clock(0)
    assert (clock is None) == (rate_hz is None)
    assert clock is None or clock.rate_hz == pytest.approx(rate_hz, rel=1e-12)


def test_a_rate_and_an_interval_agree_or_are_refused(tmp_path, refused):
    path = tmp_path / "x.h5"
    with h5py.File(path, "w") as file:
        file["a"] = SIGNAL
        file["a"].attrs.update({"fs": 51200.0, "dt": 1.953e-5})
    clock = open_columns(path).clock(0)
    assert clock.rate_hz == 51200.0
    assert abs(1.953e-5 * 51200.0 - 1) <= clock.rate_rounding < 1e-3
    with h5py.File(path, "a") as file:
        file["a"].attrs["dt"] = 2e-5
    refused(lambda: open_columns(path), problem="two sampling rates", found="2e-05", where="'a'")
    with h5py.File(path, "a") as file:
        file["a"].attrs["fs"] = [51200.0, 25600.0]
    refused(lambda: open_columns(path), expected="fs", found="25600")


def test_the_nearest_statement_counts_and_a_group_s_unit_is_not_that_of_times(tmp_path):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file.attrs.update({"fs": 1.0, "t0": 0.25})
        file["run/time"] = np.arange(20.0)
        for name in "abc":
            file[f"run/{name}"] = SIGNAL
        file["run"].attrs.update({"sample_rate": 2.0, "unit": "g"})
        file["run/b"].attrs.update({"sample_rate": 3.0, "unit": "mV"})
        file["alone"] = SIGNAL
    source = open_columns(tmp_path / "x.h5")
    seen = {n: (source.clock(i).rate_hz, source.stated_unit(i)) for i, n in enumerate(source.names)}
    assert seen == {
        "alone": (1.0, ""),
        "run/a": (2.0, "g"),
        "run/b": (3.0, "mV"),
        "run/c": (2.0, "g"),
        "run/time": (2.0, ""),
    }
    assert {source.start(position) for position in range(5)} == {OWN_START}


def test_several_units_are_those_of_the_columns(tmp_path):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["a"] = np.column_stack([SIGNAL, SIGNAL * 1j])
        file["a"].attrs["units"] = ["g", "mV"]
        file["b"] = np.column_stack([SIGNAL, SIGNAL])
        file["b"].attrs["units"] = ["g", "mV", "V"]  # of what: no unit that is known
    source = open_columns(tmp_path / "x.h5")
    assert source.names == ("a:1.real", "a:1.imag", "a:2.real", "a:2.imag", "b:1", "b:2")
    assert [source.stated_unit(p) for p in range(6)] == ["g", "g", "mV", "mV", *["g or mV or V"] * 2]


def test_netcdf_packing(tmp_path, refused):
    stored = np.arange(20, dtype=np.int16)
    attributes = {"scale_factor": 0.5, "add_offset": 3.0, "_FillValue": np.int16(7)}
    with h5py.File(tmp_path / "x.nc", "w") as file:
        file["a"] = stored
        file["a"].attrs.update({**attributes, "missing_value": np.int16(9)})
        file["table"] = np.column_stack([stored, stored])
        file["table"].attrs["scale_factor"] = 2.0
    source = open_columns(tmp_path / "x.nc")
    (values,) = source.load([0])
    expected = np.where(np.isin(stored, [7, 9]), np.nan, stored * 0.5 + 3.0)
    np.testing.assert_array_equal(values, expected)
    np.testing.assert_array_equal(source.block([0], 3, 12)[0], expected[3:12])
    np.testing.assert_array_equal(source.load([1, 2])[1], stored * 2.0)
    for bad in (0.0, np.nan, [1.0, 2.0], "two"):
        with h5py.File(tmp_path / "bad.nc", "w") as file:
            file["a"] = stored
            file["a"].attrs["scale_factor"] = bad
        refused(lambda: open_columns(tmp_path / "bad.nc"), expected="scale_factor", where="'a'")


def test_pieces_of_an_array_are_those_of_the_whole(tmp_path, monkeypatch):
    """However a dataset is chunked and read in pieces, the columns are the same."""
    from vibrident.data.io.formats import hdf5 as reader

    monkeypatch.setattr(reader, "_PIECE_NUMBERS", 50)
    table = np.random.default_rng(5).normal(size=(1000, 3))
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["plain"] = table
        file["wide"] = table.T
        file.create_dataset("chunked", data=table, chunks=(64, 2), compression="gzip")
    source = open_columns(tmp_path / "x.h5")
    for position, name in enumerate(source.names):
        column = table[:, int(name[-1]) - 1]
        np.testing.assert_array_equal(source.load([position])[0], column)
        np.testing.assert_array_equal(source.block([position], 137, 901)[0], column[137:901])
    np.testing.assert_array_equal(np.array(source.load(range(9))), np.tile(table.T, (3, 1)))


def test_compound_and_complex_datasets(tmp_path):
    kinds = [("t", "f8"), ("v", "i2"), ("z", "c16"), ("name", "S3")]
    rows = np.zeros(20, dtype=kinds)
    rows["t"], rows["v"], rows["z"] = np.arange(20.0), np.arange(20), SIGNAL + 2j * SIGNAL
    pair = np.zeros((1, 20), dtype=[("real", "f8"), ("imag", "f8")])  # as MATLAB 7.3 writes
    pair["real"], pair["imag"] = SIGNAL, 3 * SIGNAL
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["rows"] = rows
        file["pair"] = pair
    source = open_columns(tmp_path / "x.h5")
    expected = {
        "pair.real": SIGNAL,
        "pair.imag": 3 * SIGNAL,
        "rows:t": np.arange(20.0),
        "rows:v": np.arange(20.0),
        "rows:z.real": SIGNAL,
        "rows:z.imag": 2 * SIGNAL,
    }
    assert source.names == tuple(expected)
    for values, column in zip(source.load(range(6)), expected.values(), strict=True):
        np.testing.assert_array_equal(values, column)
    (block,) = source.block([5], 2, 7)
    np.testing.assert_array_equal(block, 2 * SIGNAL[2:7])
    assert source.position_of(2, "key") == source.position_of("rows:v", "key")


def with_axis(path, axis, unit, values=SIGNAL):
    with h5py.File(path, "w") as file:
        file["axis"] = axis
        file["axis"].attrs["units"] = unit
        file["axis"].make_scale("axis")
        file["a"] = values
        file["a"].dims[0].attach_scale(file["axis"])
    return open_columns(path)


@pytest.mark.parametrize(
    ("unit", "step", "start"),
    [
        ("s", 1e-3, StartTime(5_000_000, epoch=False)),
        ("ms", 1.0, StartTime(5_000_000, epoch=False)),
        ("milliseconds since 2026-03-03 12:00:00.120", 1.0, EPOCH_START),
    ],
)
def test_an_attached_axis_of_times_is_the_clock(tmp_path, unit, step, start):
    source = with_axis(tmp_path / "x.nc", 5 * step + step * np.arange(20), unit)
    position = source.position_of("a", "key")
    clock = file_clock(source, position)
    assert clock.rate_hz == pytest.approx(1000.0, rel=1e-12)
    assert clock.start == start
    assert source.stamps(position)[3] - source.stamps(position)[0] == pytest.approx(3e-3, rel=1e-12)


def test_an_axis_that_contradicts_the_rate_is_refused(tmp_path, refused):
    with_axis(tmp_path / "x.nc", 1e-3 * np.arange(20), "s")
    with h5py.File(tmp_path / "x.nc", "a") as file:
        file["a"].attrs["fs"] = 1010.0
    source = open_columns(tmp_path / "x.nc")
    refused(lambda: file_clock(source, source.position_of("a", "key")), expected="1000", found="1010.0")


def test_an_attached_axis_of_frequencies(tmp_path):
    response = SIGNAL + 2j
    source = with_axis(tmp_path / "x.h5", np.arange(20.0), "kHz", response)
    assert source.names == ("a.frequency", "a.real", "a.imag", "axis")
    frequency, real, imag = source.load(range(3))
    np.testing.assert_array_equal(frequency, np.arange(20.0))
    np.testing.assert_array_equal(real + 1j * imag, response)
    assert source.stated_unit(0) == "kHz"
    assert [source._channels[p].over_frequency for p in range(3)] == [True] * 3
    assert source.clock(1) is None


def test_times_since_a_date():
    assert seconds_since("hours since 1970-01-01") == (3600.0, StartTime(0, epoch=True))
    zoned = seconds_since("s since 2026-03-03 13:00:00.125 +01:00")
    assert zoned == (1.0, EPOCH_START)
    for text in ("s", "g since 2026-01-01", "s since noon", "s since 2026-13-01"):
        assert seconds_since(text) is None


def test_matlab_structures(tmp_path, refused):
    inner = {"x": SIGNAL, "units": "mV", "z": SIGNAL * 2j, "time": np.arange(20.0), "dt": 1e-3}
    content = {
        "s": {"data": np.column_stack([SIGNAL, 2 * SIGNAL]), "unit": "g", "in": inner},
        "several": [{"a": 1.0}, {"a": 2.0}],
        "SampleRate": 2000.0,
        "plain": SIGNAL,
        "z": SIGNAL * 3j,
        "cells": np.array([SIGNAL, "a"], dtype=object),
    }
    for is_compressed in (False, True):
        scipy.io.savemat(tmp_path / "x.mat", content, do_compression=is_compressed)
        source = open_columns(tmp_path / "x.mat")
        seen = {name: (source.clock(i).rate_hz, source.stated_unit(i)) for i, name in enumerate(source.names)}
        assert seen == {
            "s.data:1": (2000.0, "g"),
            "s.data:2": (2000.0, "g"),
            "s.in.x": (1000.0, "mV"),
            "s.in.z.real": (1000.0, "mV"),
            "s.in.z.imag": (1000.0, "mV"),
            "s.in.time": (1000.0, ""),
            "plain": (2000.0, ""),
            "z.real": (2000.0, ""),
            "z.imag": (2000.0, ""),
        }
        values = dict(zip(source.names, source.load(range(9)), strict=True))
        np.testing.assert_array_equal(values["s.data:2"], 2 * SIGNAL)
        np.testing.assert_array_equal(values["s.in.z.imag"], 2 * SIGNAL)
        np.testing.assert_array_equal(values["z.imag"], 3 * SIGNAL)
        for name in ("several", "cells"):
            refused(lambda name=name, source=source: source.position_of(name, "key"), found="MATLAB")


def test_a_matlab_structure_that_unpacks_to_more_than_it_may_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv(memory.VARIABLE, "5")
    large = {"s": {"a": np.zeros((10**3, 10_000), dtype=np.int8)}}
    scipy.io.savemat(tmp_path / "x.mat", large, do_compression=True)
    assert (tmp_path / "x.mat").stat().st_size < 50_000
    with pytest.raises(InputError, match="more numbers"):
        open_columns(tmp_path / "x.mat")


def test_metadata_of_pandas(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet as pq

    attributes = {"units": {"a": "g", "v": "mV"}, "fs": 51200}
    metadata = {"pandas": json.dumps({"attributes": attributes, "columns": []})}
    table = pyarrow.table({"a": SIGNAL, "v": SIGNAL, "w": SIGNAL}).replace_schema_metadata(metadata)
    pq.write_table(table, tmp_path / "x.parquet")
    source = open_columns(tmp_path / "x.parquet")
    assert [source.stated_unit(p) for p in range(3)] == ["g", "mV", ""]
    assert {source.clock(p).rate_hz for p in range(3)} == {51200.0}
    inside = json.dumps({"attributes": {"a": {"unit": "g"}, "fs": 1}, "columns": []})
    pq.write_table(table.replace_schema_metadata({"pandas": inside}), tmp_path / "x.parquet")
    assert [open_columns(tmp_path / "x.parquet").stated_unit(p) for p in range(2)] == ["g", ""]
    pq.write_table(table.replace_schema_metadata({"unit": "g", "dt": "1e-3"}), tmp_path / "x.parquet")
    source = open_columns(tmp_path / "x.parquet")
    assert {source.stated_unit(p) for p in range(3)} == {"g"}
    assert {source.clock(p).rate_hz for p in range(3)} == {1000.0}


@pytest.mark.parametrize("name", ["x.parquet", "x.tdms", "x.xlsx"])
def test_the_first_date_of_a_column_of_dates(tmp_path, name):
    times = np.datetime64(DATE, "us") + np.arange(20) * np.timedelta64(10, "ms")
    if name == "x.parquet":
        pyarrow = pytest.importorskip("pyarrow")
        from pyarrow import parquet as pq

        pq.write_table(pyarrow.table({"when": times, "a": SIGNAL}), tmp_path / name)
    elif name == "x.tdms":
        nptdms = pytest.importorskip("nptdms")
        with nptdms.TdmsWriter(tmp_path / name) as writer:
            objects = {"when": times, "a": SIGNAL}.items()
            writer.write_segment([nptdms.ChannelObject("g", n, values) for n, values in objects])
    else:
        workbook(tmp_path / name, [["when", "a"], *zip(times.tolist(), SIGNAL.tolist(), strict=True)])
    source = open_columns(tmp_path / name)
    assert source.in_seconds(0)
    np.testing.assert_allclose(source.load([0])[0], np.arange(20) * 0.01, atol=2e-6)
    assert source.start(0).epoch
    assert abs(source.start(0).ns - EPOCH_START.ns) <= 1000
    assert source.start(1) is None


RAW = 0xFFFFFFFF


def scale(number, slope, source):
    prefix = f"NI_Scale[{number}]_"
    return {
        f"{prefix}Linear_Input_Source": source,
        f"{prefix}Linear_Y_Intercept": 1.0,
        f"{prefix}Linear_Slope": slope,
        f"{prefix}Scale_Type": "Linear",
    }


STATUS = {"NI_Scaling_Status": "unscaled"}
COUNT = {"NI_Number_Of_Scales": 2}


@pytest.mark.parametrize(
    ("properties", "expected"),
    [
        (scale(0, 10.0, RAW), lambda x: 10 * x + 1),
        ({**scale(1, 2.0, 0), **scale(0, 10.0, RAW), **STATUS, **COUNT}, lambda x: 20 * x + 3),
        ({**COUNT, **scale(0, 10.0, RAW), **scale(1, 2.0, 0)}, lambda x: 20 * x + 3),
        ({**scale(0, 10.0, RAW), "NI_Scaling_Status": "scaled"}, lambda x: x),
        ({**scale(0, 10.0, 1), **scale(1, 2.0, RAW), **COUNT}, "order"),
        ({**scale(0, 10.0, RAW), **scale(1, 2.0, RAW), **COUNT}, "order"),
        ({**scale(0, 10.0, RAW), **scale(1, 2.0, 0), "NI_Number_Of_Scales": 1}, "order"),
        ({**scale(0, 10.0, RAW), "NI_Scale[1]_Scale_Type": "Reciprocal", **COUNT}, "'Reciprocal'"),
    ],
)
@pytest.mark.parametrize("place", ["channel", "group"])
def test_tdms_scales_in_any_order(tmp_path, refused, properties, expected, place):
    nptdms = pytest.importorskip("nptdms")
    counts = np.arange(20, dtype=np.int16)
    with nptdms.TdmsWriter(tmp_path / "x.tdms") as writer:
        group = nptdms.GroupObject("g", properties if place == "group" else {})
        channel = nptdms.ChannelObject("g", "a", counts, properties if place == "channel" else {})
        writer.write_segment([group, channel])
    if isinstance(expected, str):
        refused(lambda: open_columns(tmp_path / "x.tdms"), found=expected, where="x.tdms")
    else:
        (values,) = open_columns(tmp_path / "x.tdms").load([0])
        np.testing.assert_allclose(values, expected(counts), rtol=1e-15)


def test_tdms_levels_and_spectra(tmp_path):
    nptdms = pytest.importorskip("nptdms")
    spectrum = {"wf_increment": 10.0, "wf_xname": "Frequency", "wf_xunit_string": "Hz"}
    with nptdms.TdmsWriter(tmp_path / "x.tdms") as writer:
        writer.write_segment(
            [
                nptdms.RootObject({"SamplingRate": 1000.0}),
                nptdms.ChannelObject("g", "a", SIGNAL, {"NI_UnitDescription": "mV"}),
                nptdms.ChannelObject("g", "ms", SIGNAL, {"wf_increment": 1.0, "wf_xunit_string": "ms"}),
                nptdms.ChannelObject("g", "spectrum", SIGNAL, spectrum),
            ]
        )
    source = open_columns(tmp_path / "x.tdms")
    assert source.stated_unit(0) == "mV"
    assert source.clock(0).rate_hz == 1000.0
    assert source.clock(1).rate_hz == pytest.approx(1000.0, rel=1e-12)
    assert source.clock(2) is None
    assert source._channels[2].over_frequency


def units_164(code, length):
    names = {"units_code": code, "units_description": "x", "temp_mode": 1}
    return {"type": 164, **names, "length": length, "force": 1.0, "temp": 1.0, "temp_offset": 273.15}


@pytest.mark.parametrize(
    ("system", "header", "unit"),
    [
        (None, {}, ""),
        (None, {"ordinate_axis_units_lab": "g"}, "g"),
        (None, {"ordinate_spec_data_type": 12}, ""),
        ((1, 1.0), {"ordinate_spec_data_type": 12}, "m/s^2"),
        ((5, 1000.0), {"ordinate_spec_data_type": 8}, "mm"),
        ((5, 1000.0), {"ordinate_spec_data_type": 11}, "mm/s"),
        ((5, 1000.0), {"ordinate_spec_data_type": 12, "ordinate_axis_units_lab": "g"}, "g"),
        ((7, 39.37), {"ordinate_spec_data_type": 11}, "in/s"),
        ((7, 39.37), {"ordinate_spec_data_type": 13}, "lbf"),
        ((9, 100.0), {"ordinate_spec_data_type": 12}, "cm/s^2"),
        ((1, 3.28083989501312334), {"ordinate_spec_data_type": 12}, ""),  # code and factor differ
        ((1, 1.0), {"ordinate_spec_data_type": 12, "rsp_dir": 4}, ""),  # a rotation
    ],
)
def test_uff_units(tmp_path, system, header, unit):
    pyuff = pytest.importorskip("pyuff")
    formats.uff(tmp_path / "x.uff", {"a": SIGNAL}, **header)
    if system is not None:
        pyuff.UFF(str(tmp_path / "x.uff")).write_sets(units_164(*system), mode="add")
    source = open_columns(tmp_path / "x.uff")
    assert source.stated_unit(0) == unit
    assert source.clock(0).rate_hz == pytest.approx(formats.RATE_HZ, rel=1e-9)


def test_uff_times_in_milliseconds(tmp_path, refused):
    pytest.importorskip("pyuff")
    path = tmp_path / "x.uff"
    formats.uff(path, {"a": SIGNAL}, rate_hz=2.0, abscissa_axis_units_lab="ms")
    assert open_columns(path).clock(0).rate_hz == pytest.approx(2000.0, rel=1e-9)
    formats.uff(path, {"a": SIGNAL}, rate_hz=2.0, abscissa_axis_units_lab="ms", even=False)
    source = open_columns(path)
    assert file_clock(source, 0).rate_hz == pytest.approx(2000.0, rel=1e-9)
    np.testing.assert_allclose(source.stamps(0), np.arange(20) * 5e-4, atol=1e-15)
    formats.uff(path, {"a": SIGNAL}, abscissa_axis_units_lab="mm")
    refused(lambda: open_columns(path), found="'mm'")


@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("is_complex", [True, False])
def test_uff_frequency_responses(tmp_path, even, is_complex):
    pytest.importorskip("pyuff")
    response = SIGNAL + (2j if is_complex else 0)
    header = {"func_type": 4, "abscissa_spec_data_type": 18, "ref_node": 1, "ref_dir": 2}
    labels = {"ordinate_axis_units_lab": "V", "orddenom_axis_units_lab": "m/s^2"}
    channels = {"H": response, "NONE": response}
    formats.uff(tmp_path / "x.uff", channels, rate_hz=0.25, even=even, **header, **labels)
    source = open_columns(tmp_path / "x.uff")
    parts = (".frequency", ".real", ".imag") if is_complex else (".frequency", "")
    names = tuple(f"{name}{part}" for name in ("H", "7:-Z/1:+Y") for part in parts)
    assert source.names == names
    assert all(source._channels[p].over_frequency for p in range(len(names)))
    assert [source.stated_unit(p) for p in range(len(parts))] == ["Hz", *["V/(m/s^2)"] * (len(parts) - 1)]
    assert source.clock(0) is None
    frequency, *values = source.load(range(len(parts)))
    np.testing.assert_allclose(frequency, np.arange(20) * 4.0)
    np.testing.assert_allclose(values[0] + (1j * values[1] if is_complex else 0), response, rtol=1e-11)


def test_uff_responses_at_nodes(tmp_path, refused):
    """Data sets 55: all nodes at one frequency each, in any order of the frequencies."""
    pyuff = pytest.importorskip("pyuff")
    path = tmp_path / "x.uff"
    formats.uff(path, {"a": SIGNAL})
    file = pyuff.UFF(str(path))
    file.write_sets(units_164(1, 1.0), mode="add")
    step = {"type": 55, "data_ch": 2, "spec_data_type": 12, "load_case": 0, "node_nums": [4, 9]}
    for number, frequency_hz in enumerate((20.0, 10.0, 30.0)):
        r = {f"r{axis}": np.array([axis + 1j, 2 * axis]) * frequency_hz for axis in (1, 2, 3)}
        at = {"analysis_type": 5, "freq_step_n": number, "freq": frequency_hz}
        file.write_sets({**step, **at, **r}, mode="add")
    source = open_columns(path)
    assert len(source.names) == 1 + 2 * 3 * 3
    places = [source.position_of(f"9:+Y.{part}", "key") for part in ("frequency", "real", "imag")]
    frequency, real, imag = source.load(places)
    np.testing.assert_array_equal(frequency, [10.0, 20.0, 30.0])
    np.testing.assert_allclose(real, [40.0, 80.0, 120.0])
    np.testing.assert_array_equal(imag, 0.0)
    assert source.stated_unit(places[1]) == "m/s^2"
    mode = {"analysis_type": 2, "mode_n": 1, "freq": 5.0}
    file.write_sets({**step, **mode, **{f"r{axis}": np.ones(2) for axis in (1, 2, 3)}}, mode="add")
    refused(lambda: open_columns(path).position_of("data set 55", "key"), found="modes")


@pytest.mark.parametrize("version", ["4.10", "3.30"])
def test_mdf_units_and_starts(tmp_path, version):
    asammdf = pytest.importorskip("asammdf")
    path = tmp_path / ("x.mf4" if version >= "4" else "x.mdf")
    start = datetime.datetime(2026, 3, 3, 12, 0, 0, tzinfo=datetime.UTC)
    with asammdf.MDF(version=version) as file:
        file.start_time = start
        for name, unit, first in (("a", "g", 0.125), ("b", "", 0.25)):
            file.append([asammdf.Signal(SIGNAL, first + np.arange(20) / 1000, name=name, unit=unit)])
        file.save(path, overwrite=True)
    source = open_columns(path)
    assert [source.stated_unit(p) for p in (0, 1)] == ["g", ""]
    assert file_clock(source, 0).rate_hz == pytest.approx(1000.0, rel=1e-9)
    assert source.start(1).epoch
    assert source.start(1).ns - source.start(0).ns == 125_000_000
    if version >= "4":
        assert source.start(0) == EPOCH_START
    np.testing.assert_allclose(source.stamps(1), 0.25 + np.arange(20) / 1000, rtol=1e-15)


@pytest.mark.parametrize(("kind", "unit"), [("ivel", "nm/s"), ("iacc", "nm/s^2"), ("iunkn", "")])
def test_units_of_seismic_files(tmp_path, kind, unit):
    pytest.importorskip("obspy")
    from obspy.io.sac import SACTrace

    SACTrace(data=SIGNAL.astype(np.float32), delta=0.01, idep=kind).write(str(tmp_path / "x.sac"))
    assert open_columns(tmp_path / "x.sac").stated_unit(0) == unit
    formats.miniseed(tmp_path / "x.mseed", {"A": np.arange(20, dtype=np.int32)})
    assert open_columns(tmp_path / "x.mseed").stated_unit(0) == "counts"


def workbook(path, rows, **others):
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for row in rows:
        book.active.append(row)
    for name, its_rows in others.items():
        sheet = book.create_sheet(name)
        for row in its_rows:
            sheet.append(row)
    book.save(path)
    return path


NUMBERS = [[0.0, 1.0, 2.0], [1.0, 3.0, 4.0], [2.0, 5.0, 6.0]]


@pytest.mark.parametrize(
    ("head", "names", "units", "rate_hz"),
    [
        ([], ("", "", ""), ("", "", ""), None),
        ([["t", "a", "v"]], ("t", "a", "v"), ("", "", ""), None),
        ([["t", "a", "v"], ["s", "g", "mV"]], ("t", "a", "v"), ("s", "g", "mV"), None),
        ([["t", "a", "v"], ["second", "[g]", "Volt"]], ("t", "a", "v"), ("second", "g", "Volt"), None),
        ([["Made by us"], ["Serial", 12], ["t", "a", "v"]], ("t", "a", "v"), ("", "", ""), None),
        ([["Sampling rate", 51200], ["t", "a", "v"]], ("t", "a", "v"), ("", "", ""), 51200.0),
        ([["fs", 51.2, "kHz"], [], ["t", "a", "v"]], ("t", "a", "v"), ("", "", ""), 51200.0),
        ([["Sample rate: 51200 Hz"], ["t", "a", "v"]], ("t", "a", "v"), ("", "", ""), 51200.0),
        ([["dt", 0.001], ["t", "a", "v"], ["s", "g", "-"]], ("t", "a", "v"), ("s", "g", "-"), 1000.0),
    ],
)
def test_the_head_of_a_sheet(tmp_path, head, names, units, rate_hz):
    source = open_columns(workbook(tmp_path / "x.xlsx", [*head, *NUMBERS]))
    assert source.names == names
    assert tuple(source.stated_unit(p) for p in range(3)) == units
    rates = {None if clock is None else clock.rate_hz for clock in map(source.clock, range(3))}
    assert rates == {rate_hz}
    np.testing.assert_array_equal(np.transpose(source.load(range(3))), NUMBERS)


def test_a_label_and_a_missing_cell_in_the_first_row_are_no_head(tmp_path):
    rows = [["point", "a", "b"], ["p1", 1.0, None], ["p2", 2.0, 3.0]]
    source = open_columns(workbook(tmp_path / "x.xlsx", rows))
    assert source.names == ("a", "b")
    np.testing.assert_array_equal(source.load([0, 1]), [[1.0, 2.0], [np.nan, 3.0]])


def test_errors_and_empty_cells_of_a_sheet(tmp_path, refused):
    rows = [["a", "b", "c"], [1.0, "#N/A", 1.0], [None, None, None], [2.0, 5.0, "x"], [3.0, "#DIV/0!", 2.0]]
    path = workbook(tmp_path / "x.xlsx", [*rows, [None, None, None], ["", "", ""][:0]])
    source = open_columns(path)
    np.testing.assert_array_equal(source.load([0])[0], [1.0, np.nan, 2.0, 3.0])
    np.testing.assert_array_equal(source.load([1])[0], [np.nan, np.nan, 5.0, np.nan])
    refused(lambda: source.position_of("c", "key"), found="text such as 'x'")


def test_other_sheets_by_their_name(tmp_path, refused):
    others = {"Run 2": [["t", "v"], ["ms", "V"], [0.0, 7.0], [1.0, 8.0]], "bare": [[1.0], [2.0]]}
    source = open_columns(workbook(tmp_path / "x.xlsx", [["t", "a", "v"], *NUMBERS], **others))
    assert source.names == ("t", "a", "v", "Run 2!t", "Run 2!v", "bare!1")
    for name in ("Run 2!v", "Run 2/v"):
        assert source.position_of(name, "key") == 4
    assert source.position_of("Sheet!a", "key") == source.position_of(2, "key") == 1
    np.testing.assert_array_equal(source.load([4])[0], [7.0, 8.0])
    assert source.stated_unit(4) == "V"
    refused(lambda: source.position_of(4, "key"), expected="1 to 3")


def test_flac(tmp_path, refused):
    import soundfile

    path = tmp_path / "x.flac"
    for subtype, step in (("PCM_16", 2**-15), ("PCM_24", 2**-23)):
        soundfile.write(path, np.column_stack([SIGNAL / 2, SIGNAL / 4]), 51200, subtype=subtype)
        source = open_columns(path)
        assert source.clock(1).rate_hz == 51200.0
        assert source.stated_unit(1) == "full scale"
        np.testing.assert_allclose(source.load([1])[0], SIGNAL / 4, rtol=0, atol=step)
        np.testing.assert_array_equal(source.block([1], 3, 9)[0], source.load([1])[0][3:9])
    path.write_bytes(path.read_bytes()[:90])
    refused(lambda: open_columns(path).load([0]), where="x.flac")


def test_a_wav_file_that_is_cut_short_is_refused(tmp_path, refused):
    """But not one whose writer did not know its size."""
    path = tmp_path / "x.wav"
    scipy.io.wavfile.write(path, 1000, SIGNAL.astype(np.float32))
    whole = path.read_bytes()
    path.write_bytes(whole[:-8])
    refused(lambda: open_columns(path), found="ends at byte", where="x.wav")
    path.write_bytes(whole[:4] + b"\xff" * 4 + whole[8:])
    assert open_columns(path).length(0) == SIGNAL.size


@pytest.mark.parametrize("name", ["unit", "Fs", "dt_ms", "sampling rate (Hz)", "wf_start_time", "x", "Ts "])
def test_a_name_means_one_thing_whatever_its_signs(name):
    expected = {"unit": "unit", "Fs": "rate", "dt_ms": "interval", "sampling rate (Hz)": "rate"}
    expected |= {"wf_start_time": "start", "Ts ": "interval"}
    assert meaning_of(name)[0] == expected.get(name, "")
    assert meaning_of(name * 200)[0] == ""


@pytest.mark.parametrize(
    ("name", "meaning"),
    [
        ("Einheit", "unit"), ("Sensor Unit", "unit"), ("unit_label", "unit"), ("a_unit", "unit a"),
        ("Abtastrate", "rate"), ("f_s", "rate"), ("sampling_frequency_in_Hz", "rate"), ("sampleRatePerSec", "rate"),
        ("Delta_X", "interval"), ("increment", ""), ("rate", ""), ("FS", ""),
    ],
)  # fmt: skip
def test_names_of_text_heads_are_those_of_metadata(name, meaning):
    assert meaning_of(name)[0] == meaning


def test_the_name_of_a_column_stands_in_that_of_its_unit(tmp_path):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file.update({"a": SIGNAL, "v": SIGNAL, "time": np.arange(20.0)})
        file.attrs.update({"a_unit": "g", "v_unit": "mV", "time_unit": "ms"})
    source = open_columns(tmp_path / "x.h5")
    assert [source.stated_unit(p) for p in range(3)] == ["g", "ms", "mV"]


def test_groups_without_columns_state_what_their_group_is(tmp_path):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file.update({"a": SIGNAL, "b/v": SIGNAL, "meta/fs": 500.0, "b/info/unit": "mV"})
        file.create_group("b/daq").attrs["dt_ms"] = 1.0
        file["b/daq/serial"] = 12345
    source = open_columns(tmp_path / "x.h5")
    stated = {name: (source.clock(i).rate_hz, source.stated_unit(i)) for i, name in enumerate(source.names)}
    assert stated == {"a": (500.0, ""), "b/v": (1000.0, "mV")}


def test_structures_without_columns_state_what_their_structure_is(tmp_path):
    """As of Testlab, and of people who keep a rate in info.fs."""
    axis = {"start_value": 0.0, "increment": 1e-3}
    content = {
        "s": {"x_values": axis, "y_values": {"values": SIGNAL, "quantity": {"label": "g"}}},
        "a": SIGNAL,
        "b": {"data": np.column_stack([SIGNAL, SIGNAL]), "units": np.array(["g ", "mV"])},
        "D": np.column_stack([SIGNAL, SIGNAL]),
        "D_units": np.array(["g", "mV"], dtype=object),
        "info": {"fs": 500.0},
    }
    scipy.io.savemat(tmp_path / "x.mat", content)
    source = open_columns(tmp_path / "x.mat")
    stated = {name: (source.clock(i).rate_hz, source.stated_unit(i)) for i, name in enumerate(source.names)}
    assert stated == {
        "s.y_values.values": (1000.0, "g"),
        "a": (500.0, ""),
        "b.data:1": (500.0, "g"),
        "b.data:2": (500.0, "mV"),
        "D:1": (500.0, "g"),
        "D:2": (500.0, "mV"),
    }


def test_a_damaged_heap_of_texts_is_refused(tmp_path, refused):
    """HDF5 itself never returns from an object of no index and no size."""
    path = tmp_path / "x.h5"
    with h5py.File(path, "w") as file:
        file["a"] = SIGNAL
        file["a"].attrs["units"] = "g"
    assert open_columns(path).stated_unit(0) == "g"
    content = bytearray(path.read_bytes())
    first = content.index(b"GCOL") + 16
    content[first : first + 2] = bytes(2)
    content[first + 8 : first + 16] = bytes(8)
    path.write_bytes(bytes(content))
    refused(lambda: open_columns(path), found="damaged heap", where="x.h5")


@pytest.fixture(scope="module")
def files_with_statements(tmp_path_factory):
    import soundfile

    folder = tmp_path_factory.mktemp("statements")
    with h5py.File(folder / "x.h5", "w") as file:
        file["a"] = SIGNAL
        file["a"].attrs.update({"units": "g", "fs": 1000.0, "t0": DATE, "scale_factor": 2.0})
        file["t"] = np.arange(20.0)
        file["t"].attrs["units"] = "ms since 2026-01-01"
        file["t"].make_scale("t")
        file["z"] = SIGNAL * 1j
        file["z"].dims[0].attach_scale(file["t"])
        file["rows"] = np.zeros(20, dtype=[("t", "f8"), ("v", "i2")])
        file["g/unit"] = "mV"
    content = {"s": {"a": SIGNAL, "unit": "g", "in": {"z": SIGNAL * 1j}}, "Fs": 5.0, "z": SIGNAL * 1j}
    scipy.io.savemat(folder / "x.mat", content)
    scipy.io.savemat(folder / "packed.mat", content, do_compression=True)
    soundfile.write(folder / "x.flac", SIGNAL, 1000)
    workbook(folder / "x.xlsx", [["fs", 5.0], ["t", "a", "v"], ["s", "g", "V"], *NUMBERS])
    return folder


@pytest.mark.draws(20, 60)
@pytest.mark.parametrize("name", ["x.h5", "x.mat", "packed.mat", "x.flac", "x.xlsx"])
def test_damage_is_read_or_refused(tmp_path, files_with_statements, name, draws):
    content = (files_with_statements / name).read_bytes()
    rng = np.random.default_rng(42)
    refusals = 0
    for _ in range(draws):
        damaged = bytearray(content)
        for place in rng.integers(0, len(damaged), size=4):
            damaged[place] = rng.integers(0, 256)
        end = int(rng.integers(1, len(damaged) + 1)) if rng.random() < 0.3 else len(damaged)
        (tmp_path / name).write_bytes(bytes(damaged[:end]))
        try:
            source = open_columns(tmp_path / name)
            for position in range(len(source.names)):
                file_clock(source, position)
                source.start(position)
            for values in source.load(range(len(source.names))):
                assert (values.ndim, values.dtype) == (1, np.float64)
        except InputError:
            refusals += 1
    assert refusals > 0
