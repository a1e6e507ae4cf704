"""Search for the ratio of two clocks at which a rational transfer function explains most."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy import fft
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
MIN_POWER = 1e-4  # of a bin over the strongest of its record, to count as motion
LOBE_BINS = 5  # of a tone under the window
ITERATIONS = 3  # of the linearised fit
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)  # of an interval, the longer part
PRECISION = 1e-3  # of the valley's width; the test of departures from the fit gives the last digits
MIN_GAIN = 4.0  # by which the unexplained part must fall; leakage of short records makes 3
FIRST_SAMPLES = 1 << 11  # in which the search begins
LAST_SAMPLES = 1 << 17  # beyond which the valley is so narrow that the fit itself follows
FINER = 8  # points of the interpolation between two samples; the search needs no better one


@dataclass(frozen=True, eq=False)
class _Channels:
    """Both channels of a record about their means, shape (samples,)."""

    reference: FloatArray
    response: FloatArray
    rate_hz: float

    @classmethod
    def from_record(cls, record: Record) -> _Channels:
        """Build the channels of a record with a reference."""
        assert record.reference is not None
        n = min(record.samples, LAST_SAMPLES)
        response = about_mean(record.response, record.mask)[:n]
        reference = about_mean(record.reference, record.reference_mask)[:n]
        return cls(reference, response, record.sampling_rate_hz)

    @property
    def samples(self) -> int:
        """Return the number of samples."""
        return len(self.reference)

    def moves_in(self, samples: int) -> bool:
        """Return whether the first samples hold a quarter of the motion's mean power, windowed."""
        power = self.reference**2
        n = min(samples, self.samples)
        return float(hann(n) ** 2 @ power[:n]) / n >= 0.25 * float(np.mean(power))

    @functools.cached_property
    def finer(self) -> FloatArray:
        """Return the response at FINER points a sample."""
        bins = np.zeros(self.samples * FINER // 2 + 1, dtype=complex)
        bins[: self.samples // 2 + 1] = fft.rfft(self.response)
        return fft.irfft(bins, self.samples * FINER) * FINER

    def at(self, offset: float, samples: int) -> FloatArray:
        """Return the response at the first instants of the reference, shape (samples,)."""
        if offset == 0.0:
            return self.response[:samples]
        places = np.arange(samples) * (FINER / (1.0 + offset))
        np.minimum(places, len(self.finer) - 1, out=places)
        before = np.minimum(places.astype(int), len(self.finer) - 2)
        value = self.finer[before]
        return value + (places - before) * (self.finer[before + 1] - value)

    def motion(self, samples: int) -> _Motion:
        """Return the reference in a band that holds all of the motion, cached by length."""
        if samples not in self._motions:
            n = min(samples, self.samples)
            x = fft.rfft(self.reference[:n] * hann(n))
            power = power_of(x[: int(USABLE_BAND * n) + 1])
            power[:2] = 0.0  # means under the window
            bins = np.flatnonzero(power > MIN_POWER * np.max(power))
            first = max(int(bins[0] * (1.0 - MAX_OFFSET)) - 2, 1)
            last = min(int(bins[-1] * (1.0 + MAX_OFFSET)) + 3, n // 2 + 1)
            hz = np.asarray(bins * (self.rate_hz / n), dtype=float)
            self._motions[samples] = _Motion(n, slice(first, last), bins, hz, x[bins])
        return self._motions[samples]

    @functools.cached_property
    def _motions(self) -> dict[int, _Motion]:
        """Return the cache of the motion, by number of samples."""
        return {}

    def response_at(self, offset: float, samples: int) -> _BandResponse:
        """Return the response at the bins of the motion."""
        motion = self.motion(samples)
        y = fft.rfft(self.at(offset, motion.samples) * hann(motion.samples))
        total = float(np.sum(power_of(y[motion.band]))) or 1.0
        return _BandResponse(y[motion.bins], total)

    def delay_s(self, response: ComplexArray, samples: int) -> float:
        """Return the delay of most of a response at the bins of the motion."""
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
        response = fft.rfft(self.response[:n] * hann(n))[bins]
        reference = motion.reference, difference
        phases = Phases.between(reference, response, motion.hz, self.rate_hz / n)
        return agreed_delay(phases, n / self.rate_hz, float(motion.hz[-1]))


class _Motion(NamedTuple):
    """Reference of a record at the bins where there is motion.

    Attributes:
        samples: number of samples n.
        band: bins that hold all of the motion at any ratio of the clocks.
        bins: those with motion, shape (K,).
        hz: their frequencies, shape (K,).
        reference: the reference there, shape (K,).
    """

    samples: int
    band: slice
    bins: NDArray[np.int_]
    hz: FloatArray
    reference: ComplexArray


class _BandResponse(NamedTuple):
    """Response of a record at the bins where there is motion.

    Attributes:
        response: shape (K,).
        total: power of the response in the whole band.
    """

    response: ComplexArray
    total: float


def _delay_samples(motion: _Motion, response: ComplexArray) -> int:
    """Return the delay of the impulse response's peak, 0 where a sensor's poles may explain it."""
    n = motion.samples
    x = motion.reference
    ratio = np.zeros(n // 2 + 1, dtype=complex)
    power = power_of(x)
    ratio[motion.bins] = response * np.conj(x) / (power + POWER_FLOOR * np.max(power))
    peak = int(np.argmax(np.abs(fft.irfft(ratio, n))))
    peak = peak if peak < n // 2 else peak - n
    return peak if abs(peak) >= MIN_DELAY_SAMPLES else 0


class _Basis(NamedTuple):
    """Powers of the frequencies of all bins with motion.

    Attributes:
        hz: the frequencies, shape (K,).
        powers: of jω over the highest, shape (orders, K).
        poles: order of the denominator.
        zeros: order of the numerator.
    """

    hz: FloatArray
    powers: ComplexArray
    poles: int
    zeros: int


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
        """Build the search in the records that have a reference."""
        driven = tuple(_Channels.from_record(r) for r in records if r.reference is not None)
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
            channels.motion(samples).hz[-1] * min(samples, channels.samples) / channels.rate_hz
            for channels in self.driven
        )

    def unexplained(self, offset: float, samples: int, enough: float = 0.0) -> float:
        """Return the fraction of the response's power that no rational function explains.

        Where it is large at no offset, another delay is tried: the impulse response of tones has
        many peaks, and a wrong delay must not pass for two clocks. Below ``enough`` it is not
        sought any lower.
        """
        responses = [channels.response_at(offset, samples) for channels in self.driven]
        longest = max(range(len(responses)), key=lambda row: len(responses[row].response))
        delay_s = 0.0
        if self.delayed:
            delay_s = self.driven[longest].delay_s(responses[longest].response, samples)
        fraction = self._unexplained_at(responses, samples, delay_s, enough)
        if offset != 0.0 or not self.delayed or fraction < FIRST_ORDER:
            return fraction
        delay_s = self.driven[longest].agreed_delay_s(samples)
        return min(fraction, self._unexplained_at(responses, samples, delay_s, enough))

    def _unexplained_at(
        self, responses: Sequence[_BandResponse], samples: int, delay_s: float, enough: float
    ) -> float:
        """Return the unexplained fraction at a common delay, or one below ``enough``."""
        basis = self._basis(samples)
        sizes = [np.sqrt(measured.total) for measured in responses]
        references = [channels.motion(samples).reference for channels in self.driven]
        motion = np.concatenate([x / size for x, size in zip(references, sizes, strict=True)])
        response = np.concatenate(
            [measured.response / size for measured, size in zip(responses, sizes, strict=True)]
        )
        response = response * np.exp(2j * np.pi * delay_s * basis.hz)
        power = float(np.sum(power_of(response)))
        residual = _residual_power(basis, motion, response, power - (1.0 - enough) * len(responses))
        return max(1.0 - (power - residual) / len(responses), np.finfo(float).tiny)

    def _basis(self, samples: int) -> _Basis:
        """Return the powers of the bins with motion, cached by number of samples.

        The orders are limited to those that the number of tones determines.
        """
        if samples not in self._bases:
            hz = np.concatenate([channels.motion(samples).hz for channels in self.driven])
            tones = len(hz) // LOBE_BINS
            poles = int(np.clip(tones - 1, 0, self.poles))
            zeros = min(tones, self.zeros)
            powers = (1j * hz / hz.max()) ** np.arange(max(poles, zeros) + 1)[:, None]
            self._bases[samples] = _Basis(hz, powers, poles, zeros)
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
            width: half its width.
            samples: first samples that are used.
        """
        low = offset - width
        high = offset + width
        places = [high - GOLDEN * (high - low), low + GOLDEN * (high - low)]
        unexplained = [self.unexplained(place, samples) for place in places]
        while high - low > PRECISION * width:
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
    """
    pole_powers = basis.powers[1 : basis.poles + 1]
    zero_powers = basis.powers[: basis.zeros + 1]
    denominator = np.ones(len(motion), dtype=complex)
    rows = np.concatenate([pole_powers * response, -zero_powers * motion])
    least = np.inf
    for _ in range(ITERATIONS):
        weight = 1.0 / denominator
        columns = (rows * weight).view(float)
        gram = columns @ columns.T
        size = np.maximum(np.sqrt(np.diag(gram)), np.finfo(float).tiny)
        right_side = columns @ (response * weight).view(float) / size
        solution, *_ = np.linalg.lstsq(gram / size[:, None] / size, right_side, rcond=1e-11)
        factors = -solution / size
        denominator = 1.0 + factors[: basis.poles] @ pole_powers
        numerator = factors[basis.poles :] @ zero_powers
        residual = response - numerator / denominator * motion
        least = min(least, float(np.sum(power_of(residual))))
        if least < enough:
            break
    return least
