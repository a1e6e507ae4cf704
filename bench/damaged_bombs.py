"""Small files that declare or unpack far more than a machine holds, and files with cyclic links."""

from __future__ import annotations

import json
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from bench.damaged_files import calibration_text


def _hdf5(**dataset: object) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        import h5py

        with h5py.File(folder / "x.h5", "w") as file:
            for name in ("a", "b"):
                file.create_dataset(name, **dataset)

    return write


def _matlab(folder: Path) -> None:
    import scipy.io

    zeros = np.zeros(20_000_000, dtype=np.int8)
    scipy.io.savemat(folder / "x.mat", {"a": zeros, "b": zeros}, do_compression=True)


def _matlab_tag(folder: Path) -> None:
    """Return a variable of a few values whose data unpack to 2 GB of zeros."""
    packer = zlib.compressobj(9)
    header = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    inner = b"".join(
        np.array(words, dtype="<u4").tobytes()
        for words in (
            [14, 1_000_000_048],
            [6, 8],
            [6, 0],
            [5, 8],
            [1, 50],
            [1 | 1 << 16, ord("a")],
            [9, 1_000_000_000],
        )
    )
    packed = (
        packer.compress(inner)
        + b"".join(packer.compress(bytes(1 << 22)) for _ in range(240))
        + packer.flush()
    )
    (folder / "x.mat").write_bytes(
        header + np.array([15, len(packed)], dtype="<u4").tobytes() + packed
    )


def _parquet(folder: Path) -> None:
    import pyarrow
    import pyarrow.parquet

    zeros = np.zeros(30_000_000, dtype=np.int8)
    pyarrow.parquet.write_table(
        pyarrow.table({"a": zeros, "b": zeros}), folder / "x.parquet", compression="zstd"
    )


def _mdf(folder: Path) -> None:
    from asammdf import MDF, Signal

    with MDF(version="4.10") as file:
        times = np.arange(20_000_000) / 1000.0
        file.append(
            [Signal(np.zeros(times.size, dtype=np.int8), times, name=name) for name in ("a", "b")]
        )
        file.save(folder / "x.mf4", overwrite=True, compression=2)


def _mdf_circle(folder: Path) -> None:
    """The last channel group of the list is followed by the first."""
    from asammdf import MDF, Signal

    with MDF(version="4.10") as file:
        for name in ("a", "b"):
            file.append([Signal(np.arange(50.0), np.arange(50) / 1000.0, name=name)])
        file.save(folder / "x.mf4", overwrite=True)
    content = bytearray((folder / "x.mf4").read_bytes())
    first = int.from_bytes(content[0x40 + 24 : 0x40 + 32], "little")
    content[first + 24 : first + 32] = first.to_bytes(8, "little")
    (folder / "x.mf4").write_bytes(bytes(content))


def _text(name: str, content: Callable[[], bytes]) -> Callable[[Path], None]:
    def write(folder: Path) -> None:
        (folder / name).write_bytes(content())

    return write


def _wav(folder: Path) -> None:
    import soundfile

    soundfile.write(folder / "x.wav", np.zeros((100, 2)), 1000)
    content = bytearray((folder / "x.wav").read_bytes())
    start = content.index(b"data") + 4
    content[start : start + 4] = content[4:8] = (0xFFFFFFF0).to_bytes(4, "little")
    content[22:24] = (1000).to_bytes(2, "little")
    (folder / "x.wav").write_bytes(bytes(content))


#: What it is called in the table → file that a command is given, and what writes it and its like.
BOMBS: Mapping[str, tuple[str, Callable[[Path], None]]] = {
    "HDF5, fill value": ("x.h5", _hdf5(shape=(10**9,), chunks=(10**6,), dtype="f8", fillvalue=1.0)),
    "HDF5, one chunk": (
        "x.h5",
        _hdf5(shape=(10**8,), chunks=(10**8,), dtype="f8", compression="gzip"),
    ),
    "HDF5, bytes": ("x.h5", _hdf5(shape=(2**40,), chunks=(10**6,), dtype="i1")),
    "HDF5, a million columns": ("x.h5", _hdf5(shape=(10**6, 10**6), chunks=(10, 10), dtype="f4")),
    "MATLAB, zeros packed": ("x.mat", _matlab),
    "MATLAB, 1 GB in a tag": ("x.mat", _matlab_tag),
    "Parquet, zeros packed": ("x.parquet", _parquet),
    "MDF, zeros packed": ("x.mf4", _mdf),
    "MDF, a circle of links": ("x.mf4", _mdf_circle),
    "WAV, 4 GB in the header": ("x.wav", _wav),
    "CSV, one endless line": ("x.csv", _text("x.csv", lambda: b"1," * 25_000_000)),
    "CSV, endless later": ("x.csv", _text("x.csv", lambda: b"1,2,3\n" * 2000 + b"1," * 25_000_000)),
    "CSV, 50 000 columns": ("x.csv", _text("x.csv", lambda: (b"1," * 50_000 + b"1\n") * 20)),
    "CSV, quotes": ("x.csv", _text("x.csv", lambda: b't,a,b\n"' + b"1,2,3\n" * 1_000_000)),
    "CSV, digits": (
        "x.csv",
        _text("x.csv", lambda: b"t,a,b\n" + (b"1," + b"9" * 5000 + b",3\n") * 200),
    ),
    "TOML, dotted key": ("c.toml", _text("c.toml", lambda: b"a" + b".a" * 400_000 + b" = 1\n")),
    "TOML, 5.7 MB": ("c.toml", _text("c.toml", lambda: b"k = [" + b"1, " * 1_900_000 + b"]\n")),
    "TOML, brackets": ("c.toml", _text("c.toml", lambda: b"a = " + b"[" * 100_000)),
    "TOML, a million records": ("c.toml", _text("c.toml", lambda: b"[[records]]\n" * 80_000)),
    "JSON, brackets": ("result.json", _text("result.json", lambda: b"[" * 1_000_000)),
    "JSON, 30 MB": (
        "result.json",
        _text("result.json", lambda: json.dumps([0] * 10_000_000).encode()),
    ),
    "JSON, digits": ("result.json", _text("result.json", lambda: b"9" * 1_000_000)),
    "a device": ("x.csv", lambda folder: (folder / "x.csv").symlink_to("/dev/zero")),
    "a pipe": ("x.csv", lambda folder: __import__("os").mkfifo(folder / "x.csv")),
    "a folder": ("x.h5", lambda folder: (folder / "x.h5").mkdir()),
}


_TEXT = ("CSV", "TOML", "JSON", "a ")
#: The same in two groups.
GROUPS: Mapping[str, tuple[str, ...]] = {
    "binary": tuple(name for name in BOMBS if not name.startswith(_TEXT)),
    "text": tuple(name for name in BOMBS if name.startswith(_TEXT)),
}


def write_bomb(folder: Path, name: str) -> Path:
    """Write one of them and its companions; returns the argument of the command."""
    file, write = BOMBS[name]
    write(folder)
    if file in ("c.toml", "result.json"):
        return folder / file
    (folder / "c.toml").write_text(calibration_text(file))
    return folder / "c.toml"
