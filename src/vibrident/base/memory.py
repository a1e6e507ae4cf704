"""Limit the memory of file reading, keep or return freed memory, and limit arithmetic threads."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import math
import os
import threading
from collections.abc import Iterator

#: Environment of a process with one thread of arithmetic, read when NumPy is loaded.
ONE_THREAD: dict[str, str] = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS"), "1"
)
VARIABLE = "VIBRIDENT_MEMORY_MB"  # limit for a file's numbers, MB; replaces all rules below
ALWAYS_BYTES = 128 << 20  # allowed for any file: 16 million samples
#: Beyond ALWAYS_BYTES: largest ratio of numbers to file size. Compression of measured signals gains
#: a factor of 10 at most; float64 takes four times the room of 16 bit.
MAX_EXPANSION = 64
# of the free memory, for a file's numbers; scaling and later steps need as much again
_MAX_SHARE_OF_FREE = 1 / 3
_MEGABYTE = 1_000_000
LONG_RECORD_SAMPLES = 2**18  # longer records return unused memory to the system at once
_KEPT_BYTES = 64 << 20  # freed memory that a process keeps
_MAX_KEPT_ARRAY_BYTES = 4 << 20  # an array up to this size is allocated from kept memory
_M_TRIM_THRESHOLD = -1  # glibc's mallopt: freed bytes above which memory returns to the system
_M_MMAP_THRESHOLD = -3  # glibc's mallopt: bytes above which an array has pages of its own


def use_one_thread() -> None:
    """Compute on one core, unless the user's environment says otherwise; before NumPy is loaded.

    The matrices of an identification are small: more threads wait for each other, which takes a
    busy machine twice to eight times the time.
    """
    for name, number in ONE_THREAD.items():
        os.environ.setdefault(name, number)


_lock = threading.Lock()
_callers = 0  # within a block of ``_one_thread``
_limit = contextlib.ExitStack()


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    """Limit the process to one thread of arithmetic within the block.

    The first caller sets the limit, and the last one removes it.
    """
    global _callers
    if any(name in os.environ for name in ONE_THREAD):
        yield
        return
    from threadpoolctl import threadpool_limits

    with _lock:
        if _callers == 0:
            _limit.enter_context(threadpool_limits(1, "blas"))
        _callers += 1
    try:
        yield
    finally:
        with _lock:
            _callers -= 1
            if _callers == 0:
                _limit.close()


#: Decorator of a function: its matrices are on one core, unless the user's environment says
#: otherwise. For scripts, which have loaded NumPy before.
in_one_thread: contextlib.ContextDecorator = _one_thread()


@functools.cache
def keep_freed() -> None:
    """Keep freed memory for the next arrays (glibc), once and for all.

    Otherwise the system takes the pages of each array of a record back, and clears them for the
    next one: a tenth of the time of an identification.
    """
    with contextlib.suppress(AttributeError, OSError, TypeError):  # not glibc
        library = ctypes.CDLL(None)
        library.mallopt(_M_MMAP_THRESHOLD, _MAX_KEPT_ARRAY_BYTES)
        library.mallopt(_M_TRIM_THRESHOLD, _KEPT_BYTES)


def return_freed() -> None:
    """Return freed memory to the system (glibc), as after a compilation or a large file."""
    with contextlib.suppress(AttributeError, OSError, TypeError):  # not glibc
        ctypes.CDLL(None).malloc_trim(0)


def return_freed_after(samples: int) -> None:
    """Return freed memory to the system after work on a long record of ``samples``."""
    if samples > LONG_RECORD_SAMPLES:
        return_freed()


def max_bytes(file_bytes: int) -> float:
    """Return the largest number of bytes that the numbers of a file of this size may take.

    Raises:
        ValueError: the environment variable holds no number above 0.
    """
    setting = os.environ.get(VARIABLE)
    if setting is not None:
        limit = float(setting) * _MEGABYTE
        if not 0 < limit < math.inf:
            raise ValueError(f"{VARIABLE} is {setting!r}")
        return limit
    return min(max(ALWAYS_BYTES, MAX_EXPANSION * file_bytes), _MAX_SHARE_OF_FREE * free_bytes())


def free_bytes() -> float:
    """Return the free memory within the limits of this process; infinite if it is not known."""
    free = math.inf
    with (
        contextlib.suppress(OSError, ValueError, StopIteration),
        open("/proc/meminfo", encoding="ascii") as stream,
    ):
        free = 1024.0 * int(
            next(line for line in stream if line.startswith("MemAvailable")).split()[1]
        )
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        soft, _ = resource.getrlimit(resource.RLIMIT_DATA)
        free = free if soft == resource.RLIM_INFINITY else min(free, float(soft))
    return free
