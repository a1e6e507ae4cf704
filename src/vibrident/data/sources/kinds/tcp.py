"""A TCP connection: CSV, or raw float32 behind ``#float32``."""

from __future__ import annotations

import socket
from collections.abc import Iterator

from vibrident.base.errors import InputError
from vibrident.data.sources.decoding import PIECE, chunks
from vibrident.data.sources.source import Chunk, Source, SourceRequest

CONNECT_TIMEOUT_S = 10.0


def _open(wanted: SourceRequest) -> Iterator[Chunk]:
    address, _, form = wanted.address.partition("#")
    host, _, port = address.rpartition(":")
    if not (host and port.isdecimal() and int(port) < 65536):
        raise InputError(
            "The address cannot be read.",
            expected="HOST:PORT, or HOST:PORT#float32",
            found=repr(wanted.address),
            where="⟦track.source = 'tcp='⟧",
            remedy="give the host's name or address and the number of its port",
        )
    return chunks(_pieces(host, int(port), wanted.idle_s), wanted, form or "csv", address)


def _pieces(host: str, port: int, idle_s: float | None) -> Iterator[bytes]:
    try:
        with socket.create_connection((host, port), timeout=CONNECT_TIMEOUT_S) as connection:
            connection.settimeout(idle_s)
            while piece := connection.recv(PIECE):
                yield piece
    except TimeoutError:
        return  # no data for idle_s: the end of the stream
    except OSError as error:
        raise InputError(
            "There is no connection.",
            expected="a server that sends samples",
            found=error.strerror or str(error),
            where=f"{host}:{port}",
            remedy="start the server first, and check host and port",
        ) from error


TCP = Source("tcp", "a TCP connection to HOST:PORT, CSV or #float32", _open)
