"""Which libraries take part in a computation: the places where they run name them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_names: ContextVar[set[str] | None] = ContextVar("participants", default=None)


@contextmanager
def watching() -> Iterator[None]:
    """Collect the names of libraries within the block, or the function that this decorates."""
    outer = _names.get()
    token = _names.set(set())
    try:
        yield
    finally:
        if outer is not None:
            outer |= participants()
        _names.reset(token)


def takes_part(*packages: str) -> None:
    """Name packages that take part in the computation that is watched, if one is."""
    names = _names.get()
    if names is not None:
        names.update(packages)


def participants() -> frozenset[str]:
    """Return the packages named so far in the innermost computation that is watched."""
    return frozenset(_names.get() or ())
