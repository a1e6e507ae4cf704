"""Baseline of a record's response: rest before and after the motion, offset, and noise spectrum.

A spectrum S(f) here is a variance per sample: white noise of variance σ² has S = σ² at every
frequency, and a filter G leaves the variance mean |G|² S over all frequencies from −half to half
the sampling rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from vibrident.base.errors import InputError
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.data.records.basis import resolution, runs_of_true
from vibrident.data.screening import ScreeningFinding, screen

#: Motions that may begin after a rest; ``decay`` stands for any motion without a reference. All
#: others begin gradually, which could be taken for rest.
BEGINS_AT_REST = ("shock", "decay")
REST_TEST_SHARE = 0.02  # part of a record, at its beginning or end, that is tested for rest
MIN_REST_SAMPLES = 32  # of that part
#: Largest standard deviation of a part at rest, in units of the record's largest deviation from its
#: level.
MAX_REST_DEVIATION = 0.02
#: Rest lasts until the response leaves the level by so many standard deviations.
ONSET_DEVIATIONS = 6.0
#: … and by more than the step of a converter, which a constant between two codes shows too.
MIN_ONSET_STEPS = 1.5
USED_REST_SHARE = 0.9  # part of the rest that is used
REST_PARTS = 8  # into which a rest is divided
#: The last part may differ from the others by so many of their standard deviations.
MAX_PART_DEVIATIONS = 4.0
MIN_SPECTRUM_SAMPLES = 128  # at rest, from which a spectrum of the noise is taken
#: Averages that eighths of the rest, half overlapping, are worth (Welch 1967, Hann).
WELCH_AVERAGES = 12.0
REST_FREEDOM_SHARE = 0.9  # degrees of freedom of such a spectrum, for each sample of the rest
#: Variance of a mean of n lines behind a Hann window over that of n independent ones: neighbours
#: correlate by 4/9 and 1/36, so 1 + 2 (4/9 + 1/36).
HANN_LINE_VARIANCE = 1.94
MAX_BRIDGED_SAMPLES = 4  # longest gap of the response over which an integral goes on
NEARBY_SAMPLES = 32  # on either side of a gap, from which the error of its bridge is estimated
PLATEAU_LINES = 64  # averaged where the noise is estimated under the motion
PLATEAU_QUANTILE = 0.1  # of these averages, taken for the noise …
PLATEAU_DEVIATIONS = 1.28  # … which lies so many standard deviations above that quantile


@dataclass(frozen=True, eq=False)
class Baseline:
    """Rest, offset and noise of a record's response."""

    # samples at rest from the first on; zero where the record begins in the middle of a motion
    rest_samples: int
    rests_at_end: bool  # whether the record also ends at rest
    offset: float  # constant to be subtracted, response unit
    offset_uncertainty: float  # its standard uncertainty
    offset_from: str  # its origin, in words
    frequency_hz: FloatArray  # of the spectrum, ascending from zero, shape (lines,)
    spectrum: FloatArray  # of the noise, response unit squared, shape (lines,)
    spread: float  # relative variance of a line of the spectrum
    noise_from: str  # origin and assumption of the noise, in words
    degrees_of_freedom: float  # of the noise's total variance

    def noise(self, frequency_hz: FloatArray) -> FloatArray:
        """Return the spectrum of the noise at other frequencies.

        It is interpolated, and constant beyond the last line.
        """
        return np.interp(frequency_hz, self.frequency_hz, self.spectrum)

    @property
    def noise_deviation(self) -> float:
        """Return the standard deviation of the noise, response unit."""
        return float(
            np.sqrt(np.trapezoid(self.spectrum, self.frequency_hz) / self.frequency_hz[-1])
        )


def estimate_baseline(record: Record, noise: float | None = None) -> Baseline:
    """Estimate rest, offset and noise of a record's response, before any model.

    Args:
        record: with valid samples marked.
        noise: standard deviation of white noise of the response, response unit; None: estimated.
    """
    values = bridged_response(record)
    rest_samples = _count_rest(values) if record.excitation in BEGINS_AT_REST else 0
    quiet_values = values[:rest_samples]
    frequency = np.array([0.0, 0.5 * record.sampling_rate_hz])
    if noise is not None:
        spectrum = np.full(2, noise**2 + np.finfo(float).tiny)
        noise_from = "stated by the user, assumed white"
        freedom = np.inf
        spread = 0.0
    elif rest_samples >= MIN_SPECTRUM_SAMPLES:
        frequency, spectrum = _spectrum_at_rest(quiet_values, record.sampling_rate_hz)
        freedom = REST_FREEDOM_SHARE * rest_samples
        spread = 1.0 / WELCH_AVERAGES
        noise_from = (
            f"spectrum of the first {rest_samples} samples, before the motion; assumed stationary"
        )
    else:
        spectrum = np.full(2, _plateau(values))
        freedom = float(PLATEAU_LINES)
        spread = 2.0 / PLATEAU_LINES
        noise_from = (
            "least level of the response's own spectrum, assumed white: there is no rest before "
            "the motion"
        )
    quantisation = resolution(values) ** 2 / 12.0
    spectrum = np.maximum(spectrum, max(quantisation, np.finfo(float).tiny))
    if rest_samples > 0:
        offset = float(np.mean(quiet_values))
        low = float(np.mean(spectrum[: max(1, len(spectrum) // 16)]))
        offset_uncertainty = float(np.sqrt(low / rest_samples))
        offset_from = f"mean of the first {rest_samples} samples, at rest"
    else:
        offset, offset_uncertainty = _offset_in_motion(values)
        offset_from = "mean of the record: the acceleration's constant part is removed with it"
    return Baseline(
        rest_samples,
        rest_samples > 0 and _ends_at_rest(values, rest_samples),
        offset,
        offset_uncertainty,
        offset_from,
        frequency,
        spectrum,
        spread,
        noise_from,
        freedom,
    )


def _offset_in_motion(values: FloatArray) -> tuple[float, float]:
    """Return the mean of a record behind a Hann window, and its standard uncertainty.

    A motion of few periods has a mean itself. The uncertainty is the size of the second line above
    zero, the first that the offset does not reach.
    """
    weights = np.hanning(values.size)
    offset = float(np.average(values, weights=weights))
    turns = np.exp(-4j * np.pi * np.arange(values.size) / values.size)
    line = np.sum((values - offset) * weights * turns)
    return offset, float(np.sqrt(2.0) * np.abs(line) / np.sum(weights))


def screened_by_response(
    records: Sequence[Record], unit: str
) -> tuple[list[Record], list[ScreeningFinding]]:
    """Screen the records as for a fit, but by their response.

    Samples of the reference alone are not needed. ``unit``: of the response.

    Raises:
        InputError: no record has a usable response.
    """
    usable = []
    findings = []
    refusal = None
    for record in records:
        try:
            screened, remarks = _screen_response(record, unit)
        except InputError as error:
            refusal = error
            remarks = [ScreeningFinding("dead_channel", f"{error.found}")]
        else:
            usable.append(screened)
        findings += remarks
    if refusal is not None and not usable:
        raise refusal
    return usable, findings


def _screen_response(record: Record, unit: str) -> tuple[Record, list[ScreeningFinding]]:
    """Return a record with its valid samples marked, and the findings of its response.

    Raises:
        InputError: it has no usable response.
    """
    units = {"response": unit}
    (by_response,), findings = screen([replace(record, reference=None, excitation="decay")], units)
    by_both = None
    if record.reference is not None:
        with suppress(InputError):
            (by_both,), findings_of_both = screen([record], units)
    if by_both is None:
        reference_valid = np.zeros(record.samples, dtype=bool)
        screened = replace(record, valid=by_response.mask, reference_valid=reference_valid)
        return screened, list(findings)
    # Where the reference moves as oddly, the response's oddity is motion.
    valid = by_response.mask | by_both.mask
    findings = [finding for finding in findings if finding in findings_of_both]
    lost_times = [f for f in findings_of_both if f.code == "clock_suspect"]  # of both channels
    if lost_times:
        for edge in np.flatnonzero(np.diff(by_both.mask.astype(int))).tolist():
            valid[max(edge - MAX_BRIDGED_SAMPLES, 0) : edge + MAX_BRIDGED_SAMPLES] = False
        cause = lost_times[0].message.split(";")[0]
        message = f"{cause}; the samples beside that are left out."
        findings.append(ScreeningFinding("clock_suspect", message))
    return replace(record, valid=valid, reference_valid=by_both.reference_mask), findings


def bridged_response(record: Record) -> FloatArray:
    """Return the response with straight lines where samples are not valid, shape (samples,)."""
    return bridged(record.response, record.mask)


def bridged(values: FloatArray, valid: BoolArray) -> FloatArray:
    """Return the values with straight lines where they are not known, shape (samples,)."""
    values = np.array(values)
    index = np.arange(values.size)
    values[~valid] = np.interp(index[~valid], index[valid], values[valid])
    return values


def gap_sum_deviation(values: FloatArray, valid: BoolArray) -> FloatArray:
    """Return the standard deviation of the response's sum behind bridged gaps, shape (samples,).

    It follows from sums of as many samples nearby, less those of the line that would bridge them,
    and is infinite behind a gap that is not short.
    """
    variance = np.zeros(values.size)
    for first, stop in zip(*runs_of_true(~valid), strict=True):
        count = stop - first
        near = slice(max(first - NEARBY_SAMPLES, 0), stop + NEARBY_SAMPLES)
        windows = np.lib.stride_tricks.sliding_window_view(values[near], count + 2)
        complete = np.lib.stride_tricks.sliding_window_view(valid[near], count + 2).all(axis=1)
        error = np.sum(windows[:, 1:-1], axis=1) - 0.5 * count * (windows[:, 0] + windows[:, -1])
        usable = count <= MAX_BRIDGED_SAMPLES and complete.any()
        variance[first:] += float(np.mean(error[complete] ** 2)) if usable else np.inf
    return np.sqrt(variance)


def periodogram(values: FloatArray, window: FloatArray, size: int | None = None) -> FloatArray:
    """Return the power of windowed values at the lines of their transform, scaled as a spectrum.

    ``size``: length of the transform.
    """
    return np.abs(np.asarray(fft.rfft(values * window, size))) ** 2 / np.sum(window**2)


def _rest_test_samples(values: FloatArray) -> int:
    return min(max(MIN_REST_SAMPLES, int(REST_TEST_SHARE * values.size)), values.size // 4)


def _count_rest(values: FloatArray) -> int:
    """Return the number of samples at rest at the beginning."""
    count = _rest_test_samples(values)
    if count < 8:
        return 0
    for _ in range(2):  # a longer part improves the noise, and thereby the end of the rest
        moving = _find_motion(values, values[:count])
        if moving is None:
            return 0
        onset = int(moving[0]) if moving.size else values.size
        if onset < count // 2:
            return 0
        count = max(8, int(USED_REST_SHARE * onset))
    while count >= 8 * REST_PARTS and _departs(values[:count]):
        count = int(USED_REST_SHARE * count)
    return count


def _departs(values: FloatArray) -> bool:
    """Return whether the last of several parts differs from the others, as in a gradual motion."""
    length = values.size // REST_PARTS
    means = values[: length * REST_PARTS].reshape(REST_PARTS, length).mean(axis=1)
    return bool(abs(means[-1] - means[:-1].mean()) > MAX_PART_DEVIATIONS * means[:-1].std(ddof=1))


def rest_to_borrow(record: Record) -> int:
    """Return the number of samples at rest at the end of a shock that can precede it.

    A triggered record may begin with the motion. If its first sample is at the level to which the
    motion returns, the sensor was at rest before.
    """
    values = bridged_response(record)
    if record.excitation != "shock" or _count_rest(values) > 0:
        return 0
    count = _rest_test_samples(values)
    if count < 8:
        return 0
    quiet_values = values[-count:]
    moving = _find_motion(values, quiet_values)
    if moving is None:
        return 0
    distance = np.abs(values - np.mean(quiet_values))
    if distance[0] > max(
        ONSET_DEVIATIONS * np.std(quiet_values), 0.5 * MAX_REST_DEVIATION * np.max(distance)
    ):
        return 0
    still = values.size - 1 - int(moving[-1]) if moving.size else 0
    return min(int(USED_REST_SHARE * still), values.size // 3)


def _find_motion(values: FloatArray, quiet_values: FloatArray) -> NDArray[np.intp] | None:
    """Return the indices of samples in motion; None if the part of a record is not quiet.

    A sample at rest is near the level of ``quiet_values``: within their noise, the steps of the
    converter, and what rounding leaves.
    """
    deviation = float(np.std(quiet_values))
    distance = np.abs(values - float(np.mean(quiet_values)))
    largest = float(np.max(distance))
    if deviation > MAX_REST_DEVIATION * largest:
        return None
    limit = max(ONSET_DEVIATIONS * deviation, MIN_ONSET_STEPS * resolution(values), 1e-9 * largest)
    return np.flatnonzero(distance > limit)


def _ends_at_rest(values: FloatArray, rest_samples: int) -> bool:
    """Return whether the last part has the level and the noise of the first."""
    first = values[:rest_samples]
    last = values[-_rest_test_samples(values) :]
    still = float(np.std(first)) + 1e-9 * float(np.ptp(values))
    return bool(np.std(last) < 2.0 * still and abs(np.mean(last) - np.mean(first)) < 2.0 * still)


def _spectrum_at_rest(values: FloatArray, rate: float) -> tuple[FloatArray, FloatArray]:
    """Return frequencies and spectrum by Welch's estimate.

    It takes eighths of the rest, half overlapping, with a Hann window.
    """
    length = min(max(32, values.size // 8), values.size)
    window = np.hanning(length + 1)[:-1]
    # Only the mean of all is removed: slower signals are in the lowest lines.
    blocks = np.lib.stride_tricks.sliding_window_view(values - values.mean(), length)[
        :: length - length // 2
    ]
    power = np.mean(np.abs(np.asarray(fft.rfft(blocks * window))) ** 2, axis=0) / np.sum(window**2)
    spectrum = power[: (length + 1) // 2]
    frequency = np.arange(len(spectrum)) * rate / length
    if frequency[-1] < 0.5 * rate:
        frequency = np.append(frequency, 0.5 * rate)
        spectrum = np.append(spectrum, spectrum[-1])
    return frequency, spectrum


def _plateau(values: FloatArray) -> float:
    """Return the smallest smoothed level of the record's spectrum.

    It is noise alone, if motion is absent at some frequency.
    """
    window = np.hanning(values.size)
    power = periodogram(values - values.mean(), window)
    lines = min(PLATEAU_LINES, max(4, power.size // 8))
    blocks = power[: power.size // lines * lines].reshape(-1, lines)
    means = np.mean(blocks[1:] if len(blocks) > 1 else blocks, axis=1)
    deviation = np.sqrt(HANN_LINE_VARIANCE / lines)  # of an average, relative
    low = float(np.quantile(means, PLATEAU_QUANTILE))
    return low * (1.0 + PLATEAU_DEVIATIONS * deviation)
