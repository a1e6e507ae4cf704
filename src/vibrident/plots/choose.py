"""Which records a picture shows, and which part of them."""

from __future__ import annotations

import math

import numpy as np

from vibrident.plots.style import FloatArray
from vibrident.records import Record
from vibrident.result import Result

#: Most records in one picture.
PANELS = 6


def spread(count: int, limit: int = PANELS) -> list[int]:
    """At most ``limit`` indices spread evenly over ``count`` things, first and last among them."""
    if count <= limit:
        return list(range(count))
    return [round(i * (count - 1) / (limit - 1)) for i in range(limit)]


def grid(panels: int) -> tuple[int, int]:
    """Rows and columns for that many small pictures."""
    columns = 1 if panels <= 1 else 2 if panels <= 4 else 3
    return max(1, math.ceil(panels / columns)), columns


def record_frequencies(result: Result) -> dict[str, float]:
    """Frequency of each record that was excited at one frequency alone, Hz."""
    found: dict[str, set[float]] = {}
    for name, frequency in zip(result.measured.record, result.measured.frequency_hz, strict=False):
        found.setdefault(name, set()).add(frequency)
    return {name: next(iter(frequencies)) for name, frequencies in found.items() if len(frequencies) == 1}


def sine_frequency(record: Record) -> float | None:
    """Frequency of a sine record for the choice of an excerpt: as stated, or its largest spectral line; else None."""
    if record.excitation != "sine":
        return None
    if record.frequency_hz is not None:
        return record.frequency_hz
    motion = record.response if record.reference is None else record.reference
    lines = np.abs(np.fft.rfft(motion - motion.mean()))
    best = int(lines.argmax())
    return best * record.sampling_rate_hz / record.samples if best else None


def excerpt(record: Record, periods: float = 5.0) -> slice:
    """Samples to show: a few periods of a sine (where samples are left out, if any are), a shock's event, or all."""
    frequency = sine_frequency(record)
    if record.excitation in ("shock", "decay"):
        return _event(record)
    if frequency is None:
        return slice(0, record.samples)
    length = max(8, math.ceil(periods * record.sampling_rate_hz / frequency) + 1)
    left_out = np.flatnonzero(~record.mask)
    centre = int(left_out[0]) if left_out.size else length // 2
    start = min(max(0, centre - length // 2), max(0, record.samples - length))
    return slice(start, min(start + length, record.samples))


def _event(record: Record) -> slice:
    """Where a channel is above 2 % of its peak, and a quarter of that length on both sides."""
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


def envelope(time: FloatArray, values: FloatArray, bins: int = 1500) -> tuple[FloatArray, FloatArray]:
    """Thin a long line without losing its peaks: least and largest value of each bin, in the order of time.

    Args:
        time: shape (samples,).
        values: shape (samples,).
        bins: number of bins.

    Returns:
        time and values, both of shape (at most 2 bins + rest,).
    """
    if len(values) <= 2 * bins:
        return time, values
    width = len(values) // bins
    blocks = values[: bins * width].reshape(bins, width)
    picks = np.sort(np.stack([blocks.argmin(axis=1), blocks.argmax(axis=1)], axis=1), axis=1)
    index = np.concatenate([(picks + width * np.arange(bins)[:, None]).ravel(), np.arange(bins * width, len(values))])
    return time[index], values[index]
