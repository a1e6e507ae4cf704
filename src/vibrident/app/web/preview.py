"""Draw the beginning of the chosen columns, so that a wrong choice is visible."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from vibrident.app.web.form.description import Description
from vibrident.app.web.language import Language, phrase
from vibrident.app.web.translated import charts
from vibrident.base.amounts import pretty
from vibrident.base.errors import InputError
from vibrident.data.io.columns import ColumnFile, require_room
from vibrident.data.io.header_units import SourceColumn
from vibrident.data.io.reader import open_columns
from vibrident.data.io.units import split_brackets
from vibrident.data.records import FloatArray
from vibrident.show import axes
from vibrident.show.data_figures import lissajous
from vibrident.show.formulas import Mixed
from vibrident.show.numbers import shortened
from vibrident.show.views import BLUE, GREEN, VERMILION, Figure, Look, Panel, Series, Stack

CHART_HEIGHT_PX = 360  # height of the chart in pixels
MAX_SAMPLES = 3000  # samples drawn
MAX_ELLIPSE_SAMPLES = 1 << 18  # of light, enough to fit an ellipse


def preview(
    description: Description, folder: Path, files: Sequence[str], language: Language
) -> bytes:
    """Return the chart of the first file: reference above response, or magnitude over frequency.

    Two photodetector signals are also drawn over each other, with their ellipse.
    """
    response_file, reference_file = description.pairs(files)[0]
    source = open_columns(folder / response_file)
    light = source if reference_file is None else open_columns(folder / reference_file)
    across = description.get("table.frequency" if description.table else "sampling.time_column")
    drawn: tuple[int | str | None, ...] = tuple(
        description.get(f"table.{key}") for key in ("magnitude", "phase", "real", "imaginary")
    )
    if name := description.get("table.complex"):
        drawn = (f"{name}.real", f"{name}.imag")
    if not description.table:
        drawn = (
            (description.get("response.column"),)
            if reference_file
            else (*description.motion, description.get("response.column"))
        )
    shown_columns = list(dict.fromkeys(column for column in drawn if column is not None))
    if not description.signals:  # those of an interferometer are read in blocks
        positions = [source.position_of(column, "columns and units") for column in shown_columns]
        require_room(folder / response_file, sum(source.length(position) for position in positions))
    stacks = [
        *_draw_light(light, description),
        _draw_columns(source, shown_columns, across, table=description.table),
    ]
    if light is not source:
        signals = [column for column in description.motion if column is not None]
        stacks.insert(-1, _draw_columns(light, signals, None, table=False))
    ((_, chart, _),) = charts(language, Figure("preview", "", tuple(stacks), across=len(stacks)))
    return chart


def _draw_columns(
    source: ColumnFile, shown_columns: Sequence[int | str], across: int | str | None, *, table: bool
) -> Stack:
    """Draw columns of a file below each other, over one of them or the sample number."""
    values = dict(zip(shown_columns, _load_beginnings(source, shown_columns), strict=True))
    x = None if across is None else _load_beginnings(source, [across])[0]
    if x is not None and not table:
        x = x * _seconds_in_unit(source, across)
    if x is not None and not table and x.size:  # times since 1970 make unreadable labels
        x = x - x[0]
    size = min((column.size for column in values.values()), default=0)
    abscissa = np.arange(size, dtype=float) if x is None else np.asarray(x, dtype=float)[:size]
    in_time = phrase("Sample") if x is None else phrase("Time from the first sample in s")
    title = phrase("Frequency in Hz") if table else in_time
    below = axes.frequency(abscissa, title) if table else axes.linear(title, abscissa, margin=0.02)
    mark = "o" if table else ""
    panels = []
    for colour, column in zip((BLUE, VERMILION, GREEN), shown_columns, strict=False):
        look = Look(colour, width=1.0, marker=mark)  # type: ignore[arg-type]
        # the file's own words
        line = Series(abscissa, values[column][:size], Mixed(_column_title(source, column)), look)
        panels.append(Panel(below, axes.linear("", values[column]), (line,), 1.0))
    return Stack(tuple(panels))


def _seconds_in_unit(source: ColumnFile, column: int | str | None) -> float:
    """Return the seconds in the unit of a column of times, one where it states none."""
    assert column is not None
    with suppress(InputError):  # reported when the file is confirmed
        position = source.position_of(column, "columns and units")
        return SourceColumn(source, position).seconds or 1.0
    return 1.0


def _column_title(source: ColumnFile, column: int | str) -> str:
    """Return the name of a column with the unit that the file states, if the name has none."""
    unit = source.stated_unit(source.position_of(column, "columns and units"))
    unit_text = "" if split_brackets(str(column))[1] else pretty(unit)
    return " / ".join(filter(None, (shortened(str(column), 50), unit_text)))


def _load_beginnings(source: ColumnFile, columns: Sequence[int | str]) -> list[FloatArray]:
    positions = [source.position_of(column, "columns and units") for column in columns]
    return [source.block([p], 0, min(source.length(p), MAX_SAMPLES))[0] for p in positions]


def _draw_light(source: ColumnFile, description: Description) -> tuple[Stack, ...]:
    """Draw two photodetector signals over each other, with their ellipse where it is determined."""
    if len(description.signals) != 2 or None in description.signals:
        return ()
    # loads SciPy, which other previews do not need
    from vibrident.data.interferometer.setting import signals_in_memory
    from vibrident.data.interferometer.survey import survey

    positions = [
        source.position_of(column, "columns and units")
        for column in description.signals
        if column is not None
    ]
    lengths = [source.length(position) for position in positions]
    size = min(*lengths, MAX_ELLIPSE_SAMPLES)
    signals = source.block(positions, 0, size)
    if size < 2 or not np.isfinite(signals).all():
        return ()
    points = signals[:, :: max(size // MAX_SAMPLES, 1)]
    ellipse = None
    # reported when the file is confirmed; the signals themselves show it
    with suppress(InputError):
        signal_survey = survey(signals_in_memory(signals, 1.0))
        points = signal_survey.points
        ellipse = signal_survey.ellipse if signal_survey.fitted else None
    return (Stack((lissajous(points, ellipse),)),)
