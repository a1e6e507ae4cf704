"""A file that grows: what is in it, then what is added."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

from vibrident.base.errors import InputError
from vibrident.data.sources.decoding import MAX_PIECE_BYTES, chunks
from vibrident.data.sources.source import Chunk, Source, SourceRequest

POLL_INTERVAL_S = 0.05


def _open(request: SourceRequest) -> Iterator[Chunk]:
    records = request.calibration.records
    if not request.address and len(records) != 1:
        raise InputError(
            "It is not said which file grows.",
            expected="one [[records]] entry",
            found=str(len(records)),
            where=str(request.file),
            remedy="give ⟦track.source = 'follow=FILE'⟧",
        )
    file = Path(request.address) if request.address else request.file.parent / records[0].file
    form = "float32" if file.suffix.lower() in (".f32", ".raw", ".bin") else "csv"
    first_line = _first_line(file) if request.position and form == "csv" else b""
    return chunks(_pieces(file, request), request, form, str(file), first_line)


def _first_line(file: Path) -> bytes:
    """Return the first line of a file that is resumed, which may name the columns."""
    try:
        with file.open("rb") as stream:
            return stream.readline(MAX_PIECE_BYTES).rstrip(b"\r\n")
    except OSError:
        return b""  # reading its pieces reports the error


def _pieces(file: Path, request: SourceRequest) -> Iterator[bytes]:
    try:
        with file.open("rb") as stream:
            stream.seek(request.position)
            last = time.monotonic()
            while True:
                if piece := stream.read(MAX_PIECE_BYTES):
                    last = time.monotonic()
                    yield piece
                elif request.idle_s is not None and time.monotonic() - last >= request.idle_s:
                    return
                else:
                    if file.stat().st_size < stream.tell():
                        raise InputError(
                            "The file has become shorter.",
                            where=str(file),
                            remedy="begin a new folder",
                        )
                    time.sleep(POLL_INTERVAL_S)
    except OSError as error:
        raise InputError(
            "The file cannot be followed.",
            expected="a file that can be read",
            found=error.strerror or str(error),
            where=str(file),
            remedy="check the name",
        ) from error


FOLLOW = Source(
    "follow",
    "a file that grows: CSV, or raw float32 where it ends in .f32, .raw or .bin",
    _open,
    True,
)
