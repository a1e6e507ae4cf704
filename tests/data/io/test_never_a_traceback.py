"""Whatever the bytes are: a reader reads them or raises InputError, nothing else."""

import contextlib

import h5py
import numpy as np
import pytest
import scipy.io
import soundfile
from hypothesis import example, given, settings
from hypothesis import strategies as st

from vibrident.base.errors import InputError
from vibrident.data.io import read
from vibrident.data.io.reader import open_columns


def read_all(path) -> None:
    with contextlib.suppress(InputError):
        source = open_columns(path)
        for values in source.load(range(len(source.names))):
            assert values.ndim == 1
            assert values.dtype == np.float64


cells = st.sampled_from(
    ["1", "-2.5", "+3,5", "1e5", "nan", "", " ", "x", '"', '"1"', "#", "%", "2014-07-30", "\x1a", "µ"]
)
glue = st.sampled_from([",", ";", "\t", " ", "\n", "\n", "\r\n", "\r"])
texts = st.lists(st.tuples(cells, glue), max_size=40).map(lambda parts: "".join(a + b for a, b in parts).encode())


@settings(derandomize=True, max_examples=400, deadline=None)
@given(st.one_of(st.binary(max_size=200), texts))
@example(b"\xef\xbb\xbf")
@example(b"1\x00")
@example(b'"1,2\n3,4\n')
def test_csv(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "noise.csv"
    path.write_bytes(content)
    read_all(path)


@pytest.fixture(scope="module")
def whole_files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    signal = np.linspace(-1, 1, 300)
    with h5py.File(folder / "x.h5", "w") as file:
        file.create_dataset("a", data=signal, compression="gzip")
        file["b/c"] = np.column_stack([signal, signal])
    scipy.io.savemat(folder / "x.mat", {"a": signal, "b": np.column_stack([signal, signal])}, do_compression=True)
    soundfile.write(folder / "x.wav", signal, 1000)
    return folder


@pytest.mark.parametrize("name", ["x.h5", "x.mat", "x.wav"])
def test_damaged_binary_files(tmp_path, whole_files, name):
    content = (whole_files / name).read_bytes()
    rng = np.random.default_rng(20240506)
    for _ in range(60):
        damaged = bytearray(content)
        for place in rng.integers(0, len(damaged), size=4):
            damaged[place] = rng.integers(0, 256)
        cut = int(rng.integers(1, len(damaged) + 1)) if rng.random() < 0.5 else len(damaged)
        path = tmp_path / name
        path.write_bytes(bytes(damaged[:cut]))
        read_all(path)


@settings(derandomize=True, max_examples=200, deadline=None)
@given(st.binary(max_size=100))
@example(b"a = " + b"[" * 5000)
@example(b'[table]\nfile = "a\\u0000.csv"\nfrequency = 1\nmagnitude = 1\n')
@example(b'[table]\nfile = "' + b"a" * 5000 + b'.csv"\nfrequency = 1\nmagnitude = 1\n')
@example(b"[response]\ncolumn = 1\nscale = 1" + b"0" * 400 + b"\n")
@example(b'[response]\ncolumn=1\n[[records]]\nfile = "' + b"[a]" * 2000 + b'.csv"\nexcitation = "decay"\n')
def test_calibration_file(tmp_path_factory, content):
    path = tmp_path_factory.getbasetemp() / "noise.toml"
    path.write_bytes(content)
    with pytest.raises(InputError):
        read(path)
