"""The effect of a converter's steps on the points: an error that repeats with the motion.

Rounding errors of a deterministic motion are deterministic too (Widrow & Kollár 2008): part of them is coherent with
the motion and acts as a gain. It depends on the position of the peaks between two steps, which is unknown. In records
of one motion it is always the same, so that more of them do not reduce it. The predicted response, and the reference
limited to its band, are therefore rounded at several sizes within one step. The part of the errors that is coherent
with the motion at each point is taken as a systematic effect of unknown amount, common to the records of one motion:
sines of other frequencies or sizes have errors of their own. Where noise is larger than the steps, their errors are
noise, and nothing is added.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy import fft

from vibrident.data.records import BoolArray, FloatArray, Record, SystematicEffect
from vibrident.data.records.basis import distinct
from vibrident.data.screening.steps import converter_step
from vibrident.fit.response.bands import band_edges
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.rounding import (
    DITHERED,
    MAX_VALUES,
    TRIALS,
    repeated_errors,
    rounding_errors,
    undithered,
)
from vibrident.fit.response.transform import MEDIAN_OF_POWER, hann, line_frequencies, median
from vibrident.fit.uncertainty.adequacy import Adequacy

SOURCE = "steps of the converters"


def effects_of_steps(
    records: Sequence[Record],
    predicted: Sequence[FloatArray],
    response: Callable[[FloatArray], ComplexArray],
    points: Adequacy,
) -> list[SystematicEffect]:
    """The effects that are not negligible; empty if the noise exceeds the steps.

    ``predicted``: response of each by the model, NaN where it is not defined; ``response``: function from frequencies
    to the model's complex sensitivity; ``points``: where the fit is judged.
    """
    owner = {record.name: index for index, record in enumerate(records)}
    at = np.array([owner.get(name, -1) for name in points.record])
    motion = _motions(records, at, points.frequency_hz)
    patterns = np.zeros((2 * TRIALS, len(at)), dtype=complex)
    for index, (record, series) in enumerate(zip(records, predicted, strict=True)):
        places = np.flatnonzero(at == index)
        if (
            record.reference is not None
            and places.size
            and not _alone_in_step(record, motion, places, points)
        ):
            patterns[:, places] = _errors(
                record, series, response, points.frequency_hz[places]
            ) / np.sqrt(TRIALS)
    return [
        effect
        for each in distinct(motion[motion >= 0])
        for effect in _as_effects(np.where(motion == each, patterns, 0.0), points)
    ]


def _alone_in_step(
    record: Record, motion: np.ndarray, places: np.ndarray, points: Adequacy
) -> bool:
    """Whether a sine in step with the sampling is the only one of its motion: its errors are in its own noise."""
    if record.excitation != "sine" or np.sum(motion == motion[places[0]]) > 1:
        return False
    turns = float(points.frequency_hz[places[0]]) / record.sampling_rate_hz
    channels = record.response, np.asarray(record.reference)
    return any(
        0 < repeated_errors(values, record.mask, turns)[0] < MAX_VALUES for values in channels
    )


def _motions(records: Sequence[Record], at: np.ndarray, frequency_hz: FloatArray) -> np.ndarray:
    """Number of the motion of each point, shape (points,); that of all but sines is one; −1 for no record."""
    motion = np.where(at < 0, -1, 0)
    known: list[tuple[float, float]] = []
    for place in np.flatnonzero(at >= 0):
        record = records[at[place]]
        if record.excitation != "sine":
            continue
        line = record.sampling_rate_hz / record.samples
        step = converter_step(record.response, record.mask)
        frequency, size = (
            float(frequency_hz[place]),
            float(np.std(record.response[record.mask])) * np.sqrt(2.0),
        )
        alike = [
            abs(hz - frequency) < 0.1 * line and abs(its_size - size) <= 0.5 * step
            for hz, its_size in known
        ]
        if not any(alike):
            alike.append(True)
            known.append((frequency, size))
        motion[place] = alike.index(True) + 1
    return motion


def _as_effects(patterns: ComplexArray, points: Adequacy) -> list[SystematicEffect]:
    """The same covariance by as few effects as do, each of 0.3 standard deviations of all points together or more.

    ``patterns``: of shape (K, points).
    """
    weighted = patterns / points.relative_deviation
    if not np.any(weighted) or not np.all(np.isfinite(weighted)):
        return []
    left, size, _ = np.linalg.svd(
        np.concatenate([weighted.real, weighted.imag], axis=1), full_matrices=False
    )
    shapes = left[:, size > 0.3].T @ patterns
    frequency, which = np.unique(points.frequency_hz, return_inverse=True)
    weight = points.relative_deviation**-2.0
    total = np.bincount(which, weight)
    found = []
    for shape in shapes:
        real, imaginary = (
            np.bincount(which, weight * part) / total for part in (shape.real, shape.imag)
        )
        pattern = tuple(zip(frequency.tolist(), real.tolist(), imaginary.tolist(), strict=True))
        found.append(
            SystematicEffect(
                SOURCE, "rounding", 1.0, degrees_of_freedom=float(TRIALS), pattern=pattern
            )
        )
    return found


def _errors(
    record: Record,
    series: FloatArray,
    response: Callable[[FloatArray], ComplexArray],
    frequency_hz: FloatArray,
) -> ComplexArray:
    """Relative error of the response at each frequency, by both channels' steps, shape (2 TRIALS, frequencies)."""
    assert record.reference is not None
    found = np.zeros((2 * TRIALS, frequency_hz.size), dtype=complex)
    used = record.mask & np.isfinite(series)
    steps = (
        converter_step(record.response, record.mask),
        converter_step(record.reference, record.reference_mask),
    )
    if not used.any() or not any(steps):
        return found
    predicted = np.where(used, series, 0.0)
    if steps[0] > 0.0 and np.std((record.response - predicted)[used]) < DITHERED * steps[0]:
        errors = rounding_errors(predicted, used, steps[0], float(record.response[used][0]))
        found[:TRIALS] = _coherent(record, errors, predicted, used, None, frequency_hz)
    smooth = _within_band(record, steps[1], frequency_hz) if steps[1] > 0.0 else None
    if smooth is not None:
        errors = rounding_errors(smooth, used, steps[1], float(record.reference[used][0]))
        found[TRIALS:] = -_coherent(record, errors, predicted, used, response, frequency_hz)
    return found


def rounding_in_residual(
    record: Record,
    span: slice,
    motion: FloatArray,
    used: BoolArray,
    variance: float,
    transfer: ComplexArray,
    turns: float | None,
) -> FloatArray | None:
    """Errors of both converters that repeat with the motion, as the residual has them, shape (2 TRIALS, n).

    Each is one of what the errors may be, scaled so that their products sum to the covariance of the part that noise
    leaves coherent with the motion; None where all of it is noise.

    Args:
        record: the record.
        span: its samples that are looked at, n in number.
        motion: predicted response, shape (n,).
        used: those that count, shape (n,).
        variance: of the noise between the lines of the residual, which the errors are part of where they are noise.
        transfer: of the sensor at the bins, shape (bins,).
        turns: of the record's sine from sample to sample; None for other motion.
    """
    if record.reference is None:
        return None
    steps = (
        converter_step(record.response, record.mask),
        converter_step(record.reference, record.reference_mask),
    )
    if not any(steps):
        return None
    found = np.zeros((2 * TRIALS, used.size))
    if steps[0] > 0.0 and variance < (DITHERED * steps[0]) ** 2:
        response = np.where(used, record.response[span], 0.0)
        whole = np.where(used, motion + np.mean(response[used]), 0.0)
        coherent = np.sqrt(undithered(steps[0], variance))
        found[:TRIALS] = coherent * rounding_errors(whole, used, steps[0], float(response[used][0]))
    top = (0.5 if turns is None else turns) * record.sampling_rate_hz
    smooth = _within_band(record, steps[1], np.array([top])) if steps[1] > 0.0 else None
    if smooth is not None:
        kept = used & record.reference_mask[span]
        left = np.where(kept, (record.reference - smooth)[span], 0.0)
        between = (
            float(median(np.abs(np.asarray(fft.rfft(left))) ** 2)) / MEDIAN_OF_POWER / used.size
        )
        errors = rounding_errors(
            smooth[span], kept, steps[1], float(record.reference[span][kept][0])
        )
        errors *= np.sqrt(undithered(steps[1], between))
        bins = fft.rfft(errors, axis=1)[:, : transfer.size] * transfer  # of the band alone
        found[TRIALS:] = -np.asarray(fft.irfft(bins, used.size, axis=1))
    return found / np.sqrt(TRIALS) if np.any(found) else None


def _within_band(record: Record, step: float, frequency_hz: FloatArray) -> FloatArray | None:
    """The reference limited to its band, shape (samples,); None if the noise above the band exceeds the steps.

    The band ends three lines behind the last one that holds motion; noise is looked for up to 0.45 of the rate.
    """
    assert record.reference is not None
    used, samples, rate = record.reference_mask, record.samples, record.sampling_rate_hz
    mean = float(np.mean(record.reference[used]))
    motion = np.where(used, record.reference - mean, 0.0)
    lines = np.asarray(fft.rfft(motion), dtype=complex)
    width = samples // 16  # faded at either end
    rise = np.sin(0.5 * np.pi * (np.arange(width) + 0.5) / max(width, 1)) ** 2
    window = np.concatenate([rise, np.ones(samples - 2 * width), rise[::-1]])
    last = int(1.5 * float(np.max(frequency_hz)) * samples / rate)  # the band of a sine
    if record.excitation != "sine":
        power = np.abs(np.asarray(fft.rfft(window * motion))) ** 2
        loud = np.flatnonzero(
            power > 30.0 * step**2 / 12.0 * float(window @ window)
        )  # by motion, not by rounding
        last = int(loud[-1]) + 3 if loud.size else 0
    beyond = np.abs(lines[last : int(0.45 * samples)]) ** 2 / samples
    # Of noise, one line in ten has this part of its mean power or less; the stronger ones may hold leakage.
    if beyond.size < 10 or np.quantile(beyond, 0.1) > -np.log(1.0 - 0.1) * (DITHERED * step) ** 2:
        return None
    lines[last:] = 0.0
    return np.asarray(fft.irfft(lines, samples)) + mean


def _coherent(
    record: Record,
    errors: FloatArray,
    predicted: FloatArray,
    used: BoolArray,
    through: Callable[[FloatArray], ComplexArray] | None,
    frequency_hz: FloatArray,
) -> ComplexArray:
    """What of the errors, through the sensor where it is given, is coherent with the prediction, relative to it."""
    motion = np.where(used, predicted - np.mean(predicted[used]), 0.0)
    samples, rate = record.samples, record.sampling_rate_hz
    if record.excitation == "sine":
        turn = hann(samples) * np.exp(
            -2j * np.pi / rate * np.outer(frequency_hz, np.arange(samples))
        )
        gain = 1.0 if through is None else through(frequency_hz)
        return np.asarray(gain * (errors @ turn.T) / (turn @ motion), dtype=complex)
    lines = np.asarray(fft.rfft(errors, axis=1), dtype=complex)
    if through is not None:
        lines *= through(line_frequencies(samples, rate))
    moved = np.asarray(fft.rfft(motion), dtype=complex)
    edges = band_edges(samples, rate).astype(int)
    common = np.add.reduceat(
        lines[:, : edges[-1]] * np.conj(moved[: edges[-1]]), edges[:-1], axis=1
    )
    power = np.add.reduceat(np.abs(moved[: edges[-1]]) ** 2, edges[:-1])
    band = np.clip(
        np.searchsorted(edges, frequency_hz * samples / rate, side="right") - 1, 0, len(edges) - 2
    )
    return np.asarray(
        common[:, band] / np.maximum(power[band], np.finfo(float).tiny), dtype=complex
    )
