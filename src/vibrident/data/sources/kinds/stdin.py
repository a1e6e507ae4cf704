"""Standard input: CSV or raw float32."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator

from vibrident.data.sources.decoding import MAX_PIECE_BYTES, chunks
from vibrident.data.sources.source import Chunk, Source, SourceRequest


def _open(request: SourceRequest) -> Iterator[Chunk]:
    return chunks(_pieces(), request, request.address or "csv", "standard input")


def _pieces() -> Iterator[bytes]:
    while piece := os.read(sys.stdin.fileno(), MAX_PIECE_BYTES):
        yield piece


STDIN = Source("stdin", "standard input, CSV or float32", _open)
