"""Measured and predicted response in time, with the residual under each on a scale of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vibrident.naming import Scale, scaled
from vibrident.plots import style
from vibrident.plots.choose import PANELS, envelope, grid, record_frequencies, spread
from vibrident.plots.style import FloatArray
from vibrident.plots.units import frequency_text
from vibrident.result import Result, Signal

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from matplotlib.gridspec import SubplotSpec

#: Periods of a sine that still show its shape in a small picture.
_PERIODS = 6.0


def figure(result: Result) -> Figure:
    """Draw at most six records, spread over frequency: measured and predicted response, residual underneath."""
    frequencies = record_frequencies(result)
    ordered = sorted(result.signals, key=lambda signal: frequencies.get(signal.record, 0.0))
    chosen = [ordered[i] for i in spread(len(ordered))]
    with style.styled():
        if not chosen:
            picture = style.new_figure(6.7, 2.6)
            axes = picture.add_subplot()
            axes.set_xlabel("Time in s")
            axes.set_ylabel(f"Response in {style.printable(result.response_unit)}")
            style.empty(axes, "the result holds no signals")
        else:
            rows, columns = grid(len(chosen))
            picture = style.new_figure(6.7 if columns < 3 else 8.6, 1.0 + 2.5 * rows)
            cells = picture.add_gridspec(rows, columns)
            sizes = _common(chosen)
            for i, signal in enumerate(chosen):
                cell = cells[divmod(i, columns)]
                _panel(picture, cell, signal, frequencies.get(signal.record), sizes, named=i % columns == 0)
            handles, labels = picture.axes[0].get_legend_handles_labels()
            picture.legend(handles, labels, loc="outside lower right", ncols=2)
        style.head(picture, "Measured and predicted response", result)
        if len(ordered) > PANELS:
            style.note(picture, f"{len(chosen)} of {len(ordered)} records shown.")
        return picture


def _common(signals: list[Signal]) -> tuple[float, float]:
    """Size of the responses and of the residuals of several signals, so that their panels share a unit."""
    responses = [style.numbers(signal.measured) for signal in signals]
    residuals = [y - style.numbers(signal.predicted) for y, signal in zip(responses, signals, strict=True)]
    return max(_largest(y) for y in responses), max(_largest(e) for e in residuals)


def _unit(signal: Signal, values: FloatArray, common: float) -> Scale:
    own = _largest(values)
    return scaled(signal.unit, common if own > common / 500 else own)


def _panel(
    picture: Figure,
    cell: SubplotSpec,
    signal: Signal,
    frequency_hz: float | None,
    sizes: tuple[float, float],
    *,
    named: bool,
) -> None:
    rows = cell.subgridspec(2, 1, height_ratios=(2.6, 1), hspace=0.0)
    upper = picture.add_subplot(rows[0])
    lower = picture.add_subplot(rows[1], sharex=upper)
    time, measured, predicted = (style.numbers(v) for v in (signal.time_s, signal.measured, signal.predicted))
    if frequency_hz and time.size:
        part = time <= time[0] + _PERIODS / frequency_hz
        time, measured, predicted = time[part], measured[part], predicted[part]
    residual = measured - predicted
    time_scale = scaled("s", float(np.ptp(time)) if time.size else 0.0)
    size, residual_size = _unit(signal, measured, sizes[0]), _unit(signal, residual, sizes[1])

    name = style.shortened(signal.record, 22)
    heading = " · ".join(dict.fromkeys((frequency_text(frequency_hz), name))) if frequency_hz else name
    upper.set_title(f"{heading}\nresidual {100 * (signal.nrmse or 0.0):.2g} % of sd", fontsize=8)
    few = {"marker": ".", "markersize": 3} if 0 < time.size <= 60 else {}
    upper.plot(
        *envelope(time * time_scale.factor, measured * size.factor),
        color=style.ORANGE,
        lw=2.6,
        label="measured",
        **few,
    )
    upper.plot(
        *envelope(time * time_scale.factor, predicted * size.factor),
        color=style.BLACK,
        lw=1.0,
        ls="--",
        label="predicted",
    )
    lower.plot(
        *envelope(time * time_scale.factor, residual * residual_size.factor),
        color=style.BLUE,
        lw=0.8,
        label="residual",
    )
    lower.axhline(0.0, color=style.BLACK, lw=0.6)
    units = [f"in {style.printable(scale.unit)}" for scale in (size, residual_size)]
    upper.set_ylabel(f"Response\n{units[0]}" if named else units[0])
    lower.set_ylabel(f"Residual\n{units[1]}" if named else units[1])
    lower.set_xlabel(f"Time in {time_scale.unit}")
    lower.locator_params(axis="y", nbins=3)
    upper.tick_params(labelbottom=False)


def _largest(values: FloatArray) -> float:
    usable = np.abs(values[np.isfinite(values)])
    return float(usable.max()) if usable.size else 0.0
