"""A slow motion of the response's zero that no motion of the sensor explains.

A straight line is measured and taken out. A bent one (an amplifier that warms up) is not measured there: what
initial states and parameters took of it is in all lines. So it is an unknown of the fit, as hum is, by a tone of half a
turn over the record whose size changes with time (:attr:`vibrident.data.records.Record.hum_hz`): with offset and line
these are six smooth functions, as good as a polynomial of fifth degree.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy import fft

from vibrident.base.amounts import amount, plain
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.rounding import step_of_response
from vibrident.fit.response.transform import hann
from vibrident.fit.screening.quality import Finding

#: Slow lines that tell how far noise alone may wander.
LINES = 8
#: A drift counts beyond this many standard deviations of the noise of those lines …
SIGNIFICANT = 8.0
#: … and above this part of the response's standard deviation.
LEAST = 0.02
#: Samples of the shortest record that is looked at.
FEWEST = 64
#: Turns over the record of the tone that stands for a bent drift.
TURNS = 0.5
#: Blocks of a record, by whose means a bent drift is looked for.
BLOCKS = 512
#: Lines that it does not reach, from … to below: they tell the noise.
BEYOND = (4, 12)
#: It counts where it has so many times their power for each of its functions: noise of 1/f gives 5, of 1/f² 28.
BENT = 100.0
#: Functions of smaller size beside the line than this part of the largest one's are not told from it.
SHOWN = 1e-6
#: … in one record; of the same channel in another, or where the parameters tell of it, so many times.
LIKELY = 10.0
#: A record whose own motion is of these functions by more than this part of its power tells no drift.
MOTION = 0.5


def without_drift(
    records: Sequence[Record], predicted: Sequence[FloatArray], unit: str = "", *, likely: bool = False
) -> tuple[tuple[Record, ...], tuple[Finding, ...]]:
    """The records with the drift of their response taken out, or as an unknown of the fit, and what there is to say.

    A bent drift below 2 % of the response is an unknown without a word: it does no harm then.

    Args:
        records: the records.
        predicted: response that a model predicts for each, shape (samples,), NaN where it is not defined.
        unit: of the responses, for the messages.
        likely: something else says that there is one.
    """
    kept, findings = [], []
    bends = [_bend(record, series) for record, series in zip(records, predicted, strict=True)]
    least = LIKELY if likely or any(bend.strength > BENT for bend in bends) else BENT
    for record, series, bend in zip(records, predicted, bends, strict=True):
        used = record.mask & np.isfinite(series)
        if used.sum() < FEWEST:
            kept.append(record)
            continue
        size = float(np.std(record.response[used]))
        if bend.strength > least:
            bent = bend.range
            kept.append(beside_slow_motion(record, bend.amounts))
            if bent > LEAST * size:
                text = (
                    f"{record.name}: the response drifts by {amount(bent, unit or '1', 3)} over the record, "
                    f"{plain(100 * bent / size, 2)} % of its rms, which the motion does not explain; it drifts "
                    "unevenly, and the fit takes a smooth curve for its zero."
                )
                findings.append(Finding("drift", text))
            continue
        times = record.time_s[used]
        middle, duration = float(np.mean(times)), float(np.ptp(times))
        residual = record.response[used]
        residual -= series[used]
        rise = significant_rise(residual, times, size)
        if rise == 0.0:
            kept.append(record)
            continue
        drift = rise * (record.time_s - middle)
        flat = record.with_response(record.response - drift, f"drift of {rise * duration:.6g} removed")
        kept.append(replace(flat, response_step=step_of_response(record)))
        text = (
            f"{record.name}: the response drifts by {amount(rise * duration, unit or '1', 3)} over the record, "
            f"{plain(100 * abs(rise) * duration / size, 2)} % of its rms, which the motion does not explain; a "
            "straight line was taken out."
        )
        findings.append(Finding("drift", text))
    return tuple(kept), tuple(findings)


def beside_slow_motion(record: Record, amounts: FloatArray | None = None) -> Record:
    """The record with a bent drift as an unknown of its fit.

    Args:
        record: the record.
        amounts: of line and functions, shape (5,), where they are seen. They are taken out for all that looks at the
            residual; the fit finds the same with them and without.
    """
    if record.excitation == "decay" or slow_tones(record):
        return record
    response = record.response
    if amounts is not None:
        places = (np.arange(record.samples) + 0.5) / record.samples - 0.5
        response = response - amounts[0] * places - amounts[1:] @ _bends(places)
        response += float(np.mean(record.response) - np.mean(response))
    slow = record.with_response(response, "slow motion of the zero left to the fit")
    tones = (TURNS / record.duration_s, *record.hum_hz)
    return replace(slow, hum_hz=tones, response_step=step_of_response(record))


def slow_tones(record: Record) -> tuple[float, ...]:
    """Those of the record's tones of hum that stand for a bent drift, Hz."""
    return tuple(hz for hz in record.hum_hz if hz * record.duration_s < 2.0 * TURNS)


@dataclass(frozen=True)
class _Bend:
    """A drift that is no straight line.

    Attributes:
        strength: power of its functions over that of noise.
        range: over the record.
        amounts: of line and functions, shape (5,).
    """

    strength: float = 0.0
    range: float = 0.0
    amounts: FloatArray | None = None


def _bend(record: Record, predicted: FloatArray) -> _Bend:
    """What stands of a bent drift beside a prediction, shape (samples,)."""
    used = record.mask & np.isfinite(predicted)
    # Free decays tell their own drift.
    if record.excitation == "decay" or slow_tones(record) or used.sum() < FEWEST:
        return _Bend()
    places, (residual, motion) = _block_means([record.response - predicted, predicted], used)
    if places.size < 4 * BEYOND[1]:
        return _Bend()
    columns = np.concatenate([[np.ones(places.size), places], _bends(places)])
    window = np.cos(np.pi * places) ** 2  # without it the functions draw noise of all frequencies
    line, _ = np.linalg.qr((columns[:2] * window).T)
    windowed = np.stack([*columns[2:], residual, motion]) * window
    windowed -= (windowed @ line) @ line.T
    basis, sizes, _ = np.linalg.svd(windowed[:-2].T, full_matrices=False)
    basis = basis[:, sizes > SHOWN * sizes[0]]
    bent, moved = windowed[-2:] @ basis
    if moved @ moved > MOTION * np.var(predicted[used]) * np.sum(window**2):
        return _Bend()
    left = windowed[-2] - basis @ bent
    level = float(np.mean(np.abs(np.asarray(fft.rfft(left))[slice(*BEYOND)]) ** 2) / np.sum(window**2))
    noise = max(level * float(np.sum((basis * window[:, None]) ** 2)), np.finfo(float).tiny)
    amounts, *_ = np.linalg.lstsq(columns.T, residual, rcond=1e-9)
    return _Bend(
        float(bent @ bent) / noise, float(np.ptp(amounts[1:] @ columns[1:])), np.asarray(amounts[1:], dtype=float)
    )


def _bends(places: FloatArray) -> FloatArray:
    """The tone and its slow change, without its size, shape (4, places); places from −½ to ½."""
    tone = np.stack([np.cos(2.0 * np.pi * TURNS * places), np.sin(2.0 * np.pi * TURNS * places)])
    return np.concatenate([tone, places * tone])


def _block_means(series: Sequence[FloatArray], used: BoolArray) -> tuple[FloatArray, list[FloatArray]]:
    """Middles of blocks that are used, from −½ to ½ of the record, and the means there of each of the series."""
    edges = np.linspace(0, used.size, min(BLOCKS, used.size // 2) + 1).astype(int)
    count = np.add.reduceat(used, edges[:-1], dtype=float)
    kept = count > 0.5 * np.median(count)
    sums = [np.add.reduceat(np.where(used, one, 0.0), edges[:-1]) for one in series]
    middles = 0.5 * (edges[1:] + edges[:-1]) / used.size - 0.5
    return middles[kept], [one[kept] / count[kept] for one in sums]


def significant_rise(residual: FloatArray, times_s: FloatArray, size: float) -> float:
    """Slope of a residual, 1/s, beyond what its slow noise allows; zero where it is not.

    Args:
        residual: shape (used,); overwritten.
        times_s: shape (used,); overwritten.
        size: standard deviation of the response.
    """
    duration = float(np.ptp(times_s))
    times_s -= float(np.mean(times_s))
    rise, deviation = _trend(residual, times_s)
    return rise if abs(rise) * duration > max(SIGNIFICANT * deviation * duration, LEAST * size) else 0.0


def _trend(residual: FloatArray, t: FloatArray) -> tuple[float, float]:
    """Slope by weighted least squares, 1/s, and its standard deviation for noise as strong as the slowest lines.

    The weights fade towards both ends: without them a slope draws noise of all frequencies, and noise of a displacement
    channel grows with their cube.

    Args:
        residual: shape (used,); overwritten, as a long record has no memory to spare.
        t: times from their mean, shape (used,); overwritten.
    """
    window = hann(residual.shape[0])
    total = float(np.sum(window))
    residual -= float(window @ residual) / total
    t -= float(window @ t) / total
    residual *= window
    slope = float(residual @ t)
    t *= window
    weighted = float(t @ t)  # of the slope's own noise
    power = float(t @ (t / np.maximum(window, np.finfo(float).tiny)))
    slope /= power
    t *= slope
    residual -= t
    level = float(np.mean(np.abs(_slow_lines(residual)) ** 2) / (window @ window))
    return slope, float(np.sqrt(level * weighted)) / power


def _slow_lines(series: FloatArray) -> ComplexArray:
    """Lines 2 to LINES + 1 of the discrete Fourier transform, shape (LINES,).

    With sample j = a w + b, e^{−2πi k j/n} is a product of one factor of a and one of b: a product with a matrix does
    it, for any number of samples, where a fast transform of an unlucky one needs many times the record's memory.
    """
    n = series.shape[0]
    width = math.isqrt(n)
    rows = n // width
    turn = -2j * np.pi / n * np.arange(2, 2 + LINES)
    inner = np.exp(np.arange(width)[:, None] * turn)
    outer = np.exp(width * np.arange(rows)[:, None] * turn)
    body, rest = series[: rows * width].reshape(rows, width), series[rows * width :]
    sums = body @ inner.real + 1j * (body @ inner.imag)
    return np.asarray(np.sum(outer * sums, axis=0) + rest @ np.exp(np.arange(rows * width, n)[:, None] * turn))
