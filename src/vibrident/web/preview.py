"""The beginning of the chosen columns as in the file, so that a wrong choice is visible."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vibrident.io.readers import open_columns
from vibrident.present import axes
from vibrident.present.charts import Chart, charts
from vibrident.present.numbers import shortened
from vibrident.present.views import BLUE, VERMILION, Axis, Figure, Look, Panel, Series, Stack
from vibrident.web.description import Description

#: Height of the chart in pixels.
HEIGHT = 360
#: Samples drawn.
MOST_SAMPLES = 3000


def preview(given: Description, folder: Path, files: Sequence[str]) -> Chart:
    """A figure of the first file: reference above response, or magnitude over frequency.

    Raises:
        InputError: a column cannot be read.
    """
    source = open_columns(folder / files[0])
    first, second = (given.magnitude, given.phase) if given.table else (given.reference, given.response)
    across = given.frequency if given.table else given.time
    wanted = [column for column in (across, first, second) if column is not None]
    positions = [source.position_of(column, "columns and units") for column in wanted]
    values = [column[:MOST_SAMPLES] for column in source.load(positions)]
    x = values.pop(0) if across is not None else None
    if x is not None and not given.table and x.size:  # times since 1970 make unreadable labels
        x = x - x[0]
    names = [shortened(str(column), 50) for column in wanted if column != across or column in (first, second)]
    size = min((column.size for column in values), default=0)
    places = np.arange(size, dtype=float) if x is None else np.asarray(x, dtype=float)[:size]
    title = "Frequency in Hz" if given.table else "Sample" if x is None else "Time from the first sample in s"
    below = axes.frequency(places, title) if given.table else axes.linear(title, places, margin=0.02)
    mark = "o" if given.table else ""
    panels = [
        Panel(below, _axis(column), (Series(places, column[:size], name, Look(colour, width=1.0, marker=mark)),), 1.0)
        for colour, column, name in zip((BLUE, VERMILION), values, names, strict=False)
    ]
    ((_, chart),) = charts(Figure("preview", "", (Stack(tuple(panels)),)))
    return chart


def _axis(values: np.ndarray) -> Axis:
    return axes.linear("", np.asarray(values, dtype=float))
