"""Samples of records as CSV, and names for results."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vibrident.data.records import Record


def write_samples(path: Path, record: Record, **columns: Any) -> None:
    """A row a sample: ``time_s``, the file's own clock, and the columns; blank where a value is not a number."""
    times = (record.start_time_s + record.time_s).tolist()
    rows = zip(times, *(values.tolist() for values in columns.values()), strict=True)
    with path.open("w", encoding="ascii", newline="\n") as stream:
        stream.write(",".join(("time_s", *columns)) + "\n")
        stream.writelines(",".join(["" if v != v else repr(v) for v in row]) + "\n" for row in rows)


def distinct(paths: Sequence[Path]) -> list[str]:
    """A name for each result: the last part of the path that differs."""
    parts = [(path.stem, *reversed(path.resolve().parent.parts[1:])) for path in paths]
    names = next((list(level) for level in zip(*parts, strict=False) if len(set(level)) > 1), [p[0] for p in parts])
    return [f"{name}-{names[: i + 1].count(name)}" if names.count(name) > 1 else name for i, name in enumerate(names)]
