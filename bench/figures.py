"""A figure: what was measured, against which target, and whether it was met."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sized
from dataclasses import asdict, dataclass, field
from typing import Any, TypeVar

from rich.console import Console
from rich.progress import track


@dataclass(frozen=True)
class Figure:
    """Line of the table.

    Attributes:
        what: the figure in words.
        values: label to value; one entry for a plain ratio. Empty where there is nothing to show:
            see ``note``.
        style: how values are written, a key of ``STYLES``.
        low: target: no value below it; None for no such limit.
        high: target: no value above it; None for no such limit.
        absolute: the target is for the size of the values.
        note: a remark.
    """

    what: str
    values: Mapping[str, float]
    style: str = "times"
    low: float | None = None
    high: float | None = None
    absolute: bool = False
    note: str = ""

    @property
    def target(self) -> str:
        """Return the target in words; empty if absent."""
        write = STYLES[self.style]
        if self.low is not None and self.high is not None:
            return f"{write(self.low)} to {write(self.high)}"
        if self.high is not None:
            return f"≤ {write(self.high)}"
        return f"≥ {write(self.low)}" if self.low is not None else ""

    @property
    def met(self) -> bool | None:
        """Return whether all values keep to the target; None without target, or without values."""
        if not self.target or not self.values:
            return None
        sizes = [abs(v) if self.absolute else v for v in self.values.values()]
        low = -math.inf if self.low is None else self.low
        high = math.inf if self.high is None else self.high
        return all(low <= size <= high for size in sizes)  # NaN is not met

    @property
    def verdict(self) -> str:
        """Return ``met``, ``NOT met``, ``not measured``, or nothing where there is no target."""
        if self.target and not self.values:
            return "not measured"
        return {True: "met", False: "NOT met", None: ""}[self.met]

    @property
    def shown(self) -> str:
        """Return the values as text, in their order."""
        return " · ".join(STYLES[self.style](value) for value in self.values.values()) or "–"

    def to_json(self) -> dict[str, Any]:
        """Plain values, with target and verdict in words beside them."""
        values = {
            label: float(value) if math.isfinite(value) else None
            for label, value in self.values.items()
        }
        return {**asdict(self), "values": values, "target": self.target, "verdict": self.verdict}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Figure:
        """Return the inverse of ``to_json``."""
        values = {
            label: math.nan if value is None else value for label, value in data["values"].items()
        }
        return cls(
            **{name: data[name] for name in cls.__dataclass_fields__ if name != "values"},
            values=values,
        )


@dataclass(frozen=True)
class Section:
    """Figures of a run: title, meaning of the columns, and the conditions they were taken under."""

    name: str
    title: str
    figures: tuple[Figure, ...]
    conditions: Mapping[str, Any] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "name": self.name,
            "title": self.title,
            "conditions": dict(self.conditions),
            "remarks": list(self.remarks),
            "figures": [figure.to_json() for figure in self.figures],
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Section:
        """Return the inverse of ``to_json``."""
        figures = tuple(Figure.from_json(figure) for figure in data["figures"])
        return cls(data["name"], data["title"], figures, data["conditions"], tuple(data["remarks"]))


def _times(value: float) -> str:
    return f"{value:.3g} ×" if abs(value) < 1000.0 else f"{value:.0f} ×"


def _error(value: float) -> str:
    if not math.isfinite(value):
        return "–"
    mantissa, exponent = f"{value:.1e}".split("e")
    return f"{mantissa.removesuffix('.0')}e{int(exponent)}"


STYLES = {
    "seconds": lambda value: f"{value:.3f} s",
    "times": _times,
    "error": _error,
    "plain": lambda value: f"{value:.3g}",
    "sigma": lambda value: f"{value:.2f} σ",
    "percent": lambda value: f"{100.0 * value:.3g} %",
    "bytes": lambda value: f"{value:.0f} B",
    "megabytes": lambda value: f"{value:.0f} MB",
}


@dataclass(frozen=True)
class Options:
    """Settings of a run.

    Attributes:
        runs: seeded runs of the statistics.
        jobs: processes for them.
        pairs: pairs of every ratio of times.
        quick: a short trial, whose figures are not published.
    """

    runs: int = 500
    jobs: int = 2
    pairs: int = 11
    quick: bool = False


T = TypeVar("T")
STDERR = Console(stderr=True)


def steps(label: str, items: Iterable[T], total: int | None = None) -> Iterator[T]:
    """Yield the items, with a bar that follows them."""
    count = total if total is not None else len(items) if isinstance(items, Sized) else None
    hidden = not STDERR.is_terminal
    yield from track(
        items, description=label, total=count, console=STDERR, transient=True, disable=hidden
    )
