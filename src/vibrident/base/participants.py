"""Record which libraries take part in a computation; the code that uses them names them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_names: ContextVar[set[str] | None] = ContextVar("participants", default=None)


@contextmanager
def watching() -> Iterator[None]:
    """Collect the names of libraries within the block, or within the decorated function."""
    outer = _names.get()
    token = _names.set(set())
    try:
        yield
    finally:
        if outer is not None:
            outer |= participants()
        _names.reset(token)


def takes_part(*packages: str) -> None:
    """Record packages as participants of the computation that is watched, if any."""
    names = _names.get()
    if names is not None:
        names.update(packages)


def participants() -> frozenset[str]:
    """Return the packages named so far in the innermost computation that is watched."""
    return frozenset(_names.get() or ())
