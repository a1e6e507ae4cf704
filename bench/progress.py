"""A progress bar on standard error, so that standard output holds the table alone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sized
from typing import TypeVar

from rich.console import Console
from rich.progress import track

T = TypeVar("T")
STDERR = Console(stderr=True)


def steps(label: str, items: Iterable[T], total: int | None = None) -> Iterator[T]:
    """The items, with a bar that follows them."""
    count = total if total is not None else len(items) if isinstance(items, Sized) else None
    hidden = not STDERR.is_terminal
    yield from track(items, description=label, total=count, console=STDERR, transient=True, disable=hidden)
