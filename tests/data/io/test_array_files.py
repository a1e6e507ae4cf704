"""HDF5, MATLAB and WAV: the right numbers, and a clear word on what is refused."""

import h5py
import numpy as np
import pytest
import scipy.io
import soundfile
from tests.support.sources import ROOT

from vibrident.data.io.columns import Clock
from vibrident.data.io.formats.hdf5 import Hdf5File
from vibrident.data.io.formats.matlab import open_matlab_file
from vibrident.data.io.formats.wav import WavFile
from vibrident.data.io.reader import by_ending, open_columns

SIGNAL = np.linspace(-1, 1, 20)


@pytest.fixture
def hdf5(tmp_path):
    path = tmp_path / "x.h5"
    with h5py.File(path, "w") as file:
        file["run/time"] = np.arange(20) / 100
        file["run/table"] = np.column_stack([SIGNAL, 2 * SIGNAL, 3 * SIGNAL])
        file["run/counts"] = np.arange(20, dtype=np.int16)
        file["run/row"] = SIGNAL[np.newaxis, :]
        file["run/text"] = "a note"
        file["run/words"] = np.array([b"a", b"b"])
        file["run/mixed"] = np.zeros(20, dtype=[("name", "S4"), ("v", "f8", 3)])
        file["run/cube"] = np.zeros((3, 4, 5))
    return Hdf5File(path)


def test_hdf5_columns_by_path_and_number(hdf5):
    (table,) = hdf5.load([hdf5.position_of("run/table:2", "key")])
    np.testing.assert_array_equal(table, 2 * SIGNAL)
    np.testing.assert_array_equal(hdf5.load([hdf5.position_of(3, "key")])[0], 3 * SIGNAL)
    counts, row = hdf5.load([hdf5.position_of("/run/counts", "key"), hdf5.position_of("run/row", "key")])
    np.testing.assert_array_equal(counts, np.arange(20.0))
    assert counts.dtype == np.float64
    np.testing.assert_array_equal(row, SIGNAL)
    assert "array 'run/counts', sample 3" in hdf5.locate(hdf5.position_of("run/counts", "key"), 2)


@pytest.mark.parametrize(
    ("name", "found"),
    [("text", "text"), ("words", "text"), ("mixed", "compound of name, v"), ("cube", "(3, 4, 5)")],
)
def test_hdf5_says_why_a_dataset_is_refused(hdf5, refused, name, found):
    refused(lambda: hdf5.position_of(f"run/{name}", "[response] column"), found=found, where="[response] column")


def test_hdf5_nearest_name(hdf5, refused):
    refused(lambda: hdf5.position_of("run/tabel:2", "key"), remedy="'run/table:2'", expected="'run/time'")


def test_hdf5_samples_run_along_the_longer_axis(tmp_path):
    path = tmp_path / "x.hdf5"
    with h5py.File(path, "w") as file:
        file["data"] = np.vstack([SIGNAL, 2 * SIGNAL])
    source = Hdf5File(path)

    assert source.names == ("data:1", "data:2")
    np.testing.assert_array_equal(source.load([1])[0], 2 * SIGNAL)


def test_hdf5_numbers_need_one_table(tmp_path, refused):
    path = tmp_path / "x.h5"
    with h5py.File(path, "w") as file:
        file["a"] = SIGNAL
        file["b"] = SIGNAL
    refused(lambda: Hdf5File(path).position_of(1, "key"), problem="number", expected="'a', 'b'", remedy="name")


def test_hdf5_damage(tmp_path, refused):
    (tmp_path / "x.h5").write_text("not HDF5")
    refused(lambda: Hdf5File(tmp_path / "x.h5"), where="x.h5")
    refused(lambda: Hdf5File(tmp_path / "none.h5"), found="no file")
    refused(lambda: Hdf5File(tmp_path), where=str(tmp_path))
    with h5py.File(tmp_path / "empty.h5", "w"):
        pass
    refused(lambda: Hdf5File(tmp_path / "empty.h5"), found="no arrays")
    whole = tmp_path / "cut.h5"
    with h5py.File(whole, "w") as file:
        file["a"] = np.zeros(10000)
    whole.write_bytes(whole.read_bytes()[:5000])
    refused(lambda: Hdf5File(whole).load([0]), where="cut.h5")


def test_hdf5_removed_after_opening(tmp_path, refused, hdf5):
    (tmp_path / "x.h5").unlink()
    refused(lambda: hdf5.load([0]), found="no file")


def test_matlab_5(tmp_path, refused):
    path = tmp_path / "x.mat"
    content = {
        "t": np.arange(20.0),
        "data": np.column_stack([SIGNAL, 2 * SIGNAL]),
        "n": np.array([[3.0]]),
        "c": np.array([SIGNAL, "a"], dtype=object),
        "s": {"words": ["a", "b"]},
        "word": "text",
    }
    scipy.io.savemat(path, content)
    source = open_matlab_file(path)

    t, second = source.load([source.position_of("t", "key"), source.position_of(2, "key")])
    np.testing.assert_array_equal(t, np.arange(20.0))
    np.testing.assert_array_equal(second, 2 * SIGNAL)
    for name, kind in (("c", "cell"), ("s.words", "char"), ("word", "char")):
        refused(lambda name=name: source.position_of(name, "key"), found=f"MATLAB {kind}", where="x.mat")


def test_matlab_73(tmp_path, refused):
    path = tmp_path / "x.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["data"] = np.vstack([SIGNAL, 2 * SIGNAL])  # MATLAB writes 20x2 with its axes reversed
        file["data"].attrs["MATLAB_class"] = np.bytes_("double")
        file["word"] = np.arange(4, dtype=np.uint16)
        file["word"].attrs["MATLAB_class"] = np.bytes_("char")
        file["#refs#/a"] = SIGNAL
        file["cells"] = np.array([file["data"].ref], dtype=h5py.ref_dtype)
        file["cells"].attrs["MATLAB_class"] = np.bytes_("cell")
        file["object"] = np.arange(6, dtype=np.uint32)
        file["object"].attrs["MATLAB_object_decode"] = 3
        file["object"].attrs["MATLAB_class"] = np.bytes_("table")
        file["nothing"] = np.zeros(2, dtype=np.uint64)
        file["nothing"].attrs["MATLAB_empty"] = 1
    source = open_matlab_file(path)

    assert source.names == ("data:1", "data:2")
    np.testing.assert_array_equal(source.load([source.position_of(2, "key")])[0], 2 * SIGNAL)
    for name, found in (("word", "char"), ("cells", "cell"), ("object", "table"), ("nothing", "empty")):
        refused(lambda name=name: source.position_of(name, "key"), found=found)


def test_matlab_damage(tmp_path, refused):
    path = tmp_path / "x.mat"
    path.write_bytes(b"MATLAB 5.0 MAT-file" + b"\0" * 200)
    refused(lambda: open_matlab_file(path), where="x.mat")
    refused(lambda: open_matlab_file(tmp_path / "none.mat"), where="none.mat")
    scipy.io.savemat(path, {"word": "text"})
    refused(lambda: open_matlab_file(path), found="'word' is a MATLAB char")
    scipy.io.savemat(path, {"x": np.random.default_rng(1).normal(size=2000)}, do_compression=True)
    path.write_bytes(path.read_bytes()[:-3000])
    refused(lambda: open_matlab_file(path).load([0]), where="x.mat")


@pytest.mark.parametrize(("subtype", "step"), [("PCM_16", 2**-15), ("PCM_24", 2**-23), ("FLOAT", 2**-24)])
def test_wav_full_scale_is_one(tmp_path, subtype, step):
    path = tmp_path / "x.wav"
    soundfile.write(path, np.column_stack([SIGNAL / 2, SIGNAL / 4]), 51200, subtype=subtype)
    source = WavFile(path)

    assert source.clock(0) == Clock(51200.0)
    assert source.names == ("channel 1", "channel 2")
    second, first = source.load([source.position_of(2, "key"), source.position_of("channel 1", "key")])
    np.testing.assert_allclose(first, SIGNAL / 2, rtol=0, atol=step)
    np.testing.assert_allclose(second, SIGNAL / 4, rtol=0, atol=step)
    assert "channel 2, sample 5" in source.locate(1, 4)


def test_wav_damage(tmp_path, refused):
    (tmp_path / "x.wav").write_bytes(b"RIFF and no more")
    refused(lambda: WavFile(tmp_path / "x.wav"), where="x.wav")
    refused(lambda: WavFile(tmp_path / "none.wav"), found="no file")
    refused(lambda: WavFile(tmp_path), found="a folder")
    path = tmp_path / "gone.wav"
    soundfile.write(path, SIGNAL, 100)
    source = WavFile(path)
    path.unlink()
    refused(lambda: source.load([0]), where="gone.wav")


def test_unknown_ending_names_the_known_ones(tmp_path, refused):
    error = refused(lambda: open_columns(tmp_path / "x.ods"), found="'.ods'", where="x.ods")
    assert all(ending in error.expected for ending in by_ending())
    refused(lambda: open_columns(tmp_path / "x"), found="no ending")


def test_every_reader_is_in_the_documentation():
    rows = (ROOT / "docs" / "formats.md").read_text(encoding="utf-8").splitlines()
    for reader in by_ending().values():
        assert any(" ".join(reader.endings) in row and f"`{reader.extra}`" * bool(reader.extra) in row for row in rows)
