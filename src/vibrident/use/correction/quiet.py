"""A record's response besides the motion: rest before and after it, offset, and the noise's spectrum.

A spectrum S(f) here is a variance per sample: white noise of variance σ² has S = σ² at every frequency, and a filter
G leaves the variance mean |G|² S over all frequencies from −half to half the sampling rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft

from vibrident.base.errors import InputError
from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.data.records.basis import resolution, runs_of_true
from vibrident.data.screening import Finding, screen

#: Motions that may begin after a rest; ``decay`` stands for any motion without a reference. Others begin gradually,
#: which could be taken for rest.
BEGINS_AT_REST = ("shock", "decay")
REST_SHARE = 0.02  # part of a record, at its beginning or end, that is tested for rest
FEWEST_REST = 32  # fewest samples of that part
STILL = 0.02  # it is at rest if its standard deviation is below this part of the largest deviation from its level
LEAVES = 6.0  # rest lasts until the response leaves the level by this many standard deviations
USED = 0.9  # part of the rest that is used
PARTS = 8  # parts in which a rest is examined
DEPARTS = 4.0  # the last part may differ from the others by this many of their standard deviations
FEWEST_FOR_SPECTRUM = 128  # least samples at rest from which a spectrum of the noise is taken
WELCH_AVERAGES = 12.0  # eighths of the rest, half overlapping, are worth so many averages (Welch 1967, Hann)
SHORT = 4  # longest gap of the response over which an integral goes on, samples …
BESIDE = 32  # … with the error that bridges within so many samples beside it have
PLATEAU_LINES = 64  # lines averaged when the noise is estimated beside the motion


@dataclass(frozen=True, eq=False)
class Surroundings:
    """A record besides its motion."""

    rest_samples: int  # samples at rest from the first one on; zero where the record begins in the middle of a motion
    rests_at_end: bool  # whether it also ends at rest
    offset: float  # constant to be subtracted, response unit
    offset_uncertainty: float  # its standard uncertainty
    offset_from: str  # its origin, in words
    frequency_hz: FloatArray  # of the spectrum, ascending from zero, shape (lines,)
    spectrum: FloatArray  # of the noise, response unit squared, shape (lines,)
    spread: float  # relative variance of a line of the spectrum
    noise_from: str  # origin and assumption of the noise, in words
    degrees_of_freedom: float  # of the noise's total variance

    def noise(self, frequency_hz: FloatArray) -> FloatArray:
        """Spectrum of the noise at other frequencies, interpolated; constant beyond the last line."""
        return np.interp(frequency_hz, self.frequency_hz, self.spectrum)

    @property
    def noise_deviation(self) -> float:
        """Standard deviation of the noise, response unit."""
        return float(np.sqrt(np.trapezoid(self.spectrum, self.frequency_hz) / self.frequency_hz[-1]))


def surroundings(record: Record, noise: float | None = None) -> Surroundings:
    """Look at a record's response before any model.

    ``record``: with valid samples marked; ``noise``: standard deviation of white noise of the response, response unit;
    None: estimated.
    """
    values = filled(record)
    rest = _rest(values) if record.excitation in BEGINS_AT_REST else 0
    ends = rest > 0 and _returns(values, rest)
    half = 0.5 * record.sampling_rate_hz
    quantum = resolution(values) ** 2 / 12.0
    if noise is not None:
        frequency, spectrum = np.array([0.0, half]), np.full(2, noise**2 + np.finfo(float).tiny)
        words, freedom, spread = "stated by the user, assumed white", np.inf, 0.0
    elif rest >= FEWEST_FOR_SPECTRUM:
        frequency, spectrum = _spectrum_at_rest(values[:rest], record.sampling_rate_hz)
        freedom, spread = 0.9 * rest, 1.0 / WELCH_AVERAGES
        words = f"spectrum of the first {rest} samples, before the motion; assumed stationary"
    else:
        level = _plateau(values)
        frequency, spectrum, freedom = np.array([0.0, half]), np.full(2, level), float(PLATEAU_LINES)
        spread = 2.0 / PLATEAU_LINES
        words = "least level of the response's own spectrum, assumed white: there is no rest before the motion"
    spectrum = np.maximum(spectrum, max(quantum, np.finfo(float).tiny))
    if rest > 0:
        offset = float(np.mean(values[:rest]))
        low = float(np.mean(spectrum[: max(1, len(spectrum) // 16)]))
        uncertainty, origin = float(np.sqrt(low / rest)), f"mean of the first {rest} samples, at rest"
    else:
        weights = np.hanning(values.size)
        offset = float(np.average(values, weights=weights))
        # A motion of few periods has a mean of its own. The second line beside zero is the first without offset.
        slow = np.sum((values - offset) * weights * np.exp(-4j * np.pi * np.arange(values.size) / values.size))
        uncertainty = float(np.sqrt(2.0) * np.abs(slow) / np.sum(weights))
        origin = "mean of the record: the acceleration's constant part is removed with it"
    return Surroundings(rest, ends, offset, uncertainty, origin, frequency, spectrum, spread, words, freedom)


def screened(given: Sequence[Record], unit: str) -> tuple[list[Record], list[Finding]]:
    """The records as screened for a fit, but by their response: samples of the reference alone are not needed.

    ``unit``: of the response.
    """
    kept, findings, refused = [], [], None
    for record in given:
        try:
            (own,), said = screen([replace(record, reference=None, excitation="decay")], {"response": unit})
        except InputError as error:
            refused = error
            findings.append(Finding("dead_channel", f"{error.found}"))
            continue
        valid, known = own.mask, np.zeros(record.samples, dtype=bool)
        if record.reference is not None:
            with suppress(InputError):
                (both,), of_both = screen([record], {"response": unit})
                # Where the reference moves as oddly, the response's oddity is motion.
                valid, known = own.mask | both.mask, both.reference_mask
                lost_time = [f for f in of_both if f.code == "clock_suspect"]  # both channels show it
                if lost_time:
                    for edge in np.flatnonzero(np.diff(both.mask.astype(int))).tolist():
                        valid[max(edge - SHORT, 0) : edge + SHORT] = False
                    text = f"{lost_time[0].message.split(';')[0]}; the samples beside that are left out."
                    lost_time = [Finding("clock_suspect", text)]
                said = (*(f for f in said if f in of_both), *lost_time)
        kept.append(replace(record, valid=valid, reference_valid=known))
        findings += said
    if refused is not None and not kept:
        raise refused
    return kept, findings


def filled(record: Record) -> FloatArray:
    """The response with samples that are not valid replaced by straight lines; shape (samples,)."""
    return bridged(record.response, record.mask)


def bridged(values: FloatArray, known: BoolArray) -> FloatArray:
    """Values with straight lines where they are not known; shape (samples,)."""
    values, index = np.array(values), np.arange(values.size)
    values[~known] = np.interp(index[~known], index[known], values[known])
    return values


def step_behind(values: FloatArray, known: BoolArray) -> FloatArray:
    """Standard deviation of the error of the response's sum behind short gaps that were bridged; shape (samples,).

    From sums of as many samples nearby less those of the line beside them; infinite behind a longer gap.
    """
    variance = np.zeros(values.size)
    for first, stop in zip(*runs_of_true(~known), strict=True):
        count = stop - first
        near = slice(max(first - BESIDE, 0), stop + BESIDE)
        windows = np.lib.stride_tricks.sliding_window_view(values[near], count + 2)
        whole = np.lib.stride_tricks.sliding_window_view(known[near], count + 2).all(axis=1)
        error = np.sum(windows[:, 1:-1], axis=1) - 0.5 * count * (windows[:, 0] + windows[:, -1])
        usable = count <= SHORT and whole.any()
        variance[first:] += float(np.mean(error[whole] ** 2)) if usable else np.inf
    return np.sqrt(variance)


def periodogram(values: FloatArray, window: FloatArray, size: int | None = None) -> FloatArray:
    """Power of windowed values at the lines of their transform, of length ``size``, in the scale of a spectrum here."""
    return np.abs(np.asarray(fft.rfft(values * window, size))) ** 2 / np.sum(window**2)


def _block(values: FloatArray) -> int:
    return min(max(FEWEST_REST, int(REST_SHARE * values.size)), values.size // 4)


def _rest(values: FloatArray) -> int:
    """Number of samples at rest at the beginning."""
    count = _block(values)
    if count < 8:
        return 0
    for _ in range(2):  # a longer part improves the noise, and thereby the end of the rest
        level, swing = float(np.mean(values[:count])), float(np.std(values[:count]))
        away = np.abs(values - level)
        largest = float(np.max(away))
        if swing > STILL * largest:
            return 0
        leaves = max(LEAVES * swing, 1.5 * resolution(values), 1e-9 * largest)
        beyond = np.flatnonzero(away > leaves)
        onset = int(beyond[0]) if beyond.size else values.size
        if onset < count // 2:
            return 0
        count = max(8, int(USED * onset))
    while count >= 8 * PARTS and _departs(values[:count]):
        count = int(USED * count)
    return count


def _departs(values: FloatArray) -> bool:
    """Whether the last of several parts differs from the others: a motion that begins gradually."""
    length = values.size // PARTS
    means = values[: length * PARTS].reshape(PARTS, length).mean(axis=1)
    return bool(abs(means[-1] - means[:-1].mean()) > DEPARTS * means[:-1].std(ddof=1))


def rest_to_borrow(record: Record) -> int:
    """Number of samples at rest at the end of a shock's record that can replace the rest before it.

    A triggered record may begin with the motion. If its first sample is at the level to which the motion returns, the
    sensor was at rest before.
    """
    values = filled(record)
    if record.excitation != "shock" or _rest(values) > 0:
        return 0
    count = _block(values)
    if count < 8:
        return 0
    last = values[-count:]
    level, swing = float(np.mean(last)), float(np.std(last))
    away = np.abs(values - level)
    largest = float(np.max(away))
    if swing > STILL * largest or away[0] > max(LEAVES * swing, 0.5 * STILL * largest):
        return 0
    moving = np.flatnonzero(away > max(LEAVES * swing, 1.5 * resolution(values), 1e-9 * largest))
    still = values.size - 1 - int(moving[-1]) if moving.size else 0
    return min(int(USED * still), values.size // 3)


def _returns(values: FloatArray, rest: int) -> bool:
    """Whether the last part has the level and the noise of the first."""
    first, last = values[:rest], values[-_block(values) :]
    still = float(np.std(first)) + 1e-9 * float(np.ptp(values))
    return bool(np.std(last) < 2.0 * still and abs(np.mean(last) - np.mean(first)) < 2.0 * still)


def _spectrum_at_rest(values: FloatArray, rate: float) -> tuple[FloatArray, FloatArray]:
    """Welch's estimate: eighths of the rest, half overlapping, Hann; frequencies and spectrum."""
    length = min(max(32, values.size // 8), values.size)
    window = np.hanning(length + 1)[:-1]
    # Only the mean of all is removed: slower signals are in the lowest lines.
    parts = np.lib.stride_tricks.sliding_window_view(values - values.mean(), length)[:: length - length // 2]
    power = np.mean(np.abs(np.asarray(fft.rfft(parts * window))) ** 2, axis=0) / np.sum(window**2)
    spectrum = power[: (length + 1) // 2]
    frequency = np.arange(len(spectrum)) * rate / length
    if frequency[-1] < 0.5 * rate:
        frequency, spectrum = np.append(frequency, 0.5 * rate), np.append(spectrum, spectrum[-1])
    return frequency, spectrum


def _plateau(values: FloatArray) -> float:
    """Least smoothed level of the record's own spectrum: noise alone, if motion is absent somewhere."""
    window = np.hanning(values.size)
    power = periodogram(values - values.mean(), window)
    lines = min(PLATEAU_LINES, max(4, power.size // 8))
    blocks = power[: power.size // lines * lines].reshape(-1, lines)
    return float(np.quantile(np.mean(blocks[1:] if len(blocks) > 1 else blocks, axis=1), 0.1)) * (
        1.0 + 1.28 * np.sqrt(1.94 / lines)  # the tenth part of averages over so many correlated lines lies that low
    )
