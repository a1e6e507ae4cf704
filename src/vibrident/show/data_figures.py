"""Draw calibration data before anything is identified: records, table, raw light."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from vibrident.base.amounts import scaled
from vibrident.data.records import Calibration, Record, ResponseTable
from vibrident.result import Curve
from vibrident.show import axes
from vibrident.show.curves import envelope, from_start, spread
from vibrident.show.formulas import Words
from vibrident.show.language import ENGLISH
from vibrident.show.numbers import frequency_text, magnitude_scale, sensitivity_unit, subject
from vibrident.show.response_figures import response_panels
from vibrident.show.views import (
    BLACK,
    BLUE,
    VERMILION,
    Figure,
    FloatArray,
    Look,
    Panel,
    Series,
    Stack,
)

if TYPE_CHECKING:
    # loads SciPy, which the other pictures do not need
    from vibrident.data.interferometer.ellipse import Ellipse
    from vibrident.data.interferometer.summary import OpticalSummary

MAX_RECORDS = 6  # most records in a picture
MAX_OPTICAL_RECORDS = 4  # most records in a picture of raw light
PERIODS = 5.0  # periods of a sine in an excerpt
ELLIPSE_POINTS = 361  # points of an ellipse


def inspection(calibration: Calibration) -> Figure:
    """Draw excerpts of at most six records with omitted samples, or the table with U (k = 2)."""
    if calibration.table is not None:
        return _table(calibration, calibration.table)
    records = sorted(calibration.records, key=lambda record: sine_frequency(record) or 0.0)
    doubtful = [not record.mask.all() for record in records]
    drawn = [records[i] for i in _choose_records(doubtful, MAX_RECORDS)]
    faulty = sum(doubtful)
    stacks = tuple(_record(record, calibration) for record in drawn)
    left_out = f"× left out of every fit ({faulty} records affected)." if faulty else ""
    share = f"{len(drawn)} of {len(calibration.records)} records shown. " * (
        len(drawn) < len(calibration.records)
    )
    caption = (
        f"{share}Upper panel: reference ({calibration.quantity}); lower panel: response. Sines, "
        f"shocks and decays: an excerpt. {left_out}"
    )
    head = subject(calibration.model, calibration.sensor)
    return Figure("inspect", "Calibration data", stacks, head, caption, choice=True)


def _table(calibration: Calibration, table: ResponseTable) -> Figure:
    absent = np.empty(0)
    phase, u_phase = (
        absent if values is None else np.rad2deg(values)
        for values in (table.phase_rad, table.phase_uncertainty_rad)
    )
    u = absent if table.magnitude_uncertainty is None else table.magnitude_uncertainty
    points = Curve(table.frequency_hz, table.magnitude, phase, u, u_phase)
    unit = sensitivity_unit(calibration.units["response"], calibration.units["reference"])
    panels = response_panels(
        None, points, magnitude_scale(unit, points.magnitude), calibration.quantity, "table"
    )
    bars = (
        "Bars: expanded uncertainty U, k = 2. " if table.magnitude_uncertainty is not None else ""
    )
    caption = Words(f"{bars}{ENGLISH('text', 'phase') if table.phase_rad is not None else ''}")
    head = subject(calibration.model, calibration.sensor)
    return Figure("inspect", "Calibration data", (Stack(panels),), head, caption)


def _choose_records(first: Sequence[bool], most: int) -> list[int]:
    """Return indices of at most ``most`` records, half of them those that ``first`` marks."""
    ahead, remaining = (
        [i for i, picked in enumerate(first) if picked == kind] for kind in (True, False)
    )
    picked = [ahead[i] for i in spread(len(ahead), most // 2 if remaining else most)]
    picked += [remaining[i] for i in spread(len(remaining), most - len(picked))]
    return sorted(picked)


def _record(record: Record, calibration: Calibration) -> Stack:
    span = excerpt(record)
    time, clock = from_start(record.time_s[span] + record.start_time_s)
    x = axes.linear(clock, time, most=4, margin=0.02)
    panels = []
    channels = (
        ("Reference", record.reference, calibration.units["reference"], BLUE),
        ("Response", record.response, calibration.units["response"], VERMILION),
    )
    for word, values, unit, colour in channels:
        if values is None:
            continue
        scale = scaled(unit, float(np.abs(values[span]).max()))
        plotted = values[span] * scale.factor
        bad = ~record.mask[span]
        series = [Series(*envelope(time, plotted), look=Look(colour, width=1.0))]
        if bad.any():
            series.append(Series(time[bad], plotted[bad], "", Look(BLACK, marker="x"), "points"))
        panels.append(
            Panel(x, axes.linear(f"{word}\nin {scale.unit}", plotted, most=4), tuple(series), 0.9)
        )
    kind = frequency_text(record.frequency_hz) if record.frequency_hz else record.excitation
    rate = scaled("Hz", record.sampling_rate_hz)
    length = scaled("s", record.duration_s)
    size = f"{record.samples} samples, {record.sampling_rate_hz * rate.factor:.6g} {rate.unit}, "
    size += f"{record.duration_s * length.factor:.3g} {length.unit}"
    return Stack(tuple(panels), f"{' · '.join(dict.fromkeys((kind, record.name)))}\n{size}")


def light(calibration: Calibration) -> Figure:
    """Draw the signals of up to four records with the ellipse, and a piece of the displacement."""
    records = [
        (record, record.optical) for record in calibration.records if record.optical is not None
    ]
    drawn = [
        records[i]
        for i in _choose_records(
            [bool(optical.findings) for _, optical in records], MAX_OPTICAL_RECORDS
        )
    ]
    stacks = tuple(stack for record, optical in drawn for stack in _light(record.name, optical))
    share = f"{len(drawn)} of {len(records)} records shown. " if len(drawn) < len(records) else ""
    caption = (
        f"{share}Left: the two signals over each other and the ellipse. Right: the displacement."
    )
    return Figure(
        "light",
        "Interferometer",
        stacks,
        subject(calibration.model, calibration.sensor),
        caption,
        across=2,
    )


def _light(name: str, optical: OpticalSummary) -> tuple[Stack, Stack]:
    """Draw both signals over each other, and a piece of the displacement beside them."""
    time, clock = from_start(optical.excerpt_s)
    size = scaled("m", float(np.nanmax(np.abs(optical.excerpt_m), initial=0.0)))
    series = Series(time, optical.excerpt_m * size.factor, look=Look(BLUE, width=0.8))
    y = axes.linear(f"Displacement\nin {size.unit}", series.y, most=4)
    moved = Panel(axes.linear(clock, time, margin=0.02), y, (series,), 1.7)
    lost = (
        f"{optical.gaps} gaps, {100 * optical.left_out:.2g} % left out"
        if optical.gaps
        else "nothing left out"
    )
    return (
        Stack(
            (lissajous(optical.points, optical.ellipse),), f"{name}\n{optical.fringes:.4g} fringes"
        ),
        Stack((moved,), f"{lost};\nphase noise {optical.phase_noise_rad:.2g} rad", 1.6),
    )


def lissajous(points: FloatArray, ellipse: Ellipse | None) -> Panel:
    """Draw two photodetector signals, shape (2, n), over each other, with their ellipse."""
    series = [Series(points[0], points[1], "", Look(BLUE, marker="."), "points")]
    visible = points
    if ellipse is not None:
        turn = np.linspace(0.0, 2.0 * np.pi, ELLIPSE_POINTS)
        around = ellipse.centre[:, None] + ellipse.matrix @ np.stack([np.cos(turn), np.sin(turn)])
        series.append(Series(around[0], around[1], "", Look(VERMILION, width=0.8)))
        visible = np.append(points, around, axis=1)
    x, y = (
        axes.linear(f"{word} signal", signal, most=4)
        for word, signal in zip(("First", "Second"), visible, strict=True)
    )
    return Panel(x, y, tuple(series), 1.7, square=True)


def sine_frequency(record: Record) -> float | None:
    """Return the stated frequency of a sine record, else its largest spectral line, or None."""
    if record.excitation != "sine":
        return None
    if record.frequency_hz is not None:
        return record.frequency_hz
    motion = record.response if record.reference is None else record.reference
    lines = np.abs(np.fft.rfft(motion - motion.mean()))
    best = int(lines.argmax())
    return best * record.sampling_rate_hz / record.samples if best else None


def excerpt(record: Record) -> slice:
    """Return the samples to show: some periods of a sine, the event of a shock, or all.

    Of a sine, they lie where samples are left out, if any are.
    """
    frequency = sine_frequency(record)
    if record.excitation in ("shock", "decay"):
        return _event(record)
    if frequency is None:
        return slice(0, record.samples)
    length = max(8, math.ceil(PERIODS * record.sampling_rate_hz / frequency) + 1)
    left_out = np.flatnonzero(~record.mask)
    centre = int(left_out[0]) if left_out.size else length // 2
    start = min(max(0, centre - length // 2), max(0, record.samples - length))
    return slice(start, min(start + length, record.samples))


def _event(record: Record) -> slice:
    """Return where a channel is above 2 % of its peak, and a quarter of that length around it."""
    busy = np.zeros(record.samples, dtype=bool)
    for values in (record.reference, record.response):
        if values is not None:
            swing = np.abs(values - np.median(values))
            busy |= swing > 0.02 * swing.max()
    index = np.flatnonzero(busy)
    if index.size == 0:
        return slice(0, record.samples)
    margin = max(4, (int(index[-1]) - int(index[0])) // 4)
    return slice(max(0, int(index[0]) - margin), min(record.samples, int(index[-1]) + margin + 1))
