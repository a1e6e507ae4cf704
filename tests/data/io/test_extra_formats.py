"""TDMS, UFF 58, miniSEED, SAC, MDF and Parquet: the right numbers at the right rate, and a clear word on the rest."""

import gc
import shutil
import sys

import numpy as np
import pytest
from tests.support import file_formats as formats

from vibrident.base.errors import InputError
from vibrident.data.io import read
from vibrident.data.io.clocks import file_clock
from vibrident.data.io.reader import open_columns
from vibrident.data.io.sampling import plainest_clock

LIBRARIES = {
    "x.tdms": ("nptdms", "tdms"),
    "x.uff": ("pyuff", "uff"),
    "x.mseed": ("obspy", "seismic"),
    "x.sac": ("obspy", "seismic"),
    "x.mf4": ("asammdf", "mdf"),
    "x.mdf": ("asammdf", "mdf"),
    "x.parquet": ("pyarrow", "parquet"),
}
TIME = np.arange(5000) / formats.RATE_HZ
#: Single precision: what SAC can hold.
SIGNALS = {
    "REF": np.sin(2 * np.pi * 160 * TIME).astype(np.float32),
    "RSP": np.cos(2 * np.pi * 160 * TIME).astype(np.float32),
}
everywhere = pytest.mark.parametrize("name", formats.WRITERS)


def written(folder, name, channels=SIGNALS, **options):
    pytest.importorskip(LIBRARIES[name][0]) if LIBRARIES[name][0] != "obspy" else formats.stream({})
    path = folder / name
    formats.WRITERS[name](path, channels, **options)
    return path


def calibration(folder, file, *, reference: object = 1, response: object = 2, more="", record=""):
    path = folder / "calibration.toml"
    path.write_text(
        f'[reference]\ncolumn = {reference!r}\nunit = "m/s^2"\nscale = 1.0\n[response]\ncolumn = {response!r}\n{more}\n'
        f'[[records]]\nfile = "{file}"\nexcitation = "sine"\n{record}\n',
        encoding="utf-8",
    )
    return path


@everywhere
def test_round_trip_at_102400_hz(tmp_path, name):
    source = open_columns(written(tmp_path, name))

    assert file_clock(source, 0).rate_hz == pytest.approx(102400.0, rel=1e-9, abs=0)
    for position, expected in zip(range(len(source.names)), SIGNALS.values(), strict=False):
        (values,) = source.load([position])
        assert values.dtype == np.float64
        np.testing.assert_array_equal(values, expected)
    assert len(source.names) == (1 if name == "x.sac" else 2)


@pytest.mark.parametrize("rate_hz", [51200.0, 44100.0, 65536.0, 96000.0, 25600.0, 200.0, 100.0, 0.5])
@everywhere
def test_the_rate_is_that_of_the_writer(tmp_path, name, rate_hz):
    source = open_columns(written(tmp_path, name, rate_hz=rate_hz))
    assert file_clock(source, 0).rate_hz == pytest.approx(rate_hz, rel=1e-9, abs=0)


@everywhere
def test_channels_by_name_and_number(tmp_path, name):
    source = open_columns(written(tmp_path, name))
    for number, channel in enumerate(source.names, start=1):
        assert source.position_of(channel, "key") == source.position_of(number, "key") == number - 1
    assert "sample 5" in source.locate(0, 4)
    assert source.names[0] in source.locate(0, 4)


@everywhere
def test_without_the_library_the_message_has_the_install_line(tmp_path, refused, monkeypatch, name):
    library, extra = LIBRARIES[name]
    (tmp_path / name).write_bytes(b"anything")
    for module in (*(found for found in sys.modules if found.split(".")[0] == library), library):
        monkeypatch.setitem(sys.modules, module, None)
    refused(lambda: open_columns(tmp_path / name), expected=library, where=name, remedy=f"'vibrident[{extra}]'")


@everywhere
def test_a_calibration_takes_the_rate_of_the_file_and_one_beside_it_must_agree(tmp_path, refused, name):
    path = written(tmp_path, name)
    columns = {"reference": 1, "response": 2}
    if name == "x.sac":  # a channel a file
        shutil.copy(path, tmp_path / "reference.sac")
        columns = {"reference": 1, "response": 1, "record": 'reference_file = "reference.sac"'}
    (record,) = read(calibration(tmp_path, name, **columns)).records
    assert record.sampling_rate_hz == pytest.approx(102400.0, rel=1e-9, abs=0)
    np.testing.assert_array_equal(record.reference, SIGNALS["REF"].astype(float))
    agreeing = calibration(tmp_path, name, more="[sampling]\nrate_hz = 102400.0", **columns)
    assert read(agreeing).records[0].sampling_rate_hz == 102400.0
    other = calibration(tmp_path, name, more="[sampling]\nrate_hz = 102500.0", **columns)
    refused(lambda: read(other), problem="sampling rate", expected="102400", found="102500", remedy="rate_hz")


@pytest.mark.parametrize("name", ["x.uff", "x.sac"])
def test_a_rate_within_the_rounding_of_the_file_is_the_better_one(tmp_path, name):
    path = written(tmp_path, name)
    columns = {"reference": 1, "response": 2}
    if name == "x.sac":  # a channel a file
        shutil.copy(path, tmp_path / "reference.sac")
        columns = {"reference": 1, "response": 1, "record": 'reference_file = "reference.sac"'}
    stated = 102400.0 * (1 + 1e-8)
    (record,) = read(calibration(tmp_path, name, more=f"[sampling]\nrate_hz = {stated!r}", **columns)).records
    assert record.sampling_rate_hz == stated
    (record,) = read(calibration(tmp_path, name, **columns)).records
    assert any("sampling rate" in step and "relative" in step for step in record.provenance.history)


@pytest.fixture
def little_to_collect():
    """A reader that fails looks for garbage, which among all that other tests have loaded takes half a second."""
    gc.collect()
    gc.freeze()


@everywhere
@pytest.mark.usefixtures("little_to_collect")
def test_damage_is_one_message(tmp_path, name):
    path = written(tmp_path, name)
    content = path.read_bytes()
    rng = np.random.default_rng(58)
    damaged = [b"", b"junk" * 200, *(content[: int(part * len(content))] for part in (0.01, 0.1, 0.5, 0.9))]
    for _ in range(10):
        noisy = bytearray(content)
        for place in rng.integers(0, min(len(noisy), 3000), 20):
            noisy[place] = rng.integers(256)
        damaged.append(bytes(noisy))
    where = []
    for piece in damaged:
        path.write_bytes(piece)
        try:
            source = open_columns(path)
            for position in range(len(source.names)):
                file_clock(source, position)
            for values in source.load(range(len(source.names))):
                assert (values.ndim, values.dtype) == (1, np.float64)
        except InputError as error:
            where.append(error.where)
    assert len(where) >= 2
    assert all(name in place for place in where)


@everywhere
def test_files_that_are_not_there(tmp_path, refused, name):
    path = written(tmp_path, name)
    source = open_columns(path)
    path.unlink()
    refused(lambda: source.load([0]), where=name)
    refused(lambda: open_columns(path), found="no file")
    path.mkdir()
    refused(lambda: open_columns(path), found="a folder")


@pytest.mark.parametrize(
    ("text", "half_unit", "rate_hz"),
    [
        ("9.76562e-06", 5e-12, 102400.0),  # C's %13.5e
        ("9.7656e-06", 5e-11, 102400.0),  # FORTRAN's E13.5
        ("1.22070e-04", 5e-10, 8192.0),
        ("3e-05", 1e-12, 1 / 3e-5),  # an interval plainer than its rate
        ("10", 1e-6, 0.1),
        ("1.00000e-05", 5e-11, 100000.0),
    ],
)
def test_the_plainest_rate_within_the_rounding(text, half_unit, rate_hz):
    clock = plainest_clock(float(text), half_unit)
    assert clock.rate_hz == pytest.approx(rate_hz, rel=1e-12)
    assert abs(1 / clock.rate_hz - float(text)) <= half_unit * (1 + 1e-6)


def test_single_precision_of_every_whole_rate_below_a_megahertz():
    """A whole number of Hz comes back from a four-byte interval, whatever it is."""
    rng = np.random.default_rng(4)
    for rate_hz in rng.integers(1, 200_000, 2000).astype(float):
        delta = np.float32(1 / rate_hz)
        clock = plainest_clock(float(delta), float(np.spacing(delta)) / 2)
        assert abs(clock.rate_hz - rate_hz) <= clock.rate_rounding * rate_hz * 1.01


def test_tdms_refuses_what_is_no_signal_and_an_unfinished_file(tmp_path, refused):
    nptdms = pytest.importorskip("nptdms")
    path = tmp_path / "x.tdms"
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(
            [
                nptdms.ChannelObject("g", name, values)
                for name, values in {"v": TIME, "words": ["a"], "z": TIME * 1j}.items()
            ]
        )
    source = open_columns(path)
    assert source.names == ("g/v",)
    assert file_clock(source, 0) is None
    refused(lambda: source.position_of("g/words", "[response] column"), found="text", where="[response] column")
    refused(lambda: source.position_of("g/z", "key"), found="complex")
    path.write_bytes(path.read_bytes()[:-1000])
    refused(lambda: open_columns(path), found="cut short", remedy="whole")


def test_channels_that_begin_apart_are_aligned(tmp_path):
    """By whole samples they are cut, by a fraction resampled; by the same they are as they stand."""
    path = written(tmp_path, "x.tdms")
    samples = {}
    for apart in (0.0, 3.0, 0.5):
        delays = {"RSP": 0.001 + apart / formats.RATE_HZ, "REF": 0.001}
        formats.tdms(path, SIGNALS, delays_s=delays)
        (record,) = read(calibration(tmp_path, "x.tdms")).records
        samples[apart] = record.samples
        is_resampled = any("resampled" in step for step in record.provenance.history)
        assert is_resampled == (apart == 0.5)
    assert (samples[0.0], samples[3.0]) == (5000, 4997)
    assert 4700 < samples[0.5] < 5000


@pytest.mark.parametrize(("binary", "precision"), [(0, 2), (0, 4), (1, 4)])
@pytest.mark.parametrize("even", [True, False])
def test_uff_in_text_and_binary(tmp_path, binary, precision, even):
    pytest.importorskip("pyuff")
    path = tmp_path / "x.unv"
    signals = {"REF": np.sin(7 * TIME), "RSP": -0.5 * np.arange(5000.0)}
    formats.uff(path, signals, binary=binary, double=precision == 4, even=even)
    source = open_columns(path)
    for values, expected in zip(source.load([0, 1]), signals.values(), strict=True):
        np.testing.assert_allclose(values, expected, rtol=1e-5 if precision == 2 else 1e-11, atol=1e-12)
    clock = file_clock(source, 0)
    assert abs(clock.rate_hz / formats.RATE_HZ - 1) <= clock.rate_rounding < 1e-4


def test_uff_of_another_length_than_its_header_says(tmp_path, refused):
    """pyuff itself writes doubles into binary sets whose header says single precision."""
    pytest.importorskip("pyuff")
    formats.uff(tmp_path / "x.uff", {"REF": TIME}, double=False)
    refused(lambda: open_columns(tmp_path / "x.uff").load([0]), found="10000 values where it states 5000")


def test_uff_names_and_refusals(tmp_path, refused):
    pytest.importorskip("pyuff")
    path = tmp_path / "x.uff"
    formats.uff(path, {"NONE": TIME})
    assert open_columns(path).names == ("7:-Z",)
    formats.uff(path, {"H": TIME}, func_type=2)
    refused(lambda: open_columns(path), found="function type 2")
    formats.uff(path, {"H": TIME}, func_type=4)
    refused(lambda: open_columns(path), found="frequency response over time")
    formats.uff(path, {"H": TIME}, abscissa_spec_data_type=18)
    refused(lambda: open_columns(path), found="over frequency")
    formats.uff(path, {"H": TIME * 1j})
    refused(lambda: open_columns(path), found="complex")


def test_miniseed_joins_records_and_refuses_gaps(tmp_path, refused):
    traces = formats.stream(SIGNALS)
    late = traces[0].copy()
    traces[0].data = traces[0].data[:2000]
    late.data = late.data[2000:]
    for missing, usable in ((0, True), (3, False), (-3, False)):
        late.stats.starttime = traces[0].stats.starttime + (2000 + missing) / formats.RATE_HZ
        path = tmp_path / f"{missing}.mseed"
        formats.write_seismic(traces[:0].extend([*traces, late]), path, "MSEED")
        source = open_columns(path)
        assert ("XX.T..REF" in source.names) == usable
        if usable:
            np.testing.assert_array_equal(source.load([source.position_of("XX.T..REF", "key")])[0], SIGNALS["REF"])
        else:
            word = "a gap of 3" if missing > 0 else "an overlap of 3"
            refused(lambda source=source: source.position_of("XX.T..REF", "key"), found=word)


def test_sac_in_two_files(tmp_path):
    for name, values in SIGNALS.items():
        formats.sac(tmp_path / f"{name}.sac", {name: values})
    toml = calibration(tmp_path, "RSP.sac", response="XX.T..RSP", record='reference_file = "REF.sac"')
    (record,) = read(toml).records
    assert record.sampling_rate_hz == pytest.approx(102400.0, rel=1e-9, abs=0)
    np.testing.assert_array_equal(record.response, SIGNALS["RSP"].astype(float))


def test_mdf_time_stamps_text_and_invalid_samples(tmp_path, refused):
    asammdf = pytest.importorskip("asammdf")
    path = tmp_path / "x.mf4"
    invalid = np.zeros(5000, dtype=bool)
    invalid[10] = True
    broken = TIME.copy()
    broken[100:] += 0.01
    with asammdf.MDF(version="4.10") as file:
        file.append(
            [
                asammdf.Signal(SIGNALS["REF"], TIME, name="a", invalidation_bits=invalid),
                asammdf.Signal(np.array([b"word"] * 5000), TIME, name="text", encoding="utf-8"),
            ]
        )
        file.append([asammdf.Signal(SIGNALS["RSP"], np.round(TIME, 6), name="stamped to 1 µs")])
        file.append([asammdf.Signal(SIGNALS["RSP"], broken, name="gap")])
        file.save(path, overwrite=True)
    source = open_columns(path)
    assert source.names == ("a", "stamped to 1 µs", "gap")
    (values,) = source.load([0])
    assert np.flatnonzero(np.isnan(values)).tolist() == [10]
    refused(lambda: source.position_of("text", "key"), found="text")
    assert file_clock(source, 2).rate_hz == pytest.approx(102400.0, rel=1e-4)  # with a hole of 1,024
    rounded = file_clock(source, 1)
    assert abs(rounded.rate_hz / 102400.0 - 1) <= rounded.rate_rounding < 1e-3
    assert rounded.rate_rounding > 1e-9


def test_parquet_time_stamps_types_and_metadata(tmp_path, refused):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    path = tmp_path / "x.parquet"
    nanoseconds = np.round(TIME * 1e9).astype("int64") + np.datetime64(formats.START, "ns").astype("int64")
    columns = {
        "stamp": pyarrow.array(nanoseconds.astype("datetime64[ns]")),
        "counts": np.arange(5000, dtype=np.int16),
        "more": np.arange(5000, dtype=np.int16),
        "v": pyarrow.array([1.0, None] * 2500),
        "word": ["a"] * 5000,
        "pair": [[1.0, 2.0]] * 5000,
    }
    parquet.write_table(pyarrow.table(columns), path)
    source = open_columns(path)
    assert source.names == ("stamp", "counts", "more", "v")
    assert file_clock(source, 0) is None
    counts, v = source.load([1, 3])
    np.testing.assert_array_equal(counts, np.arange(5000.0))
    assert np.isnan(v[1])
    refused(lambda: source.position_of("word", "key"), found="string")
    refused(lambda: source.position_of("pair", "key"), found="list")
    more = '[sampling]\ntime_column = "stamp"'
    (record,) = read(calibration(tmp_path, path.name, reference="counts", response="more", more=more)).records
    assert record.sampling_rate_hz == pytest.approx(102400.0, rel=1e-9, abs=0)
    refused(lambda: read(calibration(tmp_path, path.name, reference="counts", response="v", more=more)), where="'v'")
    parquet.write_table(pyarrow.table({"v": TIME}).replace_schema_metadata({"sampling_rate_hz": "fast"}), path)
    refused(lambda: open_columns(path), found="'fast'", where="'v'")
