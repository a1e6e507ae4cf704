"""The effect of a converter's steps on the points: an error that repeats with the motion.

Rounding errors of a deterministic motion are deterministic too (Widrow & Kollár 2008). A part of
them is coherent with the motion and acts as a gain. This gain depends on the position of the peaks
between two steps, which is unknown, and is the same in all records of one motion, so more records
do not reduce it. The predicted response, and the reference limited to its band, are therefore
rounded at several sizes within one step. At each point the part of the errors that is coherent with
the motion becomes a systematic effect of unknown amount, common to the records of one motion; sines
of other frequencies or sizes have errors of their own. Where noise exceeds the steps, their errors
are noise, and nothing is added.
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
from vibrident.fit.response.transform import (
    MEDIAN_OF_POWER,
    band_of,
    band_sums,
    hann,
    line_frequencies,
    median,
)
from vibrident.fit.uncertainty.adequacy import Adequacy

SOURCE = "steps of the converters"


def effects_of_steps(
    records: Sequence[Record],
    predicted: Sequence[FloatArray],
    response: Callable[[FloatArray], ComplexArray],
    points: Adequacy,
    *,
    band_limited: bool,
) -> list[SystematicEffect]:
    """Return the effects of steps that are not negligible; none if the noise exceeds the steps.

    Args:
        records: of the fit.
        predicted: response of each by the model, NaN where it is not defined.
        response: function from frequencies to the model's complex sensitivity.
        points: where the fit is judged.
        band_limited: as of ``converter_steps``.
    """
    index_by_name = {record.name: index for index, record in enumerate(records)}
    record_index = np.array([index_by_name.get(name, -1) for name in points.record])
    motion = _motion_numbers(records, record_index, points.frequency_hz)
    patterns = np.zeros((2 * TRIALS, len(record_index)), dtype=complex)
    for index, (record, series) in enumerate(zip(records, predicted, strict=True)):
        point_indices = np.flatnonzero(record_index == index)
        if (
            record.reference is not None
            and point_indices.size
            and not _is_single_synchronous_sine(record, motion, point_indices, points)
        ):
            steps = converter_steps(record, band_limited=band_limited)
            patterns[:, point_indices] = _relative_errors(
                record, series, steps, response, points.frequency_hz[point_indices]
            ) / np.sqrt(TRIALS)
    return [
        effect
        for number in distinct(motion[motion >= 0])
        for effect in _as_effects(np.where(motion == number, patterns, 0.0), points)
    ]


def _is_single_synchronous_sine(
    record: Record, motion: np.ndarray, point_indices: np.ndarray, points: Adequacy
) -> bool:
    """Return whether a sine in step with the sampling is the only record of its motion.

    Its errors are then part of its noise.
    """
    first = point_indices[0]
    if record.excitation != "sine" or np.sum(motion == motion[first]) > 1:
        return False
    turns = float(points.frequency_hz[first]) / record.sampling_rate_hz
    channels = record.response, np.asarray(record.reference)
    return any(
        0 < repeated_errors(values, record.mask, turns)[0] < MAX_VALUES for values in channels
    )


def _motion_numbers(
    records: Sequence[Record], record_index: np.ndarray, frequency_hz: FloatArray
) -> np.ndarray:
    """Return the number of the motion of each point, shape (points,): −1 without a record.

    All motions that are no sines have the number 0.
    """
    motion = np.where(record_index < 0, -1, 0)
    sines: list[tuple[float, float]] = []
    for point in np.flatnonzero(record_index >= 0):
        record = records[record_index[point]]
        if record.excitation != "sine":
            continue
        line = record.sampling_rate_hz / record.samples
        step = converter_step(record.response, record.mask)
        frequency = float(frequency_hz[point])
        size = float(np.std(record.response[record.mask])) * np.sqrt(2.0)
        same = (
            number
            for number, (hz, size_known) in enumerate(sines)
            if abs(hz - frequency) < 0.1 * line and abs(size_known - size) <= 0.5 * step
        )
        number = next(same, len(sines))
        if number == len(sines):
            sines.append((frequency, size))
        motion[point] = number + 1
    return motion


def _as_effects(patterns: ComplexArray, points: Adequacy) -> list[SystematicEffect]:
    """Return the fewest effects that have the covariance of these patterns, shape (K, points).

    Effects below 0.3 standard deviations of all points together are left out.
    """
    weighted = patterns / points.relative_deviation
    if not np.any(weighted) or not np.all(np.isfinite(weighted)):
        return []
    left_vectors, singular_values, _ = np.linalg.svd(
        np.concatenate([weighted.real, weighted.imag], axis=1), full_matrices=False
    )
    shapes = left_vectors[:, singular_values > 0.3].T @ patterns
    frequency, frequency_index = np.unique(points.frequency_hz, return_inverse=True)
    weight = points.relative_deviation**-2.0
    total_weight = np.bincount(frequency_index, weight)
    effects = []
    for shape in shapes:
        means = [
            (np.bincount(frequency_index, weight * component) / total_weight).tolist()
            for component in (shape.real, shape.imag)
        ]
        pattern = tuple(zip(frequency.tolist(), *means, strict=True))
        effects.append(
            SystematicEffect(
                SOURCE, "rounding", 1.0, degrees_of_freedom=float(TRIALS), pattern=pattern
            )
        )
    return effects


def converter_steps(record: Record, *, band_limited: bool) -> tuple[float, float]:
    """Return the steps of the converters of response and reference, zero where there are none.

    ``band_limited``: whether the reference moves smoothly between its samples. The values of one
    that is held, or joined by lines, are exact, as they were commanded.
    """
    step = converter_step(record.response, record.mask)
    if record.reference is None or not band_limited:
        return step, 0.0
    return step, converter_step(record.reference, record.reference_mask)


def _relative_errors(
    record: Record,
    series: FloatArray,
    steps: tuple[float, float],
    response: Callable[[FloatArray], ComplexArray],
    frequency_hz: FloatArray,
) -> ComplexArray:
    """Return the relative error of the response by both channels' steps, at each frequency.

    Its shape is (2 TRIALS, frequencies).

    Args:
        record: the record.
        series: the prediction, NaN where it is not defined, shape (samples,).
        steps: of the converters of response and reference.
        response: function from frequencies to the model's complex sensitivity.
        frequency_hz: where the errors are wanted.
    """
    assert record.reference is not None
    relative_errors = np.zeros((2 * TRIALS, frequency_hz.size), dtype=complex)
    used = record.mask & np.isfinite(series)
    step, reference_step = steps
    if not used.any():
        return relative_errors
    predicted = np.where(used, series, 0.0)
    if step > 0.0 and np.std((record.response - predicted)[used]) < DITHERED * step:
        errors = rounding_errors(predicted, used, step, float(record.response[used][0]))
        relative_errors[:TRIALS] = _coherent_errors(
            record, errors, predicted, used, None, frequency_hz
        )
    smooth = _band_limited_reference(record, reference_step, frequency_hz)
    if smooth is not None:
        errors = rounding_errors(smooth, used, reference_step, float(record.reference[used][0]))
        relative_errors[TRIALS:] = -_coherent_errors(
            record, errors, predicted, used, response, frequency_hz
        )
    return relative_errors


def rounding_in_residual(
    record: Record,
    span: slice,
    motion: FloatArray,
    used: BoolArray,
    steps: tuple[float, float],
    variance: float,
    transfer: ComplexArray,
    turns: float | None,
) -> FloatArray | None:
    """Return the errors of both converters that repeat with the motion, as the residual has them.

    Their shape is (2 TRIALS, n). Each row is a possible error, scaled so that the products of the
    rows sum to the covariance of the part that noise leaves coherent with the motion. None where
    all of it is noise.

    Args:
        record: the record.
        span: of n samples of the record.
        motion: predicted response, shape (n,).
        used: samples that count, shape (n,).
        steps: of the converters of response and reference.
        variance: of the noise between the lines of the residual, which includes errors that are
            noise.
        transfer: of the sensor at the bins, shape (bins,).
        turns: of the record's sine from sample to sample; None for other motion.
    """
    if record.reference is None:
        return None
    step, reference_step = steps
    if not step and not reference_step:
        return None
    residual_errors = np.zeros((2 * TRIALS, used.size))
    if step > 0.0 and variance < (DITHERED * step) ** 2:
        response = np.where(used, record.response[span], 0.0)
        predicted = np.where(used, motion + np.mean(response[used]), 0.0)
        coherent_share = np.sqrt(undithered(step, variance))
        residual_errors[:TRIALS] = coherent_share * rounding_errors(
            predicted, used, step, float(response[used][0])
        )
    highest_hz = (0.5 if turns is None else turns) * record.sampling_rate_hz
    smooth = _band_limited_reference(record, reference_step, np.array([highest_hz]))
    if smooth is not None:
        reference_used = used & record.reference_mask[span]
        reference_noise = np.where(reference_used, (record.reference - smooth)[span], 0.0)
        noise_variance = (
            float(median(np.abs(fft.rfft(reference_noise)) ** 2)) / MEDIAN_OF_POWER / used.size
        )
        begin = float(record.reference[span][reference_used][0])
        errors = rounding_errors(smooth[span], reference_used, reference_step, begin)
        errors *= np.sqrt(undithered(reference_step, noise_variance))
        bins = fft.rfft(errors, axis=1)[:, : transfer.size] * transfer  # of the band alone
        residual_errors[TRIALS:] = -fft.irfft(bins, used.size, axis=1)
    return residual_errors / np.sqrt(TRIALS) if np.any(residual_errors) else None


def _band_limited_reference(
    record: Record, step: float, frequency_hz: FloatArray
) -> FloatArray | None:
    """Return the reference limited to its band, shape (samples,).

    The band ends three lines behind the last one that holds motion. None without steps, and where
    the noise above the band, up to 0.45 of the rate, exceeds them.
    """
    assert record.reference is not None
    if not step > 0.0:
        return None
    used = record.reference_mask
    samples = record.samples
    rate = record.sampling_rate_hz
    mean = float(np.mean(record.reference[used]))
    motion = np.where(used, record.reference - mean, 0.0)
    lines = fft.rfft(motion)
    width = samples // 16  # of the fade at either end
    rise = np.sin(0.5 * np.pi * (np.arange(width) + 0.5) / max(width, 1)) ** 2
    window = np.concatenate([rise, np.ones(samples - 2 * width), rise[::-1]])
    last = int(1.5 * float(np.max(frequency_hz)) * samples / rate)  # the band of a sine
    if record.excitation != "sine":
        power = np.abs(fft.rfft(window * motion)) ** 2
        # Rounding makes no line as loud.
        loud = np.flatnonzero(power > 30.0 * step**2 / 12.0 * float(window @ window))
        last = int(loud[-1]) + 3 if loud.size else 0
    power_beyond = np.abs(lines[last : int(0.45 * samples)]) ** 2 / samples
    # One line of noise in ten has this part of the mean power or less; stronger ones may leak.
    if (
        power_beyond.size < 10
        or np.quantile(power_beyond, 0.1) > -np.log(1.0 - 0.1) * (DITHERED * step) ** 2
    ):
        return None
    lines[last:] = 0.0
    return fft.irfft(lines, samples) + mean


def _coherent_errors(
    record: Record,
    errors: FloatArray,
    predicted: FloatArray,
    used: BoolArray,
    transfer: Callable[[FloatArray], ComplexArray] | None,
    frequency_hz: FloatArray,
) -> ComplexArray:
    """Return the part of the errors that is coherent with the prediction, relative to it.

    ``transfer``: of the sensor, which errors of the reference pass; None for the response.
    """
    motion = np.where(used, predicted - np.mean(predicted[used]), 0.0)
    samples = record.samples
    rate = record.sampling_rate_hz
    if record.excitation == "sine":
        kernel = hann(samples) * np.exp(
            -2j * np.pi / rate * np.outer(frequency_hz, np.arange(samples))
        )
        gain = 1.0 if transfer is None else transfer(frequency_hz)
        return np.asarray(gain * (errors @ kernel.T) / (kernel @ motion), dtype=complex)
    lines = fft.rfft(errors, axis=1)
    if transfer is not None:
        lines *= transfer(line_frequencies(samples, rate))
    motion_lines = fft.rfft(motion)
    edges = band_edges(samples, rate).astype(int)
    cross_power = band_sums(lines * np.conj(motion_lines), edges)
    power = band_sums(np.abs(motion_lines) ** 2, edges)
    band = band_of(frequency_hz * samples / rate, edges)
    return np.asarray(
        cross_power[:, band] / np.maximum(power[band], np.finfo(float).tiny), dtype=complex
    )
