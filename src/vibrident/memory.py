"""Memory: how much reading a file may take, and what was freed given back to the system."""

from __future__ import annotations

import contextlib
import ctypes
import math
import os

#: Environment variable with the most megabytes that the numbers of a file may take; it stands for all rules below.
VARIABLE = "VIBRIDENT_MEMORY_MB"
#: A small file may hold this much, however well it is compressed: 16 million samples.
ALWAYS_BYTES = 128 << 20
#: Beyond it, numbers may take so many times the size of their file. Compression of measured signals gains a factor of
#: ten at most, and float64 takes four times the room of the usual 16 bit.
EXPANSION = 64
#: Of the memory that is free, for the numbers of one file: as much again is needed to scale them, and for the rest.
_SHARE_OF_FREE = 1 / 3
_MEGABYTE = 1_000_000


def give_back() -> None:
    """Give freed memory back, where the C library can: a compiler or a large file leaves hundreds of megabytes."""
    with contextlib.suppress(AttributeError, OSError, TypeError):  # not glibc
        ctypes.CDLL(None).malloc_trim(0)


def most_bytes(file_bytes: int) -> float:
    """Most bytes that the numbers of a file of this size may take.

    Raises:
        ValueError: the environment variable holds no number above 0.
    """
    stated = os.environ.get(VARIABLE)
    if stated is not None:
        limit = float(stated) * _MEGABYTE
        if not 0 < limit < math.inf:
            raise ValueError(f"{VARIABLE} is {stated!r}")
        return limit
    return min(max(ALWAYS_BYTES, EXPANSION * file_bytes), _SHARE_OF_FREE * free_bytes())


def free_bytes() -> float:
    """Memory that is free, within the limits of this process; infinite where the system does not say."""
    free = math.inf
    with contextlib.suppress(OSError, ValueError, StopIteration), open("/proc/meminfo", encoding="ascii") as stream:
        free = 1024.0 * int(next(line for line in stream if line.startswith("MemAvailable")).split()[1])
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        soft, _ = resource.getrlimit(resource.RLIMIT_DATA)
        free = free if soft == resource.RLIM_INFINITY else min(free, float(soft))
    return free
