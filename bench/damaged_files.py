"""Files of every format, whole and damaged."""

from __future__ import annotations

import gzip
import struct
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
RATE_HZ = 2000.0
SAMPLES = 600
Bytes = Callable[[bytes, np.random.Generator], bytes]


def signals() -> dict[str, np.ndarray]:
    """Return a sine of 100 Hz, and an accelerometer's response."""
    times = np.arange(SAMPLES) / RATE_HZ
    rng = np.random.default_rng(9)
    motion = 10 * np.sin(2 * np.pi * 100 * times) + 0.01 * rng.standard_normal(SAMPLES)
    return {"a": motion, "b": 0.01 * motion + 1e-4 * rng.standard_normal(SAMPLES)}


def _text(path: Path) -> None:
    columns = signals()
    rows = (
        f"{k / RATE_HZ:.9g},{a:.9g},{b:.9g}"
        for k, (a, b) in enumerate(zip(columns["a"], columns["b"], strict=True))
    )
    path.write_text("t,a,b\n" + "\n".join(rows) + "\n")


def _hdf5(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        for name, values in signals().items():
            file.create_dataset(name, data=values, chunks=(200,), compression="gzip")


def _matlab(path: Path) -> None:
    import scipy.io

    scipy.io.savemat(path, signals(), do_compression=True)


def _wav(path: Path) -> None:
    import soundfile

    soundfile.write(
        path, 0.05 * np.column_stack([*signals().values()]), int(RATE_HZ), subtype="PCM_24"
    )


def _library(path: Path) -> None:
    from tests.support import file_formats as formats

    writer = next(writer for name, writer in formats.WRITERS.items() if name.endswith(path.suffix))
    writer(path, signals(), RATE_HZ)


#: File name to what writes it whole. A SAC file holds one channel, so its calibration has two.
WRITERS: Mapping[str, Callable[[Path], None]] = {
    "x.csv": _text,
    "x.h5": _hdf5,
    "x.mat": _matlab,
    "x.wav": _wav,
    **{
        f"x.{ending}": _library
        for ending in ("tdms", "uff", "mseed", "sac", "mf4", "mdf", "parquet")
    },
}
#: Column of reference and response by format; names where numbers have no meaning.
_COLUMNS = {"x.csv": (2, 3), "x.h5": ('"a"', '"b"'), "x.mat": ('"a"', '"b"')}


def calibration_text(name: str) -> str:
    """Return the calibration file of such a data file."""
    reference, response = _COLUMNS.get(name, (1, 1 if name == "x.sac" else 2))
    rate = "" if name not in ("x.csv", "x.h5", "x.mat") else f"[sampling]\nrate_hz = {RATE_HZ}\n"
    return (
        f'[sensor]\nmodel = "accelerometer"\n[reference]\ncolumn = {reference}\n'
        f"[response]\ncolumn = {response}\n{rate}"
        f'[[records]]\nfile = "{name}"\nexcitation = "sine"\nfrequency_hz = 100.0\n'
    )


def _cut(content: bytes, rng: np.random.Generator) -> bytes:
    return content[: int(len(content) * rng.uniform(0, 1))]


def _flipped(content: bytes, rng: np.random.Generator) -> bytes:
    """Return a few bits anywhere, or many at the head, where the structure is."""
    damaged = bytearray(content)
    reach = len(damaged) if rng.random() < 0.5 else min(len(damaged), 512)
    for offset in rng.integers(0, reach, size=int(rng.choice([1, 3, 30]))):
        damaged[offset] ^= 1 << int(rng.integers(0, 8))
    return bytes(damaged)


def _reordered(content: bytes, rng: np.random.Generator) -> bytes:
    size = int(rng.choice([1, 16, 512]))
    pieces = [content[k : k + size] for k in range(0, len(content), size)]
    first, second = sorted(rng.integers(0, len(pieces), size=2))
    return b"".join(pieces[:first] + pieces[second:] + pieces[first:second])


def _encoded(content: bytes, rng: np.random.Generator) -> bytes:
    """Change the encoding: UTF-16, Latin-1, line ends, packed, doubled, byte-order mark."""
    kinds = (
        lambda: content.decode("latin-1").encode("utf-16"),
        lambda: content.decode("latin-1").encode("utf-8"),
        lambda: content.replace(b"\n", b"\r\n"),
        lambda: content.replace(b"\n", b"\r"),
        lambda: gzip.compress(content),
        lambda: content + content,
        lambda: b"\xef\xbb\xbf" + content,
        lambda: content.replace(b"0", b"9"),
        lambda: content.replace(b".", b","),
        lambda: bytes(reversed(content)),
    )
    return kinds[int(rng.integers(0, len(kinds)))]()


def _large_numbers(content: bytes, rng: np.random.Generator) -> bytes:
    """Put extremes in place of a few aligned integers, most of them of the head."""
    damaged = bytearray(content)
    for _ in range(int(rng.choice([1, 2, 5]))):
        kind, value = [
            ("<I", 0xFFFFFFFF),
            ("<I", 0x7FFFFFFF),
            ("<Q", 1 << 40),
            ("<d", 1e300),
            ("<i", -1),
            ("<d", np.nan),
        ][int(rng.integers(0, 6))]
        size = struct.calcsize(kind)
        if len(damaged) <= size:
            continue
        reach = len(damaged) - size if rng.random() < 0.3 else min(len(damaged) - size, 1024)
        offset = int(rng.integers(0, reach + 1)) // 4 * 4
        damaged[offset : offset + size] = struct.pack(kind, value)
    return bytes(damaged)


DAMAGES: Mapping[str, Bytes] = {
    "cut": _cut,
    "bits flipped": _flipped,
    "reordered": _reordered,
    "re-encoded": _encoded,
    "large numbers": _large_numbers,
}


def write_damaged(
    folder: Path, name: str, damage: str, seed: int, undamaged: Mapping[str, bytes]
) -> Path:
    """Write one damaged file and its companions; returns the argument of the command."""
    rng = np.random.default_rng([seed, *damage.encode(), *name.encode()])
    target = folder / name
    target.write_bytes(DAMAGES[damage](undamaged[name], rng))
    if name in ("c.toml", "result.json"):
        (folder / "x.csv").write_bytes(undamaged["x.csv"])
        return target
    (folder / "c.toml").write_text(calibration_text(name))
    return folder / "c.toml"


def whole_files(folder: Path) -> dict[str, bytes]:
    """Return every data file undamaged, and a calibration file."""
    for name, write in WRITERS.items():
        write(folder / name)
    (folder / "c.toml").write_text(calibration_text("x.csv"))
    return {name: (folder / name).read_bytes() for name in (*WRITERS, "c.toml")}


def whole_result(folder: Path) -> bytes:
    """Return the result of the text file."""
    from vibrident import identify
    from vibrident.data.io import read

    _text(folder / "x.csv")
    (folder / "c.toml").write_text(calibration_text("x.csv"))
    return (
        identify(read(folder / "c.toml"), estimator="lsm").save(folder / "result.json").read_bytes()
    )
