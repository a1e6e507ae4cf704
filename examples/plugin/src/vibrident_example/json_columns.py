"""Columns in a JSON object: {"rate_hz": 1000, "columns": {"a": [...], "v": [...]}}."""

from __future__ import annotations

import json

import numpy as np

from vibrident.data.io.columns import Channel, Clock, ColumnFile, require_room, unreadable
from vibrident.data.io.reader import Reader


class JsonColumns(ColumnFile):
    """Such a file, opened; the numbers are small enough to be read at once."""

    def __init__(self, path):
        """List the columns."""
        try:
            require_room(path, path.stat().st_size // 2)
            document = json.loads(path.read_text(encoding="utf-8"))
            self._columns = {
                name: np.array(values, dtype=float) for name, values in document["columns"].items()
            }
            clock = Clock(float(document["rate_hz"]))
        except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
            raise unreadable(str(path), error, "a JSON object with rate_hz and columns") from error
        super().__init__(path, [Channel(name, name, clock) for name in self._columns], {})

    def load(self, positions):
        """The columns at these positions."""
        return tuple(self._columns[self.names[position]] for position in positions)

    def locate(self, position, row):
        """File, column and sample of a value."""
        return f"{self.file}, {self.names[position]}, sample {row + 1}"


JSON_COLUMNS = Reader(
    name="json-columns",
    title="columns in a JSON object",
    endings=(".jsonc",),
    open=JsonColumns,
    plain=True,
)
