"""Files of records and results: names for them, and samples as CSV."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vibrident.records import Record

_UNSAFE = re.compile(r"[^\w.+-]+")
#: Devices of Windows, with any ending.
_RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\.|$)", re.IGNORECASE)
#: Bytes of a name: with a number and an ending, every file system takes it.
_MOST_BYTES = 120


def record_files(records: list[str]) -> list[str]:
    """A unique CSV file name for each record, valid on every system."""
    stems: list[str] = []
    for record in records:
        stem = _UNSAFE.sub("_", record.removesuffix(".csv")).encode(errors="replace")[-_MOST_BYTES:]
        stem = stem.decode(errors="ignore").strip("._") or "record"
        stem = f"record_{stem}" if _RESERVED.match(stem) or stem.startswith("-") else stem
        used = {name.casefold() for name in stems}
        candidates = (stem, *(f"{stem}_{number}" for number in range(2, len(records) + 2)))
        stems.append(next(name for name in candidates if name.casefold() not in used))
    return [f"{stem}.csv" for stem in stems]


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
