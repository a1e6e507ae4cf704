"""The ratio of the clocks of two devices, where it is so far from one that no model fits.

The response is read at instants t(1 + ε). Brought to the reference's clock it is what a rational
transfer function makes of the reference (Sanathanan & Koerner 1963), of an order that any sensor's
and a short delay's meets; elsewhere it has next to nothing in common with it. So ε is where that
function, fitted to the windowed bins of all records together, leaves least. The valley is as wide as
the inverse of the periods in a record: it is found in the first samples, where it is wide, and
followed as their number doubles.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy import fft
from numpy.typing import NDArray

from vibrident.data.records import FloatArray, Record
from vibrident.data.resampling import lost, resampled
from vibrident.fit.response.alignment import LATE, WHITENED
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.transform import about_mean, hann, power_of
from vibrident.physics.discretisation.inputs import USABLE_BAND

MAX_OFFSET = 0.045  # of a clock without crystal: 4 %, and a margin
MAX_ORDER = 6  # of the transfer function: two modes and a high-pass, or a delay of a period
MIN_POWER = 1e-4  # of a bin over the strongest of its record, to count as motion
LOBE_BINS = 5  # of a tone under the window
ITERATIONS = 3  # of the linearised fit
MAX_PERIODS = 8  # by which a transfer function may stand in for two clocks
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)  # of an interval, the longer part
PRECISION = 1e-3  # of the valley's width; the departure from the fit tells the last digits
#: Unexplained part of the response below which a departure is told to first order: 0.14 rad.
FIRST_ORDER = 0.02
MIN_GAIN = 4.0  # by which the unexplained part must fall; leakage of short records makes 3
FIRST_SAMPLES = 1 << 11  # in which the search begins
LAST_SAMPLES = 1 << 17  # beyond which the valley is so narrow that the fit goes on by itself
MAX_CANDIDATES = 256  # of valleys that look alike, as in the first of several shocks
FINER = 8  # points of the interpolation between two samples; the search needs no better one
MIN_SAMPLES = 8  # of a response at another clock; else the record keeps its own


def clock_offset(records: Sequence[Record]) -> float:
    """Return ε, by which intervals of the response exceed those of the reference; 0 where that explains little."""
    search = _Search.of(records, MAX_ORDER, MAX_ORDER, delayed=True)
    if not search.driven or search.unexplained(0.0, LAST_SAMPLES) < FIRST_ORDER:
        return 0.0
    longest, samples = max(each.samples for each in search.driven), search.begin()
    candidates, reach = np.zeros(1), MAX_OFFSET
    while True:
        width = search.valley(samples)
        steps = np.arange(-np.ceil(reach / width), np.ceil(reach / width) + 1) * width
        tried = np.unique(np.round((candidates[:, None] + steps) / width)) * width
        left = np.array([search.unexplained(offset, samples) for offset in tried])
        order = np.argsort(left)[:MAX_CANDIDATES]
        candidates = tried[order[left[order] < max(2.0 * left[order[0]], 0.5)]]
        if not candidates.size:
            candidates = tried[order]
        if samples >= min(longest, LAST_SAMPLES):
            return search.bottom(float(tried[order[0]]), width, samples)
        reach, samples = width, 2 * samples


def nearby_offset(records: Sequence[Record], poles: int, zeros: int, *, delayed: bool) -> float:
    """Return ε near zero by a transfer function of a model's order; 0 where it explains little.

    In a sweep a higher order does what a ratio of the clocks does, to within some periods.
    """
    search = _Search.of(records, poles, zeros, delayed=delayed)
    if not search.driven:
        return 0.0
    width = min(0.5 * search.valley(LAST_SAMPLES), MAX_OFFSET)  # few periods tell no clocks apart
    tried = width * np.arange(-2 * MAX_PERIODS, 2 * MAX_PERIODS + 1)
    tried = tried[np.abs(tried) <= MAX_OFFSET]
    left = [search.unexplained(offset, LAST_SAMPLES) for offset in tried]
    return search.bottom(float(tried[int(np.argmin(left))]), width, LAST_SAMPLES)


def at_reference_clock(record: Record, offset: float) -> Record:
    """Return a record with its response brought to the clock of the reference.

    Args:
        record: its response is read at intervals 1 + ``offset`` times those of the reference.
        offset: ε.

    Returns:
        the record; itself where less than ``MIN_SAMPLES`` samples would be left of it.
    """
    if record.reference is None or offset == 0.0:
        return record
    reach, n = lost(1.0), record.samples
    first = int(np.ceil(reach * (1.0 + offset)))
    last = min(n, int(np.floor((n - 1 - reach) * (1.0 + offset))) + 1)
    positions = np.arange(first, last) / (1.0 + offset)
    spoilt = np.concatenate([[0], np.cumsum(~record.mask)])
    near = np.floor(positions).astype(int)
    valid = spoilt[np.minimum(near + reach + 1, n)] == spoilt[np.maximum(near - reach, 0)]
    if np.count_nonzero(valid) < MIN_SAMPLES:
        return record
    of_reference = None
    if record.reference_valid is not None or not record.mask.all():
        of_reference = record.reference_mask[first:last]
    said = f"response brought to the clock of the reference, by {offset:.6g}"
    return replace(
        record,
        reference=record.reference[first:last],
        response=resampled(record.response, positions, 1.0),
        valid=valid,
        reference_valid=of_reference,
        start_time_s=record.start_time_s + first / record.sampling_rate_hz,
        provenance=record.provenance.then(said),
    )


@dataclass(frozen=True, eq=False)
class _Channels:
    """Both channels of a record about their means, shape (samples,)."""

    reference: FloatArray
    response: FloatArray
    rate_hz: float

    @classmethod
    def of(cls, record: Record) -> _Channels:
        assert record.reference is not None
        n = min(record.samples, LAST_SAMPLES)
        response = about_mean(record.response, record.mask)[:n]
        reference = about_mean(record.reference, record.reference_mask)[:n]
        return cls(reference, response, record.sampling_rate_hz)

    @property
    def samples(self) -> int:
        return len(self.reference)

    def moves_in(self, samples: int) -> bool:
        """Tell whether the first samples under their window move a quarter as much as all, in power."""
        power, n = self.reference**2, min(samples, self.samples)
        return float(hann(n) ** 2 @ power[:n]) / n >= 0.25 * float(np.mean(power))

    @functools.cached_property
    def finer(self) -> FloatArray:
        """The response at FINER points a sample."""
        bins = np.zeros(self.samples * FINER // 2 + 1, dtype=complex)
        bins[: self.samples // 2 + 1] = fft.rfft(self.response)
        return np.asarray(fft.irfft(bins, self.samples * FINER)) * FINER

    def at(self, offset: float, samples: int) -> FloatArray:
        """The response at the instants of the reference."""
        if offset == 0.0:
            return self.response[:samples]
        places = np.arange(samples) * (FINER / (1.0 + offset))
        np.minimum(places, len(self.finer) - 1, out=places)
        before = np.minimum(places.astype(int), len(self.finer) - 2)
        value = self.finer[before]
        return value + (places - before) * (self.finer[before + 1] - value)

    def motion(self, samples: int) -> _Motion:
        """The reference in a band that holds all of the motion; made once for a number of samples."""
        if samples not in self._motions:
            n = min(samples, self.samples)
            x = np.asarray(fft.rfft(self.reference[:n] * hann(n)))
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
        return {}

    def answer(self, offset: float, samples: int) -> _Answer:
        """The response at the bins of the motion."""
        motion = self.motion(samples)
        y = np.asarray(fft.rfft(self.at(offset, motion.samples) * hann(motion.samples)))
        total = float(np.sum(power_of(y[motion.band]))) or 1.0
        late = _lateness(motion, y) if len(motion.bins) > MAX_ORDER * LOBE_BINS else 0
        return _Answer(y[motion.bins], total, late / self.rate_hz)


class _Motion(NamedTuple):
    """The reference of a record at the bins where there is motion.

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


class _Answer(NamedTuple):
    """The response of a record at the bins where there is motion.

    Attributes:
        response: shape (K,).
        total: power of the response in the whole band.
        late_s: by which most of the response comes after the reference.
    """

    response: ComplexArray
    total: float
    late_s: float


def _lateness(motion: _Motion, response: ComplexArray) -> int:
    """Return by how many samples the impulse response has its peak late; 0 where poles make that."""
    n, x = motion.samples, motion.reference
    ratio = np.zeros(n // 2 + 1, dtype=complex)
    power = power_of(x)
    ratio[motion.bins] = response[motion.bins] * np.conj(x) / (power + WHITENED * np.max(power))
    peak = int(np.argmax(np.abs(fft.irfft(ratio, n))))
    peak = peak if peak < n // 2 else peak - n
    return peak if abs(peak) >= LATE else 0


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
class _Search:
    """What a rational transfer function leaves of the records at a ratio of the clocks.

    Each record counts by its size, so that one large one does not decide; a common delay comes
    from that with most bins.
    """

    driven: tuple[_Channels, ...]
    poles: int
    zeros: int
    delayed: bool

    @classmethod
    def of(cls, records: Sequence[Record], poles: int, zeros: int, *, delayed: bool) -> _Search:
        driven = tuple(_Channels.of(each) for each in records if each.reference is not None)
        return cls(driven, poles, zeros, delayed)

    def begin(self) -> int:
        """Return in how many samples the motion is as strong as in the records, nearly."""
        samples = FIRST_SAMPLES
        while samples < LAST_SAMPLES and not any(each.moves_in(samples) for each in self.driven):
            samples *= 2
        return samples

    def valley(self, samples: int) -> float:
        """Return the width of the valley: the inverse of the periods of the fastest motion in the samples."""
        fastest = [(each.motion(samples).hz[-1], each) for each in self.driven]
        return 1.0 / max(hz * min(samples, each.samples) / each.rate_hz for hz, each in fastest)

    def unexplained(self, offset: float, samples: int) -> float:
        """Return the part of the response's power that no rational function of the reference explains."""
        answers = [each.answer(offset, samples) for each in self.driven]
        late_s = max(answers, key=lambda each: len(each.response)).late_s if self.delayed else 0.0
        basis = self._basis(samples)
        sizes = [np.sqrt(each.total) for each in answers]
        every = [each.motion(samples).reference for each in self.driven]
        motion = np.concatenate([each / size for each, size in zip(every, sizes, strict=True)])
        response = np.concatenate(
            [each.response / size for each, size in zip(answers, sizes, strict=True)]
        )
        response = response * np.exp(2j * np.pi * late_s * basis.hz)
        residual = response - _rational(basis, motion, response) * motion
        explained = float(np.sum(power_of(response)) - np.sum(power_of(residual)))
        return max(1.0 - explained / len(answers), np.finfo(float).tiny)

    def _basis(self, samples: int) -> _Basis:
        """Return the powers of the bins with motion, made once; tones tell of as many numbers as they have."""
        if samples not in self._bases:
            hz = np.concatenate([each.motion(samples).hz for each in self.driven])
            tones = len(hz) // LOBE_BINS
            poles, zeros = int(np.clip(tones - 1, 0, self.poles)), min(tones, self.zeros)
            powers = (1j * hz / hz.max()) ** np.arange(max(poles, zeros) + 1)[:, None]
            self._bases[samples] = _Basis(hz, powers, poles, zeros)
        return self._bases[samples]

    @functools.cached_property
    def _bases(self) -> dict[int, _Basis]:
        return {}

    def bottom(self, offset: float, width: float, samples: int) -> float:
        """Return the bottom of a valley, by golden sections (Kiefer 1953); 0 where it is not much deeper than there."""
        low, high = offset - width, offset + width
        inner = [high - GOLDEN * (high - low), low + GOLDEN * (high - low)]
        left = [self.unexplained(place, samples) for place in inner]
        while high - low > PRECISION * width:
            if left[0] < left[1]:
                high, inner[1], left[1] = inner[1], inner[0], left[0]
                inner[0] = high - GOLDEN * (high - low)
                left[0] = self.unexplained(inner[0], samples)
            else:
                low, inner[0], left[0] = inner[0], inner[1], left[1]
                inner[1] = low + GOLDEN * (high - low)
                left[1] = self.unexplained(inner[1], samples)
        lowest = int(np.argmin(left))
        gain = self.unexplained(0.0, samples) / left[lowest]
        return inner[lowest] if gain > MIN_GAIN else 0.0


def _rational(basis: _Basis, motion: ComplexArray, response: ComplexArray) -> ComplexArray:
    """Return the transfer function of least squares."""
    below, above = basis.powers[1 : basis.poles + 1], basis.powers[: basis.zeros + 1]
    denominator = np.ones(len(motion), dtype=complex)
    numerator = denominator
    rows = np.concatenate([below * response, -above * motion])
    for _ in range(ITERATIONS):
        weight = 1.0 / denominator
        columns = (rows * weight).view(float)
        gram = columns @ columns.T
        size = np.maximum(np.sqrt(np.diag(gram)), np.finfo(float).tiny)
        right = columns @ (response * weight).view(float) / size
        solution, *_ = np.linalg.lstsq(gram / size[:, None] / size, right, rcond=1e-11)
        factors = -solution / size
        denominator = 1.0 + factors[: basis.poles] @ below
        numerator = factors[basis.poles :] @ above
    return np.asarray(numerator / denominator, dtype=complex)
