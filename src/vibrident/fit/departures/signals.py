"""A record's signals at the estimate, by their bins, and the groups that the score tests use."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy import fft

from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.fit.departures.group import WhitenedGroup
from vibrident.fit.departures.rows import orthonormal, rank_of, without
from vibrident.fit.departures.sums import Errors
from vibrident.fit.descent.weighed import freed
from vibrident.fit.noise.leakage import beside_leakage
from vibrident.fit.noise.reading import DOUBT_DEVIATIONS, HEARD_RATIO
from vibrident.fit.noise.spectrum import Motion, NoiseSpectrum, noise_spectrum
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.rounding import TRIALS
from vibrident.fit.response.tones import HARMONICS
from vibrident.fit.response.transform import power_of
from vibrident.fit.uncertainty.steps import rounding_in_residual

#: The band over the highest frequency of the motion.
BAND_OVER_HIGHEST = 1.5
#: Information, in squares of the noise, beyond the motion's highest frequency: single noisy bins.
MIN_INFORMATION_BEYOND = 100.0
#: Fewest bins of a band, if there are so many: they determine the noise and its slow changes.
MIN_BINS = 512
#: Samples of the motion in time for each bin of the band: products of three signals alias behind
#: the motion alone.
OVERSAMPLING = 4.0 - 2.0 / BAND_OVER_HIGHEST
#: Records whose bands differ by less than this factor are worked on side by side.
MAX_BAND_RATIO = 1.5
#: So many samples are worked on at once.
MAX_SAMPLES_AT_ONCE = 1 << 18

#: Relative change of the response by one u of each stated effect, shape (K, bins).
EffectsOf = Callable[["Signals"], ComplexArray]


@dataclass(frozen=True, eq=False)
class Signals:
    """Signals of a record, or a piece of it, by the bins of their transforms.

    Attributes:
        record: the record.
        span: its samples, n in number.
        used: samples that count, shape (n,).
        residual: of the fit, shape (bins,).
        predicted: response to the reference that recurs with the record, shape (bins,).
        series: response as the fit has it, its free motion included, shape (n,).
        jacobian: of the response with the coordinates, shape (p, bins).
        transfer: of the sensor, shape (bins,).
        nuisance: columns of the nuisance parameters, shape (q, bins).
        spectrum: of the noise; that of the reference, over |H|².
        one_sided: how often a bin counts, shape (bins,).
        motion: as the reading of the noise sees it.
        floor: lower limit of the noise.
        pull: shift of the fit's coordinates by those of the record, shape (P, p); None where these
            are the same.
        turns: of the record's sine from sample to sample; None for other motion.
    """

    record: Record
    span: slice
    used: BoolArray
    residual: ComplexArray
    predicted: ComplexArray
    series: FloatArray
    jacobian: ComplexArray
    transfer: ComplexArray
    nuisance: ComplexArray
    spectrum: NoiseSpectrum
    one_sided: FloatArray
    motion: Motion
    floor: float
    pull: FloatArray | None = None
    turns: float | None = None

    @property
    def counted(self) -> BoolArray:
        """Return which bins count, shape (bins,)."""
        return np.asarray(self.one_sided > 0.0)

    @property
    def level(self) -> FloatArray:
        """Return the power of the noise, a sample, at the bins, shape (bins,)."""
        return self.spectrum.psd

    def in_noise_beside(self, columns: ComplexArray) -> Signals:
        """Return the signals in the noise beside columns of departures, shape (m, K).

        The columns are at the first bins. A departure that is no motion's is noise to the spectrum
        that was read before it was known.
        """
        if not columns.any():
            return self
        departing = np.zeros((len(columns), self.residual.size), dtype=complex)
        departing[:, 1 : columns.shape[1] + 1] = columns
        nuisances = np.concatenate([self.nuisance, departing, self.jacobian])
        noise = freed(self.residual, nuisances, self.one_sided / self.level)
        spectrum = replace(
            noise_spectrum(noise, self.motion, self.floor), tones=self.spectrum.tones
        )
        if self.pull is not None:
            spectrum = replace(spectrum, psd=beside_leakage(spectrum.psd, self.motion.lines))
        return replace(self, spectrum=spectrum)

    @functools.cached_property
    def last_bin(self) -> int:
        """Return the last bin of the band.

        The band ends at one and a half times the highest frequency of the motion, and holds a
        tone's harmonics.
        """
        power = np.divide(power_of(self.predicted), self.level * max(float(self.used.sum()), 1.0))
        power[(power < HEARD_RATIO) | ~self.counted] = 0.0
        information_beyond = np.cumsum(power[::-1])[::-1]
        band_end = BAND_OVER_HIGHEST * float(
            np.searchsorted(-information_beyond, -MIN_INFORMATION_BEYOND)
        )
        if self.turns is not None:
            band_end = max(band_end, (HARMONICS + 0.5) * self.turns * self.used.size)
        last_counted = int(np.flatnonzero(self.counted)[-1]) if self.counted.any() else 1
        return min(max(int(band_end) + 1, MIN_BINS), last_counted)


def grouped(signals: Sequence[Signals]) -> list[tuple[int, ...]]:
    """Return the numbers of records of one length, rate and like band, in limited groups."""
    numbers_by_kind = dict[tuple[int, float, bool, bool, int], list[int]]()
    for number, record_signals in enumerate(signals):
        band = round(np.log(record_signals.last_bin) / np.log(MAX_BAND_RATIO))
        key = (
            record_signals.used.size,
            record_signals.record.sampling_rate_hz,
            record_signals.turns is None,
            record_signals.pull is None,
            band,
        )
        numbers_by_kind.setdefault(key, []).append(number)
    groups = list[tuple[int, ...]]()
    for (samples, *_), numbers in numbers_by_kind.items():
        width = max(MAX_SAMPLES_AT_ONCE // samples, 1)
        groups += [tuple(numbers[first : first + width]) for first in range(0, len(numbers), width)]
    return groups


class _Stack(NamedTuple):
    """Signals of R records at K bins, side by side.

    Attributes:
        level: power of the noise, a sample, shape (R, K).
        counted: bins that count, shape (R, K).
        gain: of a bin that makes noise white, zero where it does not count, shape (R, K).
        predicted: response to the reference, shape (R, K).
        transfer: of the sensor, zero where a bin does not count, shape (R, K).
    """

    level: FloatArray
    counted: BoolArray
    gain: FloatArray
    predicted: ComplexArray
    transfer: ComplexArray

    @classmethod
    def from_signals(cls, signals: Sequence[Signals], part: slice) -> _Stack:
        """Stack records of one length and rate at these bins."""
        level = np.stack([one.level[part] for one in signals])
        counted = np.stack([one.counted[part] for one in signals])
        gain = np.where(counted, np.sqrt(2.0 / signals[0].used.size / level), 0.0)
        predicted = np.stack([one.predicted[part] for one in signals])
        transfer = np.where(counted, np.stack([one.transfer[part] for one in signals]), 0.0)
        return cls(level, counted, gain, predicted, transfer)

    def whiten(self, columns: ComplexArray) -> FloatArray:
        """Return columns by bins, shape (R, m, K), as whitened rows, shape (R, m, 2 K)."""
        return np.ascontiguousarray(columns * self.gain[:, None]).view(float)

    def likely_motion(
        self, signals: Sequence[Signals], residual: FloatArray, part: slice
    ) -> ComplexArray:
        """Return the response to the most likely motion, shape (R, K).

        ``residual``: whitened, free of what is no noise, shape (R, 2 K).
        """
        noise = np.divide(
            residual.view(complex),
            self.gain,
            out=np.zeros_like(self.predicted),
            where=self.gain > 0.0,
        )
        input_noise = np.stack([one.spectrum.input_noise_at[part] for one in signals])
        count = np.array([[float(one.used.sum())] for one in signals])
        share = input_noise * power_of(self.transfer) / self.level
        return most_likely(self.predicted, noise, share, self.level * count) * self.counted


def group_of(
    signals: Sequence[Signals],
    numbers: Sequence[int],
    effects_of: EffectsOf,
    departing: ComplexArray | None = None,
) -> WhitenedGroup:
    """Return records of one length and rate side by side.

    Args:
        signals: of the records.
        numbers: of each record among those of the fit.
        effects_of: makes what stated effects do to a response.
        departing: columns of departures that are known, shape (R, m, K); None without any.
    """
    bins = max(one.last_bin for one in signals) if departing is None else departing.shape[2]
    part = slice(1, bins + 1)
    stack = _Stack.from_signals(signals, part)
    basis = orthonormal(stack.whiten(_pad_columns([one.nuisance[:, part] for one in signals])))
    residual = without(stack.whiten(np.stack([one.residual[None, part] for one in signals])), basis)
    noise = residual
    if departing is not None:
        noise = without(residual, orthonormal(without(stack.whiten(departing), basis)))
    likely = stack.likely_motion(signals, noise[:, 0], part)
    slopes = np.stack([one.jacobian[:, part] for one in signals])
    pull = _pull_of(signals)
    tone = None
    if pull is None:
        jacobian = without(stack.whiten(slopes * (likely != 0.0)[:, None]), basis)
    else:  # the points of the sine hold what its tone says
        jacobian = np.zeros((len(signals), pull.shape[1], 2 * bins))
        tone = without(stack.whiten(slopes), basis)
    counts = np.array([np.sum(one.one_sided[part]) * one.used.mean() for one in signals])

    def errors_of(places: Sequence[int]) -> Errors:
        chosen = [signals[place] for place in places]
        return _errors(chosen, effects_of, likely[places], stack.gain[places])

    def again(columns: ComplexArray) -> WhitenedGroup:
        beside = [one.in_noise_beside(own) for one, own in zip(signals, columns, strict=True)]
        return group_of(beside, numbers, effects_of, columns)

    group = WhitenedGroup(
        records=tuple(one.record for one in signals),
        numbers=np.array(numbers),
        begin_s=np.array([one.span.start / one.record.sampling_rate_hz for one in signals]),
        used=np.stack([one.used for one in signals]),
        turns=np.array([np.nan if one.turns is None else one.turns for one in signals]),
        predicted=stack.predicted,
        likely=likely,
        motion=_motion_in_time(signals, likely, part.stop),
        transfer=stack.transfer,
        slopes=slopes,
        gain=stack.gain,
        basis=basis,
        residual=residual[:, 0],
        jacobian=jacobian,
        tone=tone,
        pull=pull,
        freedom=counts - rank_of(basis),
        errors_of=errors_of,
        again=again,
    )
    if tone is None:
        return group
    harmonics = group.harmonics.reshape(len(signals), -1, bins)
    harmonics = orthonormal(without(stack.whiten(harmonics), basis))
    return replace(group, tone=without(tone, harmonics))


def _pull_of(signals: Sequence[Signals]) -> FloatArray | None:
    """Return the shift of the fit's coordinates by those of each record, shape (R, P, p).

    It is None where these are the same.
    """
    if signals[0].pull is None:
        return None
    return np.stack([one.pull for one in signals if one.pull is not None])


def _pad_columns(columns: Sequence[ComplexArray]) -> ComplexArray:
    """Return the columns of records, padded by zeros, shape (R, m, K)."""
    count = max(len(record_columns) for record_columns in columns)
    padded = np.zeros((len(columns), count, columns[0].shape[1]), dtype=complex)
    for row, record_columns in zip(padded, columns, strict=True):
        row[: len(record_columns)] = record_columns
    return padded


def most_likely(
    predicted: ComplexArray, residual: ComplexArray, share: FloatArray, noise: FloatArray
) -> ComplexArray:
    """Return the response to the most likely motion, shape (…, bins).

    X̂ = X + σx² H* R/S: its error is independent of the residual R, as that of the reference X is
    not. It is zero where noise may be all of it.

    Args:
        predicted: response to the reference.
        residual: of the fit, less nuisance parameters.
        share: part of the noise that is the reference's, σx² |H|²/S.
        noise: power S of the noise in a bin.
    """
    share = np.minimum(share, 1.0)
    likely = predicted + share * residual
    error_power = np.where(share > 0.0, share * (1.0 - share), 1.0) * noise
    return np.asarray(likely * (power_of(likely) > HEARD_RATIO * error_power))


def _motion_in_time(signals: Sequence[Signals], likely: ComplexArray, stop: int) -> FloatArray:
    """Return the response to the most likely motion in time, free motion included, shape (R, L).

    A response that recurs with the record rings at its ends, where it jumps; what a departure makes
    of that ringing is no nuisance parameter's.
    """
    samples = signals[0].used.size
    step = max(int(samples / (OVERSAMPLING * stop)), 1)
    while samples % step:
        step -= 1
    used = np.stack([record_signals.used for record_signals in signals])
    predicted = np.stack([record_signals.predicted for record_signals in signals])
    predicted[:, 0] = 0.0
    free_motion = np.where(
        used,
        np.stack([record_signals.series for record_signals in signals])
        - fft.irfft(predicted, samples, axis=1),
        0.0,
    )
    free_motion -= np.sum(free_motion, axis=1, keepdims=True) / np.maximum(
        used.sum(axis=1, keepdims=True), 1
    )
    padded = np.zeros((len(signals), likely.shape[1] + 1), dtype=complex)
    padded[:, 1:] = likely
    recurring = fft.irfft(padded, samples // step, axis=1) / step
    return np.asarray(recurring + np.where(used, free_motion, 0.0)[:, ::step])


def _errors(
    signals: Sequence[Signals], effects_of: EffectsOf, likely: ComplexArray, gain: FloatArray
) -> Errors:
    """Return whitened errors of known covariance.

    Args:
        signals: of the records.
        effects_of: makes what stated effects do to a response.
        likely: response to the most likely motion, shape (R, K).
        gain: that makes noise white, shape (R, K).
    """
    errors_by_record = [
        _errors_of_record(record_signals, effects_of(record_signals), *likely_and_gain)
        for record_signals, *likely_and_gain in zip(signals, likely, gain, strict=True)
    ]
    return Errors(*(np.stack(arrays) for arrays in zip(*errors_by_record, strict=True)))


def _errors_of_record(
    signals: Signals, effects: ComplexArray, likely: ComplexArray, gain: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return a record's errors: of converters, of effects, and doubt of the reference's noise.

    They are as in :class:`Errors`.
    """
    samples = signals.used.size
    counted = signals.counted
    part = slice(1, gain.size + 1)

    def whiten(columns: ComplexArray) -> FloatArray:
        return np.ascontiguousarray(columns * gain).view(float)

    transfer = np.where(counted, signals.transfer, 0.0)
    doubt = signals.spectrum.doubt * power_of(transfer) / (DOUBT_DEVIATIONS * signals.level)
    doubt = np.minimum(doubt, 1.0)[part]
    # An error ε of σx² leaves ε H* R/S of the residual R in the most likely motion: a departure
    # D = L Ŷ then has Σ L* ε |R|²/S with it, as much as with the signal ε |R|²/(S Ŷ*).
    doubtful_motion = doubt * power_of(signals.residual[part])
    doubtful_motion = np.divide(
        doubtful_motion, np.conj(likely), out=np.zeros_like(likely), where=likely != 0.0
    )
    noise_level = float(np.median(signals.level[counted])) if counted.any() else 0.0
    recurring = signals.predicted.copy()
    recurring[0] = 0.0
    predicted = np.asarray(fft.irfft(recurring, samples))
    errors = rounding_in_residual(
        signals.record, signals.span, predicted, signals.used, noise_level, transfer, signals.turns
    )
    rounding = np.zeros((2 * TRIALS, 2 * gain.size))
    if errors is not None:
        rounding = whiten(np.asarray(fft.rfft(errors * signals.used, axis=-1))[:, part])
    return (
        rounding,
        whiten(np.concatenate([effects[:, part] * likely, doubtful_motion[None]])),
        doubt,
    )
