"""Files made to harm: no code of theirs is run, no other file is read, no room is made for what they claim."""

import contextlib
import os
import struct
import tracemalloc

import h5py
import numpy as np
import pytest
import scipy.io
from tests.support.file_formats import uff

from vibrident.base import memory
from vibrident.base.errors import InputError
from vibrident.data.io import read
from vibrident.data.io.reader import open_columns
from vibrident.result import Result

MOST_BYTES = 60_000_000  # what such a file may cost, with all that h5py and pandas need


def load_all(path):
    source = open_columns(path)
    return source.load(range(len(source.names)))


def refused(path, *words):
    """Open and load everything; returns the message of the refusal."""
    tracemalloc.start()
    try:
        with pytest.raises(InputError) as caught:
            load_all(path)
        assert tracemalloc.get_traced_memory()[1] < MOST_BYTES
    finally:
        tracemalloc.stop()
    for word in words:
        assert word in str(caught.value)
    return caught.value


def formula_of(mark):
    """What numexpr's own check lets pass, and what sympy would run where numexpr gives up."""
    return f"X1+sin(*(eval('len(str(open({str(mark)!r},chr(119))))') for y in (1,)))".replace('"', "'")


@pytest.mark.parametrize("where", ["value", "time"])
@pytest.mark.parametrize(("version", "ending"), [("4.10", "mf4"), ("3.30", "mdf")])
def test_a_formula_of_an_mdf_file_is_not_evaluated(tmp_path, monkeypatch, version, ending, where):
    from asammdf import MDF, Signal
    from asammdf.blocks import v2_v3_blocks, v4_blocks

    with MDF(version=version) as file:
        times = np.arange(50) / 1000
        file.append([Signal(np.arange(50.0), times, name=name) for name in ("x", "y")])
        blocks, kind = (v4_blocks, 3) if version >= "4" else (v2_v3_blocks, 10)
        channel = file.groups[0].channels[1 if where == "value" else 0]
        channel.conversion = blocks.ChannelConversion(conversion_type=kind, formula=formula_of(tmp_path / "mark"))
        path = tmp_path / f"a.{ending}"
        file.save(path, overwrite=True)

    def evaluated(*_, **__):
        raise AssertionError("a formula of the file was evaluated")

    for module in (v4_blocks, v2_v3_blocks):
        monkeypatch.setattr(module, "evaluate", evaluated)
        monkeypatch.setattr(module, "lambdify", evaluated)
    if where == "time":
        assert "formula" in str(refused(path))
        return
    source = open_columns(path)
    assert source.names == ("y",)
    np.testing.assert_array_equal(source.load([0])[0], np.arange(50.0))
    with pytest.raises(InputError, match="formula"):
        source.position_of("x", "[response] column")
    assert not (tmp_path / "mark").exists()


def test_a_linear_conversion_of_an_mdf_file_is_done(tmp_path):
    from asammdf import MDF, Signal
    from asammdf.blocks.v4_blocks import ChannelConversion

    with MDF(version="4.10") as file:
        file.append([Signal(np.arange(50, dtype=np.int16), np.arange(50) / 1000, name="x")])
        file.groups[0].channels[1].conversion = ChannelConversion(conversion_type=1, a=0.5, b=3.0)
        file.save(tmp_path / "a.mf4", overwrite=True)
    np.testing.assert_allclose(open_columns(tmp_path / "a.mf4").load([0])[0], 3 + 0.5 * np.arange(50))


HDF5_BOMBS = {
    "fill value": {"shape": (10**9,), "chunks": (10**5,), "fillvalue": 1.0, "dtype": "f8"},
    "one chunk": {"shape": (3 * 10**7,), "chunks": (3 * 10**7,), "compression": "gzip", "dtype": "f8"},
    "wide": {"shape": (10**6, 10**6), "chunks": (10, 10), "dtype": "i1"},
    "bytes": {"shape": (10**9,), "chunks": (10**6,), "dtype": "i1"},
}


@pytest.mark.parametrize("kind", HDF5_BOMBS)
def test_an_hdf5_bomb_is_refused_before_it_grows(tmp_path, kind):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file.create_dataset("a", **HDF5_BOMBS[kind])
    assert (tmp_path / "x.h5").stat().st_size < 10_000
    refused(tmp_path / "x.h5")


def test_what_an_hdf5_file_keeps_elsewhere_is_refused(tmp_path):
    secret = tmp_path / "secret"
    secret.write_bytes(np.arange(50.0).tobytes())
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["a"] = np.arange(50.0)
    layout = h5py.VirtualLayout(shape=(50,), dtype="f8")
    layout[:] = h5py.VirtualSource(tmp_path / "other.h5", "a", shape=(50,))
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file.create_dataset("external", shape=(50,), dtype="f8", external=[(str(secret), 0, h5py.h5f.UNLIMITED)])
        file.create_virtual_dataset("virtual", layout)
        file["link"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "a")
    message = refused(tmp_path / "x.h5")
    assert "another file" in message.found
    assert "virtual" in message.found
    assert "link" not in message.found  # a link is not followed


def test_a_plug_in_of_hdf5_is_not_looked_for(tmp_path):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        steps = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        steps.set_chunk((50,))
        steps.set_filter(32015, h5py.h5z.FLAG_OPTIONAL)
        h5py.h5d.create(file.id, b"a", h5py.h5t.IEEE_F64LE, h5py.h5s.create_simple((50,)), steps)
    refused(tmp_path / "x.h5", "filter 32015", "plug-in")


def test_a_matlab_bomb_is_refused(tmp_path):
    scipy.io.savemat(tmp_path / "x.mat", {"a": np.zeros((10**4, 2000), dtype=np.int8)}, do_compression=True)
    assert (tmp_path / "x.mat").stat().st_size < 50_000
    refused(tmp_path / "x.mat", "more numbers")


def test_a_parquet_bomb_is_refused(tmp_path):
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table({"a": np.zeros(2 * 10**7, dtype=np.int8)}), tmp_path / "x.parquet", compression="zstd")
    assert (tmp_path / "x.parquet").stat().st_size < 100_000
    refused(tmp_path / "x.parquet", "more numbers")


def test_a_header_that_claims_more_than_the_file_holds_is_refused(tmp_path):
    uff(tmp_path / "x.uff", {"a": np.arange(50.0)})
    content = (tmp_path / "x.uff").read_bytes()
    assert content.count(b"        50         1  0.0") == 1
    (tmp_path / "x.uff").write_bytes(content.replace(b"        50         1  0.0", b"2000000000         1  0.0"))
    refused(tmp_path / "x.uff", "2000000000")
    header = bytearray(632 + 200)
    header[0:4] = struct.pack("<f", 0.01)
    header[4 * 79 : 4 * 80] = struct.pack("<i", 2_000_000_000)
    header[4 * 76 : 4 * 77] = struct.pack("<i", 6)
    header[4 * 85 : 4 * 86] = struct.pack("<i", 1)
    header[4 * 105 : 4 * 106] = struct.pack("<i", 1)
    (tmp_path / "x.sac").write_bytes(bytes(header))
    refused(tmp_path / "x.sac")


def test_lines_and_columns_without_end_are_refused(tmp_path):
    (tmp_path / "line.csv").write_bytes(b"1," * 1_000_000)
    refused(tmp_path / "line.csv", "too long")
    (tmp_path / "later.csv").write_bytes(b"1,2\n" * 1000 + b"1," * 1_000_000)
    refused(tmp_path / "later.csv", "too long", "line 1001")
    (tmp_path / "wide.csv").write_text("\n".join(",".join("1" * 1) for _ in range(3)).replace("1", "1," * 20_000 + "1"))
    refused(tmp_path / "wide.csv", "too many columns")


def test_the_limit_can_be_set(tmp_path, monkeypatch):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file.create_dataset("a", shape=(1000,), dtype="f8", fillvalue=1.0)
    assert open_columns(tmp_path / "x.h5").load([0])[0].size == 1000
    monkeypatch.setenv(memory.VARIABLE, "0.001")
    refused(tmp_path / "x.h5", memory.VARIABLE)
    for text in ("many", "inf", "nan", "-1"):
        monkeypatch.setenv(memory.VARIABLE, text)
        refused(tmp_path / "x.h5", "megabytes")


def test_a_long_recording_is_within_the_limit():
    """1 GB of 16-bit samples, or 1.6 million samples compressed to a tenth, with the memory that such a machine has."""
    assert memory.MAX_EXPANSION * 10**9 > 4 * 10**9
    assert memory.ALWAYS_BYTES > 1_600_000 * 8 * 8


@pytest.mark.parametrize("ending", [".xls", ".ods"])
def test_a_spreadsheet_is_to_be_saved_as_csv(tmp_path, ending):
    (tmp_path / f"x{ending}").write_bytes(b"PK\x03\x04")
    assert "CSV" in refused(tmp_path / f"x{ending}", "spreadsheet").remedy


@pytest.mark.parametrize(
    "text",
    [
        "a" + ".a" * 300_000 + " = 1\n",
        "# comment\n" * 200_000,
        "x = {a" + '."a"' * 300 + " = 1}\n",
        "[a" + " . a" * 40 + "]\n",
    ],
    ids=["dotted key", "long", "inline", "header"],
)
def test_a_calibration_file_that_is_slow_to_parse_is_refused(tmp_path, text):
    (tmp_path / "c.toml").write_text(text)
    with pytest.raises(InputError, match="not a calibration file"):
        read(tmp_path / "c.toml")


RESULTS = [
    b"[" * 200_000,
    b'{"schema": "vibrident.result/1", "model": ' + b"9" * 5000 + b"}",
    b'{"schema": "vibrident.result/1", "model": NaN}',
    b'{"schema": ["vibrident.result/1"]}',
    b'{"schema": "vibrident.result/1", "parameters": [1]}',
    b"\xff\xfe{",
    b"",
    b"null",
]


@pytest.mark.parametrize("content", RESULTS)
def test_a_hostile_result_is_bad_input(tmp_path, content):
    (tmp_path / "result.json").write_bytes(content)
    with pytest.raises(InputError):
        Result.load(tmp_path / "result.json")


def test_entities_of_an_mdf_comment_do_not_grow(tmp_path):
    from asammdf import MDF, Signal

    lines = ['<!DOCTYPE x [<!ENTITY a0 "aaaaaaaaaa">']
    lines += [f'<!ENTITY a{n} "{f"&a{n - 1};" * 10}">' for n in range(1, 10)]
    bomb = "<CNcomment><TX>&a9;</TX></CNcomment>".join(("".join(lines) + "]>", ""))
    with MDF(version="4.10") as file:
        file.append([Signal(np.arange(50.0), np.arange(50) / 1000, name="x", comment=bomb)])
        file.header.comment = bomb.replace("CNcomment", "HDcomment")
        file.save(tmp_path / "a.mf4", overwrite=True)
    tracemalloc.start()
    with contextlib.suppress(InputError):
        open_columns(tmp_path / "a.mf4").load([0])
    assert tracemalloc.get_traced_memory()[1] < MOST_BYTES
    tracemalloc.stop()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
@pytest.mark.parametrize("opened", [read, load_all])
def test_a_pipe_is_refused_and_not_waited_for(tmp_path, opened):
    name = tmp_path / ("c.toml" if opened is read else "x.csv")
    os.mkfifo(name)
    with pytest.raises(InputError, match="not a regular file"):
        opened(name)
