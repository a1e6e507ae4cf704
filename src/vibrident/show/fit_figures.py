"""Pictures of the fit: signals in time, residuals, and the way of the optimiser."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vibrident.base.amounts import scaled
from vibrident.physics.naming import in_words
from vibrident.result import MeasuredCurve, Result, Signal, Training
from vibrident.show import axes
from vibrident.show.curves import (
    bars_of_deviation,
    column,
    from_start,
    largest,
    record_frequencies,
    spread,
)
from vibrident.show.numbers import frequency_text, shortened, subject
from vibrident.show.views import (
    BLACK,
    BLUE,
    LINES,
    MAX_POINTS_WITH_BARS,
    ORANGE,
    SKY,
    VERMILION,
    Axis,
    Figure,
    FloatArray,
    K,
    Look,
    Marker,
    Panel,
    Series,
    Stack,
)

PERIODS = 6.0  # periods of a sine that show its shape
MAX_RECORDS = 60  # most records to choose from


def signals(result: Result) -> Figure | None:
    """Draw measured and predicted response in time by record, and the residual below them."""
    frequencies = record_frequencies(result)
    with_samples = [signal for signal in result.signals if signal.measured.size]
    ordered = sorted(with_samples, key=lambda signal: frequencies.get(signal.record, 0.0))
    if not ordered:
        return None
    ordered = [ordered[i] for i in spread(len(ordered), MAX_RECORDS)]
    common = (
        largest(*(signal.measured for signal in ordered)),
        largest(*(signal.residual for signal in ordered)),
    )
    stacks = tuple(_signal(signal, frequencies.get(signal.record), common) for signal in ordered)
    caption = (
        "Measured and predicted response of a part of each record, and the residual on a "
        "scale of its own."
    )
    if len(ordered) < len(with_samples):
        caption += f" Of {len(with_samples)} records these are {len(ordered)}, spread evenly."
    title = "Measured and predicted response"
    return Figure(
        "signals", title, stacks, subject(result.model, result.sensor), caption, choice=True
    )


def _signal(signal: Signal, frequency_hz: float | None, common: tuple[float, float]) -> Stack:
    time = signal.time_s
    shown_samples = time <= time[0] + PERIODS / frequency_hz if frequency_hz else slice(None)
    measured, predicted, residual = (
        values[shown_samples] for values in (signal.measured, signal.predicted, signal.residual)
    )
    time, clock = from_start(time[shown_samples])
    # One unit serves all records, except where one is far smaller.
    sizes = largest(measured), largest(residual)
    size, small = (
        scaled(signal.unit, a if b > a / 500 else b) for a, b in zip(common, sizes, strict=True)
    )
    few: Marker = "." if 0 < time.size <= 60 else ""
    lines = (
        Series(time, measured * size.factor, "measured", Look(ORANGE, width=2.6, marker=few)),
        Series(time, predicted * size.factor, "predicted", Look(BLACK, "dashed", 1.0)),
    )
    residual_line = Series(time, residual * small.factor, "residual", Look(BLUE, width=0.8))
    called = frequency_text(frequency_hz) if frequency_hz else ""
    labels = dict.fromkeys(label for label in (called, signal.record) if label)
    name = " · ".join(labels)
    x = axes.linear(clock, time, most=4, margin=0.02)
    upper = axes.linear(
        f"Response\nin {size.unit}", np.concatenate([line.y for line in lines]), most=4
    )
    lower = axes.linear(f"Residual\nin {small.unit}", residual_line.y, most=3)
    share = f"residual {100 * (signal.nrmse or 0.0):.2g} % of sd"
    return Stack(
        (Panel(x, upper, lines, 1.25), Panel(x, lower, (residual_line,), 0.55, rules=(0.0,))),
        f"{name}\n{share}",
    )


def residuals(result: Result) -> Figure | None:
    """Draw the residual of each record (of each point of a table) and its distribution."""
    if not result.signals and not result.measured.frequency_hz.size:
        return None
    if result.signals:
        panel = _by_record(result)
        values = np.concatenate([_scale_by_rmse(signal) for signal in result.signals])
        right = _distribution(values, "Residual / rmse of its record\n(dimensionless)", "residuals")
    else:
        panel = _by_point(result.measured)
        right = _distribution(*_deviations(result.measured), "points")
    caption = (
        "Distribution of the residuals beside the normal one; values beyond the ends are "
        "counted in the last bars."
    )
    stacks = (Stack((panel,), width=1.5), Stack((right,)))
    return Figure("residuals", "Residuals", stacks, subject(result.model, result.sensor), caption)


def _by_record(result: Result) -> Panel:
    frequencies = record_frequencies(result)
    percent = 100 * np.array([signal.nrmse for signal in result.signals], dtype=float)
    label = "Residual rms / sd of response\nin %"
    names = [signal.record for signal in result.signals]
    if all(name in frequencies for name in names):
        values = np.array([frequencies[name] for name in names])
        return _stems(axes.frequency(values), values, percent, label, "by record", names)
    count = np.arange(1.0, len(names) + 1)
    if len(names) <= 4:
        x = axes.named("Record", [shortened(name, 44 // len(names)) for name in names])
    else:
        x = axes.linear("Record (number in the result)", count, whole_numbers=True)
    return _stems(x, count, percent, label, "by record", names)


def _by_point(measured: MeasuredCurve) -> Panel:
    frequency = measured.frequency_hz
    relative = column(measured, "deviation_percent") / 100
    phase = column(measured, "deviation_phase_deg")
    percent = 100 * np.abs((1 + relative) * np.exp(1j * np.deg2rad(np.nan_to_num(phase))) - 1)
    return _stems(
        axes.frequency(frequency),
        frequency,
        percent,
        "|model / measured − 1|\nin %",
        "by frequency",
        (),
    )


def _stems(
    x: Axis,
    positions: FloatArray,
    percent: FloatArray,
    label: str,
    title: str,
    names: Sequence[str],
) -> Panel:
    positive = axes.usable(percent, positive=True)
    wide = positive.size and positive.max() > 30 * positive.min()
    y = (
        axes.size(label, percent)
        if wide
        else axes.linear(label, np.append(1.12 * positive, 0.0), base=True)
    )
    kind = "stems" if len(positions) <= 80 else "points"
    short_names = tuple(shortened(name, 40) for name in names)
    look = Look(VERMILION, marker="o" if len(positions) <= MAX_POINTS_WITH_BARS else ".")
    series = (Series(positions, percent, "", look, kind, names=short_names),)
    return Panel(
        x, y, series, 2.0, title, empty="" if positive.size else "no residuals in the result"
    )


def _scale_by_rmse(signal: Signal) -> FloatArray:
    residual = axes.usable(signal.residual)
    size = math.sqrt(float(np.mean(residual**2))) if residual.size else 0.0
    return residual / size if size > 0 else residual[:0]


def _deviations(measured: MeasuredCurve) -> tuple[FloatArray, str]:
    percent = column(measured, "deviation_percent")
    relative_u = bars_of_deviation(measured)[0] / K
    usable = np.isfinite(percent) & np.isfinite(relative_u) & (relative_u > 0)
    if usable.any():
        return percent[usable] / relative_u[usable], "Magnitude deviation / its u\n(dimensionless)"
    return axes.usable(percent), "Magnitude deviation\nin %"


def _distribution(values: FloatArray, label: str, counted: str) -> Panel:
    if values.size == 0:
        nothing = Axis(label, 0.0, 1.0)
        return Panel(
            nothing,
            Axis(f"Number of {counted}", 0.0, 1.0),
            (),
            2.0,
            "distribution",
            empty=f"no {counted}",
        )
    normal = "dimensionless" in label
    edges = _edges(values, normal=normal)
    # the few beyond the ends are counted in the last bins
    inside = np.clip(values, edges[0], edges[-1])
    counts, _ = np.histogram(inside, edges)
    centres = (edges[1:] + edges[:-1]) / 2
    width = float(edges[1] - edges[0])
    series = [
        Series(
            centres,
            counts.astype(float),
            counted,
            Look(SKY),
            "columns",
            np.full(counts.size, width / 2),
        )
    ]
    top = float(counts.max())
    if normal:
        x = np.linspace(edges[0], edges[-1], 121)
        density = np.exp(-(x**2) / 2) / math.sqrt(2 * math.pi) * values.size * width
        series.append(Series(x, density, "normal, sd 1", Look(BLACK, "dashed", 1.1)))
        top = max(top, float(density.max()))
    x_axis = axes.linear(label, edges, margin=0.02)
    y_axis = axes.linear(
        f"Number of {counted}", np.array([1.1 * top]), base=True, whole_numbers=True
    )
    return Panel(x_axis, y_axis, tuple(series), 2.0, "distribution")


def _edges(values: FloatArray, *, normal: bool) -> FloatArray:
    """Return symmetric bin edges: about the root of the number of values, at most 40."""
    centre = 0.0 if normal else float(np.median(values))
    reach = max(float(np.abs(values - centre).max()), 1e-9 * max(abs(centre), 1.0))
    reach = min(max(reach, 3.0), 6.0) if normal else reach
    bins = min(40, max(7, math.ceil(math.sqrt(values.size))))
    return np.linspace(centre - reach, centre + reach, bins + 1)


def training(result: Result) -> Figure | None:
    """Draw the loss, and below it each parameter relative to its final value."""
    run = result.training
    if run is None or not (run.loss or run.parameters):
        return None
    changes = [i for i in run.weighting_changes if 0 < i < max(len(run.loss), 2)]
    marks = tuple((i - 0.5, "other weights") for i in changes)
    x = axes.linear(
        "Iteration", np.arange(float(max(len(run.loss), 2))), whole_numbers=True, most=8
    )
    panels = [_loss(x, np.array(run.loss, dtype=float), changes, marks)]
    if run.parameters:
        panels.append(_parameters(x, run, marks))
        panels[0] = replace(panels[0], marks=tuple((iteration, "") for iteration, _ in marks))
    caption = f"Optimiser {run.optimiser}: {run.status}, {run.iterations} iterations."
    if changes:
        caption += (
            " At a dashed line the weights of the residual change: the losses before and "
            "after it cannot be compared."
        )
    return Figure(
        "training",
        "Training",
        (Stack(tuple(panels)),),
        subject(result.model, result.sensor),
        caption,
    )


def _loss(
    x: Axis, loss: FloatArray, changes: Sequence[int], marks: tuple[tuple[float, str], ...]
) -> Panel:
    label = "Loss (mean squared\nweighted residual)"
    finite = axes.usable(loss)
    y = axes.size(label, loss) if finite.size and finite.min() > 0 else axes.linear(label, loss)
    pieces = np.split(np.arange(loss.size, dtype=float), changes)
    look = Look(BLACK, marker=_marker("D", loss.size))
    series = [Series(piece, loss[piece.astype(int)], "", look) for piece in pieces]
    return Panel(
        x, y, tuple(series), 1.5, marks=marks, empty="" if finite.size else "no loss recorded"
    )


def _parameters(x: Axis, run: Training, marks: tuple[tuple[float, str], ...]) -> Panel:
    series = []
    for i, (name, trace) in enumerate(run.parameters.items()):
        values = np.array(trace, dtype=float)
        finite = axes.usable(values)
        if finite.size == 0:
            continue
        look = LINES[i % len(LINES)]
        label = in_words(name)
        if finite[-1] == 0:  # no reference value: show the change, added to 1
            values = 1 + values / (largest(values) or 1.0)
            label = f"1 + {label} / its largest"
        else:
            values = values / finite[-1]
        marked = Look(look.colour, look.dash, look.width, _marker(look.marker, values.size))
        series.append(Series(np.arange(values.size, dtype=float), values, label, marked))
    label = "Parameter / final value\n(dimensionless)"
    pooled = axes.usable(np.concatenate([np.zeros(0), *(line.y for line in series)]))
    wide = pooled.size and pooled.min() > 0 and pooled.max() / pooled.min() > 30
    y = axes.size(label, pooled) if wide else axes.linear(label, np.append(pooled, 1.0))
    return Panel(
        x,
        y,
        tuple(series),
        1.5,
        rules=(1.0,),
        marks=marks,
        empty="" if series else "no parameters recorded",
    )


def _marker(marker: Marker, points: int) -> Marker:
    return marker if points <= 40 else ""
