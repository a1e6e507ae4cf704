"""The beginning of the chosen columns as they stand in the file, so that a wrong choice is seen."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from vibrident.escaping import plotly
from vibrident.io.readers import open_columns
from vibrident.plots.style import BLUE, VERMILION, shortened
from vibrident.report.figures import Figure, axis, figure, listed
from vibrident.web.description import Description

#: Of the chart, in pixels.
HEIGHT = 360
#: Samples drawn.
MOST_SAMPLES = 3000


def preview(given: Description, folder: Path, files: Sequence[str]) -> Figure:
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
    if x is not None and not given.table and x.size:  # a clock that counts from 1970 makes labels nobody can read
        x = x - x[0]
    names = [plotly(shortened(str(column), 50)) for column in wanted if column != across or column in (first, second)]
    data = []
    for place, colour, numbers, name in zip(("y", "y2"), (BLUE, VERMILION), values, names, strict=False):
        look = {"mode": "lines+markers" if given.table else "lines", "line": {"color": colour, "width": 1.3}}
        points = list(range(numbers.size)) if x is None else listed(x, 17)
        data.append({"x": points, "y": listed(numbers), "name": name, "yaxis": place, **look})
    title = "frequency in Hz" if given.table else "sample" if x is None else "time from the first sample, in s"
    layout = {"yaxis": axis("", domain=[0.54, 1.0] if len(data) > 1 else [0.0, 1.0])}
    if len(data) > 1:
        layout["yaxis2"] = axis("", domain=[0.0, 0.46])
    below = axis(title, mirror="all", anchor="y2" if len(data) > 1 else "y", type="log" if given.table else "linear")
    return figure(data, HEIGHT, xaxis=below, showlegend=True, **layout)
