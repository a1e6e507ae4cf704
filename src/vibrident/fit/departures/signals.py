"""A record's signals at the estimate, by their bins, and the groups that the score tests look at."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy import fft

from vibrident.data.records import BoolArray, FloatArray, Record
from vibrident.fit.departures.group import WhitenedGroup, orthonormal, rank_of, without
from vibrident.fit.departures.sums import Errors
from vibrident.fit.descent.weighed import freed
from vibrident.fit.noise.incoherent import HEARD_RATIO
from vibrident.fit.noise.leakage import beside_leakage
from vibrident.fit.noise.shapes import DOUBT_DEVIATIONS
from vibrident.fit.noise.spectrum import Motion, NoiseSpectrum, noise_spectrum
from vibrident.fit.response.response import ComplexArray
from vibrident.fit.response.rounding import TRIALS
from vibrident.fit.response.tones import HARMONICS
from vibrident.fit.response.transform import power_of
from vibrident.fit.uncertainty.steps import rounding_in_residual

#: The band over the highest frequency of the motion.
BAND = 1.5
#: Information, in squares of the noise, beyond the highest frequency of the motion: single bins of noise.
BEYOND = 100.0
#: Fewest bins of a band, as far as there are so many: what noise is, slow changes of it too, is told by these.
MIN_BINS = 512
#: Samples of the motion in time for each bin of the band: products of three signals alias behind the motion alone.
OVERSAMPLED = 4.0 - 2.0 / BAND
#: Records whose bands differ by less than this factor are worked on side by side, so many samples at once.
ALIKE, AT_ONCE = 1.5, 1 << 18

#: Relative change of the response by one standard uncertainty of each stated effect, shape (K, bins).
EffectsOf = Callable[["Signals"], ComplexArray]


@dataclass(frozen=True, eq=False)
class Signals:
    """Signals of a record, or a piece of it, by the bins of their transforms.

    Attributes:
        record: the record.
        span: its samples, n in number.
        used: those that count, shape (n,).
        rest: residual, shape (bins,).
        predicted: response to the reference that recurs with the record, shape (bins,).
        series: response as the fit has it, its free motion included, shape (n,).
        jacobian: of the response with the coordinates, shape (p, bins).
        transfer: of the sensor, shape (bins,).
        nuisance: columns of the nuisance parameters, shape (q, bins).
        spectrum: of the noise; that of the reference, over |H|².
        one_sided: how often a bin counts, shape (bins,).
        pull: shift of the fit's coordinates by those of the record, shape (P, p); None where these are the same.
        turns: of the record's sine from sample to sample; None for other motion.
        seen: motion, as the reading of the noise sees it.
        floor: lower limit of the noise.
    """

    record: Record
    span: slice
    used: BoolArray
    rest: ComplexArray
    predicted: ComplexArray
    series: FloatArray
    jacobian: ComplexArray
    transfer: ComplexArray
    nuisance: ComplexArray
    spectrum: NoiseSpectrum
    one_sided: FloatArray
    seen: Motion
    floor: float
    pull: FloatArray | None = None
    turns: float | None = None

    @property
    def counted(self) -> BoolArray:
        """Bins that count, shape (bins,)."""
        return np.asarray(self.one_sided > 0.0)

    @property
    def level(self) -> FloatArray:
        """Power of the noise, a sample, at the bins, shape (bins,)."""
        return self.spectrum.psd

    def in_noise_beside(self, columns: ComplexArray) -> Signals:
        """In the noise as it is beside the columns of departures, shape (m, K), at the first bins.

        A departure that is no motion's is noise to the spectrum that was read before it was known.
        """
        if not columns.any():
            return self
        known = np.zeros((len(columns), self.rest.size), dtype=complex)
        known[:, 1 : columns.shape[1] + 1] = columns
        beside = np.concatenate([self.nuisance, known, self.jacobian])
        left = freed(self.rest, beside, self.one_sided / self.level)
        spectrum = replace(noise_spectrum(left, self.seen, self.floor), tones=self.spectrum.tones)
        if self.pull is not None:
            spectrum = replace(spectrum, psd=beside_leakage(spectrum.psd, self.seen.lines))
        return replace(self, spectrum=spectrum)

    @functools.cached_property
    def last(self) -> int:
        """Last bin of the band: one and a half times the highest of the motion, and a tone's harmonics."""
        power = np.divide(power_of(self.predicted), self.level * max(float(self.used.sum()), 1.0))
        power[(power < HEARD_RATIO) | ~self.counted] = 0.0
        behind = np.cumsum(power[::-1])[::-1]
        top = BAND * float(np.searchsorted(-behind, -BEYOND))
        if self.turns is not None:
            top = max(top, (HARMONICS + 0.5) * self.turns * self.used.size)
        highest = int(np.flatnonzero(self.counted)[-1]) if self.counted.any() else 1
        return min(max(int(top) + 1, MIN_BINS), highest)


def grouped(every: Sequence[Signals]) -> list[tuple[int, ...]]:
    """Numbers of records of one length, rate and like band, so many at once."""
    alike = dict[tuple[int, float, bool, bool, int], list[int]]()
    for number, one in enumerate(every):
        band = round(np.log(one.last) / np.log(ALIKE))
        key = one.used.size, one.record.sampling_rate_hz, one.turns is None, one.pull is None, band
        alike.setdefault(key, []).append(number)
    made = list[tuple[int, ...]]()
    for (samples, *_), numbers in alike.items():
        width = max(AT_ONCE // samples, 1)
        made += [tuple(numbers[first : first + width]) for first in range(0, len(numbers), width)]
    return made


def group_of(
    every: Sequence[Signals],
    numbers: Sequence[int],
    effects_of: EffectsOf,
    departing: ComplexArray | None = None,
) -> WhitenedGroup:
    """Records of one length and rate side by side.

    Args:
        every: the records.
        numbers: of each among those of the fit.
        effects_of: makes what stated effects do to a response.
        departing: columns of departures that are known, shape (R, m, K); None of none.
    """
    samples = every[0].used.size
    bins = max(one.last for one in every) if departing is None else departing.shape[2]
    part = slice(1, bins + 1)
    level = np.stack([one.level[part] for one in every])
    counted = np.stack([one.counted[part] for one in every])
    gain = np.where(counted, np.sqrt(2.0 / samples / level), 0.0)

    def flat(columns: ComplexArray) -> FloatArray:
        return np.ascontiguousarray(columns * gain[:, None]).view(float)

    basis = orthonormal(flat(_side_by_side([one.nuisance[:, part] for one in every])))
    residual = without(flat(np.stack([one.rest[None, part] for one in every])), basis)
    predicted = np.stack([one.predicted[part] for one in every])
    transfer = np.where(counted, np.stack([one.transfer[part] for one in every]), 0.0)
    known = residual
    if departing is not None:
        known = without(residual, orthonormal(without(flat(departing), basis)))
    rest = np.divide(
        known[:, 0].view(complex), gain, out=np.zeros_like(predicted), where=gain > 0.0
    )
    share = np.stack([one.spectrum.input_noise_at[part] for one in every])
    count = np.array([[float(one.used.sum())] for one in every])
    likely = (
        most_likely(predicted, rest, share * power_of(transfer) / level, level * count) * counted
    )
    slopes = np.stack([one.jacobian[:, part] for one in every])
    pull = (
        None
        if every[0].pull is None
        else np.stack([one.pull for one in every if one.pull is not None])
    )
    turns = np.array([np.nan if one.turns is None else one.turns for one in every])
    tone, jacobian = None, slopes
    if pull is None:  # the tone of a sine is told from its points
        jacobian = without(flat(slopes * (likely != 0.0)[:, None]), basis)
    else:
        jacobian = np.zeros((len(every), pull.shape[1], 2 * level.shape[1]))
        tone = without(flat(slopes), basis)
    made = WhitenedGroup(
        tuple(one.record for one in every),
        np.array(numbers),
        np.array([one.span.start / one.record.sampling_rate_hz for one in every]),
        np.stack([one.used for one in every]),
        turns,
        predicted,
        likely,
        _motion(every, likely, part.stop),
        transfer,
        slopes,
        gain,
        basis,
        residual[:, 0],
        jacobian,
        tone,
        pull,
        np.array([np.sum(one.one_sided[part]) * one.used.mean() for one in every]) - rank_of(basis),
        lambda some: _errors(
            [every[number] for number in some], effects_of, likely[some], gain[some]
        ),
        lambda columns: group_of(
            [one.in_noise_beside(own) for one, own in zip(every, columns, strict=True)],
            numbers,
            effects_of,
            columns,
        ),
    )
    if tone is None:
        return made
    harmonics = made.harmonics.reshape(len(every), -1, level.shape[1])
    harmonics = orthonormal(without(flat(harmonics), basis))
    return replace(made, tone=without(tone, harmonics))


def _side_by_side(columns: Sequence[ComplexArray]) -> ComplexArray:
    """Columns of records, padded by zeros, shape (R, m, K)."""
    most = max(len(one) for one in columns)
    made = np.zeros((len(columns), most, columns[0].shape[1]), dtype=complex)
    for row, one in zip(made, columns, strict=True):
        row[: len(one)] = one
    return made


def most_likely(
    predicted: ComplexArray, rest: ComplexArray, share: FloatArray, noise: FloatArray
) -> ComplexArray:
    """Response to the most likely motion, zero where noise may be all of it, shape (…, bins).

    X̂ = X + σx² H* R/S: its error is independent of the residual R, as that of the reference X is not.

    Args:
        predicted: response to the reference.
        rest: residual less nuisance parameters.
        share: part of the noise that is the reference's, σx² |H|²/S.
        noise: power S of the noise in a bin.
    """
    share = np.minimum(share, 1.0)
    likely = predicted + share * rest
    unsure = np.where(share > 0.0, share * (1.0 - share), 1.0) * noise
    return np.asarray(likely * (power_of(likely) > HEARD_RATIO * unsure))


def _motion(every: Sequence[Signals], likely: ComplexArray, stop: int) -> FloatArray:
    """Response to the most likely motion in time, with the fit's free motion, shape (R, L).

    A response that recurs with the record rings at its ends, where it jumps; what a departure makes of that ringing is
    no nuisance parameter's.
    """
    samples = every[0].used.size
    step = max(int(samples / (OVERSAMPLED * stop)), 1)
    while samples % step:
        step -= 1
    used = np.stack([one.used for one in every])
    predicted = np.stack([one.predicted for one in every])
    predicted[:, 0] = 0.0
    free = np.where(
        used, np.stack([one.series for one in every]) - fft.irfft(predicted, samples, axis=1), 0.0
    )
    free -= np.sum(free, axis=1, keepdims=True) / np.maximum(used.sum(axis=1, keepdims=True), 1)
    padded = np.zeros((len(every), likely.shape[1] + 1), dtype=complex)
    padded[:, 1:] = likely
    moved = fft.irfft(padded, samples // step, axis=1) / step
    return np.asarray(moved + np.where(used, free, 0.0)[:, ::step])


def _errors(
    every: Sequence[Signals], effects_of: EffectsOf, likely: ComplexArray, gain: FloatArray
) -> Errors:
    """Whitened errors of known covariance.

    Args:
        every: the records.
        effects_of: makes what stated effects do to a response.
        likely: response to the most likely motion, shape (R, K).
        gain: that makes noise white, shape (R, K).
    """
    made = [
        _errors_of(one, effects_of(one), *own)
        for one, *own in zip(every, likely, gain, strict=True)
    ]
    return Errors(*(np.stack(parts) for parts in zip(*made, strict=True)))


def _errors_of(
    one: Signals, effects: ComplexArray, likely: ComplexArray, gain: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of a record: converters, effects and doubt of the reference's noise, as in :class:`Errors`."""
    samples, counted, part = one.used.size, one.counted, slice(1, gain.size + 1)

    def flat(columns: ComplexArray) -> FloatArray:
        return np.ascontiguousarray(columns * gain).view(float)

    transfer = np.where(counted, one.transfer, 0.0)
    doubt = one.spectrum.doubt * power_of(transfer) / (DOUBT_DEVIATIONS * one.level)
    doubt = np.minimum(doubt, 1.0)[part]
    # An error ε of σx² leaves ε H* R/S of the residual R in the most likely motion: a departure D = L Ŷ then has
    # Σ L* ε |R|²/S with it, as much as with the signal ε |R|²/(S Ŷ*).
    among = doubt * power_of(one.rest[part])
    among = np.divide(among, np.conj(likely), out=np.zeros_like(likely), where=likely != 0.0)
    between = float(np.median(one.level[counted])) if counted.any() else 0.0
    recurring = one.predicted.copy()
    recurring[0] = 0.0
    predicted = np.asarray(fft.irfft(recurring, samples))
    errors = rounding_in_residual(
        one.record, one.span, predicted, one.used, between, transfer, one.turns
    )
    rounding = np.zeros((2 * TRIALS, 2 * gain.size))
    if errors is not None:
        rounding = flat(np.asarray(fft.rfft(errors * one.used, axis=-1))[:, part])
    return rounding, flat(np.concatenate([effects[:, part] * likely, among[None]])), doubt
