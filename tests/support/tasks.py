"""What a worker is given to do in tests: a module of its own, which loads nothing that takes long."""

from __future__ import annotations

import os
import signal
import socket
import sys
from pathlib import Path

from vibrident.base.errors import InputError, NotConverged


def refused() -> None:
    raise InputError("x" * 200_000, expected="less")


def not_converged() -> None:
    raise NotConverged("no optimum")


def broken() -> None:
    raise KeyError("a bug")


def killed() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def priority() -> int:
    return os.nice(0)


def talkative() -> None:
    sys.stderr.write("z" * 1_000_000 + "the end")
    sys.stderr.flush()
    os._exit(3)


def hungry() -> None:
    bytearray(1 << 46)


def two_steps(last: float, *, progress) -> None:
    for iteration in (1, 2):
        progress(iteration, 9, last / iteration)


def names_in(folder: str) -> list[str]:
    """Names of what a folder holds."""
    return sorted(os.listdir(folder))


def written(name: str) -> None:
    """An empty file."""
    Path(name).touch()


def reached(port: int) -> None:
    """A connection to this machine."""
    socket.create_connection(("127.0.0.1", port), timeout=5).close()
