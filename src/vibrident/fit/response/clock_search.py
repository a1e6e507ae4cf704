"""Search for the ratio of two clocks at which a rational transfer function explains most.

The channels' derivatives are weighted by a window, not multiplied by powers of the frequency after
it: with a window that vanishes at its ends with its derivatives, what rings when a record begins or
ends leaves no residual (modulating functions; Shinbrot 1957).
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy import fft
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from vibrident.data.records import FloatArray, Record
from vibrident.fit.response.alignment import MIN_DELAY_SAMPLES, POWER_FLOOR
from vibrident.fit.response.phase_delay import Phases, agreed_delay
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import about_mean, hann, power_of
from vibrident.physics.discretisation.inputs import USABLE_BAND

MAX_OFFSET = 0.045  # of a clock without crystal: 4 %, and a margin
#: Unexplained fraction of the response, 0.14 rad, below which a departure serves to first order.
FIRST_ORDER = 0.02
MAX_ORDER = 6  # of the transfer function: two modes and a high-pass, or a delay of a period
#: Of a bin over the strongest of its record, to count as motion: power of both channels, as a
#: geometric mean.
MIN_POWER = 1e-4
LOBE_BINS = 7  # of a tone under the window
#: Bins of a squared Hann window about a bin.
WINDOW_BINS = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 16.0
WINDOW_REACH = len(WINDOW_BINS) // 2
ITERATIONS = 3  # of the linearised fit
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)  # of an interval, the longer part
PRECISION = 1e-3  # of the valley's width; the test of departures from the fit gives the last digits
MIN_GAIN = 4.0  # by which the unexplained part must fall; leakage of short records makes 3
#: Standard deviations of a shock's power in time on either side that the search sees: at two of
#: them Hann's window is at half its height.
REACH_OF_SHOCK = 4.0
FIRST_SAMPLES = 1 << 11  # in which the search begins
LAST_SAMPLES = 1 << 17  # beyond which the valley is so narrow that the fit itself follows
FINER = 8  # points of the interpolation between two samples; the search needs no better one


@dataclass(frozen=True, eq=False)
class _Channels:
    """Both channels of a record about their means.

    Attributes:
        reference: where it moves, shape (samples,).
        response: from the begin of the record, shape (first + samples or more,).
        rate_hz: of both.
        first: first sample of the reference in the record.
        duration: of the motion, in samples.
    """

    reference: FloatArray
    response: FloatArray
    rate_hz: float
    first: int
    duration: float

    @classmethod
    def from_record(cls, record: Record) -> _Channels:
        """Build the channels of a record with a reference."""
        assert record.reference is not None
        n = min(record.samples, LAST_SAMPLES)
        response = about_mean(record.response, record.mask)[:n]
        reference = about_mean(record.reference, record.reference_mask)[:n]
        first = 0
        last = n
        duration = float(n)
        if record.excitation == "shock":
            extents = [_extent(values) for values in (reference, response)]
            middles, spreads = np.transpose(extents)
            first = max(int(np.min(middles - REACH_OF_SHOCK * spreads)), 0)
            last = min(int(np.max(middles + REACH_OF_SHOCK * spreads)) + 1, n)
            duration = min(float(np.max(spreads)) * np.sqrt(12.0), duration)
        return cls(reference[first:last], response, record.sampling_rate_hz, first, duration)

    @property
    def samples(self) -> int:
        """Return the number of samples of the reference."""
        return len(self.reference)

    def duration_in(self, samples: int) -> float:
        """Return the duration, in samples, of the motion in the first samples."""
        return min(float(samples), self.duration)

    def moves_in(self, samples: int) -> bool:
        """Return whether the first samples hold a quarter of the motion's mean power, windowed."""
        power = self.reference**2
        n = min(samples, self.samples)
        return float(hann(n) ** 2 @ power[:n]) / n >= 0.25 * float(np.mean(power))

    @functools.cached_property
    def finer(self) -> FloatArray:
        """Return the response at FINER points a sample."""
        n = self.response.size
        bins = np.zeros(n * FINER // 2 + 1, dtype=complex)
        bins[: n // 2 + 1] = fft.rfft(self.response)
        return fft.irfft(bins, n * FINER) * FINER

    def at(self, offset: float, samples: int, delay_s: float = 0.0) -> FloatArray:
        """Return the response a delay after the first instants of the reference, shape (samples,).

        Before its first and after its last sample it is constant.
        """
        end = self.first + samples
        if offset == delay_s == 0.0:
            return self.response[self.first : end]
        places = (np.arange(self.first, end) + delay_s * self.rate_hz) * (FINER / (1.0 + offset))
        np.clip(places, 0.0, (self.response.size - 1) * FINER, out=places)
        before = np.minimum(places.astype(int), len(self.finer) - 2)
        value = self.finer[before]
        return value + (places - before) * (self.finer[before + 1] - value)

    def motion(self, samples: int) -> _Motion:
        """Return the reference in a band that holds all of the motion, cached by length."""
        if samples not in self._motions:
            n = min(samples, self.samples)
            reference, response = (fft.rfft(x) for x in (self.reference[:n], self.at(0.0, n)))
            highest = min(int(USABLE_BAND * n), n // 2 - WINDOW_REACH)
            usable = np.arange(WINDOW_REACH + 1, highest + 1)
            # That of both channels: a displacement is small where an acceleration is large.
            size, response_size = (
                np.abs(WINDOW_BINS @ _neighbours(x, usable)) for x in (reference, response)
            )
            size *= _largest_around(response_size, usable)
            bins = usable[size >= MIN_POWER * np.max(size)]
            first = max(int(bins[0] * (1.0 - MAX_OFFSET)) - 2, WINDOW_REACH)
            last = min(int(bins[-1] * (1.0 + MAX_OFFSET)) + 3, n // 2 + 1 - WINDOW_REACH)
            hz = np.asarray(bins * (self.rate_hz / n), dtype=float)
            self._motions[samples] = _Motion(
                n, np.arange(first, last), bins, hz, _neighbours(reference, bins)
            )
        return self._motions[samples]

    @functools.cached_property
    def _motions(self) -> dict[int, _Motion]:
        """Return the cache of the motion, by number of samples."""
        return {}

    def response_at(self, offset: float, samples: int, delay_s: float = 0.0) -> _BandResponse:
        """Return the response at the bins of the motion, a delay after it."""
        motion = self.motion(samples)
        response = fft.rfft(self.at(offset, motion.samples, delay_s))
        total = float(np.sum(power_of(WINDOW_BINS @ _neighbours(response, motion.band)))) or 1.0
        return _BandResponse(_neighbours(response, motion.bins), total)

    def delay_s(self, response: ComplexArray, samples: int) -> float:
        """Return the delay of most of a response at the motion's bins and their neighbours."""
        motion = self.motion(samples)
        enough = len(motion.bins) > MAX_ORDER * LOBE_BINS
        return _delay_samples(motion, response) / self.rate_hz if enough else 0.0

    def agreed_delay_s(self, samples: int) -> float:
        """Return the delay at which the phases between the channels agree at no offset, s."""
        motion = self.motion(samples)
        n = motion.samples
        bins = motion.bins
        # A sine as window makes half the difference of the bins before and after each.
        sine = np.sin(np.arange(n) * (2.0 * np.pi / n))
        difference = 1j * fft.rfft(self.reference[:n] * sine)[bins]
        reference, response = (
            fft.rfft(channel * hann(n))[bins] for channel in (self.reference[:n], self.at(0.0, n))
        )
        phases = Phases.between((reference, difference), response, motion.hz, self.rate_hz / n)
        return agreed_delay(phases, n / self.rate_hz, float(motion.hz[-1]))


class _Motion(NamedTuple):
    """Reference of a record at the bins where there is motion.

    Attributes:
        samples: number of samples n.
        band: bins that hold all of the motion at any ratio of the clocks.
        bins: those with motion, shape (K,).
        hz: their frequencies, shape (K,).
        reference: the reference there, without a window, at the bins of the window about each,
            shape (window, K).
    """

    samples: int
    band: NDArray[np.int_]
    bins: NDArray[np.int_]
    hz: FloatArray
    reference: ComplexArray


class _BandResponse(NamedTuple):
    """Response of a record at the bins where there is motion.

    Attributes:
        response: without a window, at the bins of the window about each, shape (window, K).
        total: power of the windowed response in the whole band.
    """

    response: ComplexArray
    total: float


def _extent(values: FloatArray) -> tuple[float, float]:
    """Return the middle of a channel's power in time, and its standard deviation, in samples."""
    power = values**2
    times = np.arange(values.size)
    total = float(np.sum(power)) or 1.0
    middle = float(power @ times) / total
    return middle, float(np.sqrt(power @ (times - middle) ** 2 / total))


def _delay_samples(motion: _Motion, response: ComplexArray) -> int:
    """Return the delay of the impulse response's peak, 0 where a sensor's poles may explain it."""
    n = motion.samples
    x, y = (WINDOW_BINS @ lines for lines in (motion.reference, response))
    ratio = np.zeros(n // 2 + 1, dtype=complex)
    power = power_of(x)
    if not np.any(power):
        return 0
    ratio[motion.bins] = y * np.conj(x) / (power + POWER_FLOOR * np.max(power))
    peak = int(np.argmax(np.abs(fft.irfft(ratio, n))))
    peak = peak if peak < n // 2 else peak - n
    return peak if abs(peak) >= MIN_DELAY_SAMPLES else 0


def _largest_around(values: FloatArray, bins: NDArray[np.int_]) -> FloatArray:
    """Return the largest of the values about each bin, wherever a clock may move its frequency.

    That is at most into the next band of the ratio 1 + MAX_OFFSET, and the window's lobes reach
    into one more.

    Args:
        values: at the bins, shape (K,).
        bins: consecutive ones, shape (K,).
    """
    bands = np.floor(np.log(bins) / np.log1p(MAX_OFFSET)).astype(int)
    begins = np.flatnonzero(np.diff(bands, prepend=-1))
    largest = np.maximum.reduceat(values, begins)
    around = np.max(sliding_window_view(np.pad(largest, 2), 5), axis=1)
    return np.repeat(around, np.diff(begins, append=bins.size))


def _neighbours(lines: ComplexArray, bins: NDArray[np.int_]) -> ComplexArray:
    """Return the lines of a transform at the bins of the window about some, shape (window, K)."""
    return lines[bins + np.arange(-WINDOW_REACH, WINDOW_REACH + 1)[:, None]]


class _Basis(NamedTuple):
    """Powers of the frequencies of all bins with motion.

    Attributes:
        powers: of jω over the highest, shape (orders, K).
        about: frequencies of the bins of the window about each, over the highest, (window, K).
        poles: order of the denominator.
        zeros: order of the numerator.
    """

    powers: ComplexArray
    about: FloatArray
    poles: int
    zeros: int

    def derivatives(self, lines: ComplexArray, order: int) -> ComplexArray:
        """Return derivatives under the window, to an order, shape (order + 1, K)."""
        rows = np.empty((order + 1, lines.shape[1]), dtype=complex)
        for number, row in enumerate(rows):
            np.matmul(WINDOW_BINS * 1j**number, lines, out=row)
            lines = lines * self.about
        return rows


@dataclass(frozen=True, eq=False)
class ClockSearch:
    """Search for the ratio of clocks at which a rational transfer function explains most.

    Records are scaled by their size, so that a large one does not decide alone; a common delay is
    that of the record with most bins.

    Attributes:
        driven: channels of the records that have a reference.
        poles: order of the denominator.
        zeros: order of the numerator.
        delayed: whether a common delay is allowed.
    """

    driven: tuple[_Channels, ...]
    poles: int
    zeros: int
    delayed: bool

    @classmethod
    def from_records(
        cls, records: Sequence[Record], poles: int, zeros: int, *, delayed: bool
    ) -> ClockSearch:
        """Build the search in the records that have a reference and a bin with its window."""
        driven = tuple(
            _Channels.from_record(record)
            for record in records
            if record.reference is not None and record.samples >= 2 * len(WINDOW_BINS)
        )
        return cls(driven, poles, zeros, delayed)

    def begin(self) -> int:
        """Return the number of samples with which the search begins.

        They show motion nearly as strong as that of a whole record.
        """
        samples = FIRST_SAMPLES
        while samples < LAST_SAMPLES and not any(
            channels.moves_in(samples) for channels in self.driven
        ):
            samples *= 2
        return samples

    def valley(self, samples: int) -> float:
        """Return the width of the valley: one over the periods of the fastest motion in samples."""
        return 1.0 / max(
            channels.motion(samples).hz[-1] * channels.duration_in(samples) / channels.rate_hz
            for channels in self.driven
        )

    def unexplained(self, offset: float, samples: int, enough: float = 0.0) -> float:
        """Return the fraction of the response's power that no rational function explains.

        Where it is large at no offset, another delay is tried: the impulse response of tones has
        many peaks, and a wrong delay must not pass for two clocks. Below ``enough`` it is not
        sought any lower.
        """
        responses = self._responses_at(offset, samples)
        fraction = np.inf
        if offset == 0.0 or not self.delayed:
            fraction = self._unexplained_by(responses, samples, enough)
            if not self.delayed or fraction < FIRST_ORDER:
                return fraction
        longest = max(range(len(responses)), key=lambda row: len(responses[row].response))
        channels = self.driven[longest]
        delays_s = [channels.delay_s(responses[longest].response, samples)]
        if offset == 0.0:
            delays_s.append(channels.agreed_delay_s(samples))
        for delay_s in delays_s:
            delayed = self._responses_at(offset, samples, delay_s) if delay_s else responses
            fraction = min(fraction, self._unexplained_by(delayed, samples, enough))
        return fraction

    def _responses_at(
        self, offset: float, samples: int, delay_s: float = 0.0
    ) -> list[_BandResponse]:
        """Return the responses of all records."""
        return [channels.response_at(offset, samples, delay_s) for channels in self.driven]

    def _unexplained_by(
        self, responses: Sequence[_BandResponse], samples: int, enough: float
    ) -> float:
        """Return the fraction of responses that is unexplained, or one below ``enough``."""
        basis = self._basis(samples)
        sizes = [np.sqrt(measured.total) for measured in responses]
        references = [channels.motion(samples).reference for channels in self.driven]
        motion_lines = np.concatenate(
            [x / size for x, size in zip(references, sizes, strict=True)], axis=1
        )
        response_lines = np.concatenate(
            [measured.response / size for measured, size in zip(responses, sizes, strict=True)],
            axis=1,
        )
        motion = basis.derivatives(motion_lines, basis.zeros)
        response = basis.derivatives(response_lines, basis.poles)
        power = float(np.sum(power_of(response[0])))
        residual = _residual_power(basis, motion, response, power - (1.0 - enough) * len(responses))
        return max(1.0 - (power - residual) / len(responses), np.finfo(float).tiny)

    def _basis(self, samples: int) -> _Basis:
        """Return the powers of the bins with motion, cached by number of samples.

        The orders are limited to those that the number of tones determines.
        """
        if samples not in self._bases:
            motions = [channels.motion(samples) for channels in self.driven]
            steps_hz = [
                channels.rate_hz / motion.samples
                for channels, motion in zip(self.driven, motions, strict=True)
            ]
            reach = np.arange(-WINDOW_REACH, WINDOW_REACH + 1)[:, None]
            hz = np.concatenate([motion.hz for motion in motions])
            hz_about = np.concatenate(
                [
                    motion.hz + step_hz * reach
                    for motion, step_hz in zip(motions, steps_hz, strict=True)
                ],
                axis=1,
            )
            tones = len(hz) // LOBE_BINS
            poles = int(np.clip(tones - 1, 0, self.poles))
            zeros = min(tones, self.zeros)
            powers = np.vander(1j * hz / hz.max(), max(poles, zeros) + 1, increasing=True).T
            self._bases[samples] = _Basis(powers, hz_about / hz.max(), poles, zeros)
        return self._bases[samples]

    @functools.cached_property
    def _bases(self) -> dict[int, _Basis]:
        """Return the cache of the powers, by number of samples."""
        return {}

    def bottom(self, offset: float, width: float, samples: int) -> float:
        """Return the bottom of a valley, by golden sections (Kiefer 1953).

        It is 0 where the valley is not much deeper there than at 0.

        Args:
            offset: middle of the valley.
            width: half its width; no clock is off by more than MAX_OFFSET.
            samples: first samples that are used.
        """
        low = max(offset - width, -MAX_OFFSET)
        high = min(offset + width, MAX_OFFSET)
        places = [high - GOLDEN * (high - low), low + GOLDEN * (high - low)]
        unexplained = [self.unexplained(place, samples) for place in places]
        while high - low > PRECISION * min(width, MAX_OFFSET):
            lower, upper = places
            if unexplained[0] < unexplained[1]:
                high = upper
                place = high - GOLDEN * (high - low)
                places = [place, lower]
                unexplained = [self.unexplained(place, samples), unexplained[0]]
            else:
                low = lower
                place = low + GOLDEN * (high - low)
                places = [upper, place]
                unexplained = [unexplained[1], self.unexplained(place, samples)]
        lowest = int(np.argmin(unexplained))
        gain = self.unexplained(0.0, samples) / unexplained[lowest]
        return places[lowest] if gain > MIN_GAIN else 0.0


def _residual_power(
    basis: _Basis, motion: ComplexArray, response: ComplexArray, enough: float
) -> float:
    """Return the power that the best of the linearised fits of a transfer function leaves.

    The first that leaves less than ``enough`` is the last.

    With more poles than the sensor has, later fits may be worse: a pole and a zero that cancel may
    lie anywhere.

    Args:
        basis: of the bins.
        motion: its derivatives under the window, shape (zeros + 1, K).
        response: likewise, shape (poles + 1, K).
        enough: power.
    """
    pole_powers = basis.powers[1 : basis.poles + 1]
    denominator = np.ones(response.shape[1], dtype=complex)
    rows = np.concatenate([response[1:], -motion])
    least = np.inf
    for _ in range(ITERATIONS):
        weight = 1.0 / denominator
        columns = (rows * weight).view(float)
        gram = columns @ columns.T
        size = np.maximum(np.sqrt(np.diag(gram)), np.finfo(float).tiny)
        right_side = columns @ (response[0] * weight).view(float) / size
        solution, *_ = np.linalg.lstsq(gram / size[:, None] / size, right_side, rcond=1e-11)
        factors = -solution / size
        denominator = 1.0 + factors[: basis.poles] @ pole_powers
        residual = (response[0] + factors @ rows) / denominator
        least = min(least, float(np.sum(power_of(residual))))
        if least < enough:
            break
    return least
